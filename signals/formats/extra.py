"""Packages that are installed only where such files are read: `pip install "gearcase[logs]"`."""

from importlib import import_module
from typing import Any

from signals.errors import TelemetryError


def loaded(module: str, kind: str) -> Any:
    """Return a module of the extra `logs`.

    `kind`: what the file is, in words.

    Raises:
        TelemetryError: if it is not installed, with what installs it.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise TelemetryError(
            f'this is {kind}; what reads it is not installed here: pip install "gearcase[logs]", or export it as CSV'
        ) from error
