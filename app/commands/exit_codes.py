"""Exit codes of the command line."""

DONE, FAILURE, BAD_INPUT, FAULT_FOUND = 0, 1, 2, 3
