"""The case library: retrieve, reuse, revise, retain."""
