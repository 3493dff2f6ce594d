"""What processes left that were killed: `gearcase doctor` counts it, and the service removes it when it starts."""

from pathlib import Path

from casebase.library import CaseLibrary
from casebase.store.erasing import discard_left
from casebase.store.stale_locks import count_abandoned


def leftovers(library: CaseLibrary, incoming: Path, *, remove: bool) -> int:
    """Return how much was left: uploads in `incoming`, half written files, audio that was erased.

    What another process has in hand is not among it.
    """
    under_way = (*incoming.glob("*"), *library.audio.unfinished())
    return count_abandoned(under_way, remove=remove) + discard_left(library, remove=remove)
