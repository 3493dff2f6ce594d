"""What is said and drawn of a diagnosis: the same on pages, over HTTP, in messages and on the command line."""
