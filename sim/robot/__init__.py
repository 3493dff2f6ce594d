"""Whole robots: what the rigid-body model of all joints at once misses, joint by joint."""
