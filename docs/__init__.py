"""Commands that make what the documents show."""
