"""A library as large as asked for, as rows: what a plant with many robots has after some years."""
