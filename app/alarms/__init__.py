"""Messages on their way: their words, and how each kind of receiver is reached."""
