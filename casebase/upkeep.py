"""What a library that grew needs: weights are learned again, and the table of a large one is written again."""

from threading import Event

from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from casebase.artifacts import newest_version, similarity_for, similarity_kind, store_similarity
from casebase.case_table import CaseTable
from casebase.experience import calibrated
from casebase.kept_table import name_table, outgrown, remove_others, write_table
from casebase.learning import LearningStoppedError, Similarity, learn
from casebase.library import CaseLibrary
from casebase.rehearsal import rehearsed
from casebase.signals.features import EXTRACTOR_VERSION


def keep_learned(
    library: CaseLibrary, actor: str, extractor_version: str = EXTRACTOR_VERSION, *, stop: Event | None = None
) -> bool:
    """Learn again if the library outgrew what was learned; return whether it did.

    Nothing is locked while it learns. If somebody else stores something newer meanwhile, that stays. It is given
    up, with nothing stored, when `stop` is set.
    """
    with library.reading() as session:
        table = library.retrieve.table(session, extractor_version)
        kind = similarity_kind(extractor_version)
        newest, (_, _, stale) = newest_version(session, kind), similarity_for(session, table)
    if not stale:
        return False
    try:
        with library.reading() as session:
            learned = _learned(library, session, table, stop)
        with library.transaction(actor) as session:
            store_similarity(session, learned, kind, after=newest)
    except (IntegrityError, LearningStoppedError):
        return False
    return True


def _learned(library: CaseLibrary, session: Session, table: CaseTable, stop: Event | None) -> Similarity:
    """Learn weights, and from disturbed copies of the recordings how far an answer holds."""
    learned = learn(table, stop)
    if learned.score is None:
        return learned
    return calibrated(table, learned, rehearsed(session, library.audio, table, stop))


def keep_table(library: CaseLibrary, actor: str, extractor_version: str = EXTRACTOR_VERSION) -> bool:
    """Write the table of a large library beside the database, where much changed; return whether it was written."""
    folder = library.retrieve.tables
    with library.reading() as session:
        table = library.retrieve.all_cases(session, extractor_version)
        if not outgrown(session, folder, table):
            return False
    document = write_table(folder, table)
    with library.transaction(actor) as session:
        name_table(session, extractor_version, document)
    remove_others(folder, document)
    return True
