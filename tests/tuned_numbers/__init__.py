"""Which tuned numbers decide anything: every comparison is asked again with the number twice and half as large."""
