"""What must hold whatever is killed and whenever: `python -m tests.chaos`, bounded in time, on this machine alone."""
