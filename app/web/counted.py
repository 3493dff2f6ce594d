"""What is counted over the whole library, once for every version of it: any change of a case makes a new version."""

from collections.abc import Callable, Mapping
from typing import TypeVar, cast
from weakref import WeakKeyDictionary

from sqlalchemy.orm import Session

from casebase.library import CaseLibrary
from casebase.store.counter import library_version

Value = TypeVar("Value")
_KEPT: WeakKeyDictionary[CaseLibrary, dict[str, tuple[int, object]]] = WeakKeyDictionary()


def counted(library: CaseLibrary, session: Session, name: str, count: Callable[[], Value]) -> Value:
    """Return what `count` returns, as long as the library stays at a version without counting again.

    The version is read first: were a change to come in between, what is kept would be too new, never too old.
    """
    version = library_version(session)
    kept = _KEPT.setdefault(library, {})
    known = kept.get(name)
    if known is None or known[0] != version:
        known = kept[name] = (version, count())
    return cast(Value, known[1])


def counts_of(library: CaseLibrary, session: Session) -> Mapping[tuple[str, str], int]:
    """Return how many searchable cases there are per label and origin."""
    return counted(library, session, "counts", lambda: library.retrieve.counts(session))


def of_library(library: CaseLibrary, session: Session) -> str:
    """Say that something is worked out from all cases, and how often."""
    cases = sum(counts_of(library, session).values())
    return f"the {cases:,} cases of the library, once until a case changes"
