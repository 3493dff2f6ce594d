"""HTTP, web pages, command line and jobs: the only code that knows how the world reaches Gearcase."""
