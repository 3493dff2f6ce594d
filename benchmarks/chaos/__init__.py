"""What must hold whatever is killed and whenever: `python -m benchmarks.chaos`, bounded in time, on one machine."""
