"""How long audio is kept: where an installation sets `GEARCASE_RETAIN_AUDIO_DAYS`, older audio is erased every day."""

import structlog

from app.periodic import Periodic
from casebase.library import CaseLibrary
from casebase.origins import DEMO
from casebase.store.artifacts import active_artifact
from casebase.store.erasing import expire

ACTOR = "retention"
DAY_S = 86_400.0
LOG = structlog.get_logger(__name__)


def erase_old(library: CaseLibrary, days: int, actor: str = ACTOR) -> list[str]:
    """Erase audio older than so many days, never that of a case or of the demonstration; return ids of recordings."""
    with library.reading() as session:
        demo = active_artifact(session, DEMO)
    return expire(library, actor, days, keep=() if demo is None else (str(demo.content["recording_id"]),))


def retention(library: CaseLibrary, days: int | None) -> Periodic | None:
    """Return what erases every day what is older than so many days; none where nothing is set."""
    if days is None:
        return None

    def work() -> None:
        LOG.info("old audio erased", recordings=len(erase_old(library, days)), days=days)

    return Periodic("retention", DAY_S, work)
