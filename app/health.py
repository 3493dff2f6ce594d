"""`python -m app.health`: ends with 0 if the service, or the worker, of this container is well, else with 1."""

import sys
import time
from urllib.error import HTTPError, URLError
from urllib.request import urlopen

from app.settings import settings_of
from casebase.store.leases import beat_file

READY = "http://127.0.0.1:8000/readyz"
TIMEOUT_S = 4.0


def is_well() -> bool:
    """Whether the service is ready; where none listens, whether the worker beat within a lease."""
    settings = settings_of()
    try:
        with urlopen(READY, timeout=TIMEOUT_S):
            return True
    except HTTPError:
        return False
    except URLError as error:
        if not isinstance(error.reason, ConnectionRefusedError):
            return False
    beat = beat_file(settings.data_dir)
    return beat.exists() and time.time() - beat.stat().st_mtime < settings.lease_s


if __name__ == "__main__":
    sys.exit(0 if is_well() else 1)
