"""What a library that grew needs: the table of a large one is written again."""

from casebase.library import CaseLibrary
from casebase.search.stored_table import name_table, outgrown, remove_others, write_table
from signals.features import EXTRACTOR_VERSION


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
