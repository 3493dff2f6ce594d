"""Sound that comes in is read as this installation takes it."""

from dataclasses import replace
from pathlib import Path

from app.settings import settings_of
from signals.reading.decode import LIMITS, read_recording
from signals.recording import Recording


def read_sound(path: Path, *, channel: int | None = None) -> Recording:
    """Decode a file that comes in, as `read_recording` does; lossy ones only if the installation takes them."""
    return read_recording(path, channel=channel, limits=replace(LIMITS, lossy=settings_of().accept_lossy))
