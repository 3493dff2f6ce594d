"""What the simulation gets wrong: measured data of an axis held against its description."""
