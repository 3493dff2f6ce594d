"""`python -m app VERB` is `gearcase VERB`."""

from app.cli import main

if __name__ == "__main__":
    main()
