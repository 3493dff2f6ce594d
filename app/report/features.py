"""Stored features of a recording, by name."""

from collections.abc import Collection
from typing import TypeVar

from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.recordings import named_features
from casebase.store.models import Extractor, FeatureRow
from signals.features import EXTRACTOR_VERSION

SHOWN = ("crest_factor_whole_record", "crest_factor_low_pass_200_hz_whole_record", "rms", "peak")
HELD = "features"


def features_of(session: Session, recording_id: str) -> dict[str, float | None]:
    """Return the stored features of a recording; those that a page shows are unknown with an older extractor."""
    stored, extractor = stored_features(session, recording_id), _held(session, Extractor, EXTRACTOR_VERSION)
    if stored is None or extractor is None:
        return dict.fromkeys(SHOWN)
    return named_features(stored, extractor.names)


def stored_features(session: Session, recording_id: str) -> FeatureRow | None:
    """Return the features as they are stored; a page that asks for them several times reads them once."""
    return _held(session, FeatureRow, (recording_id, EXTRACTOR_VERSION))


def read_together(session: Session, recordings: Collection[str]) -> None:
    """Read the features of several recordings in one statement, before they are asked for one by one."""
    wanted = FeatureRow.recording_id.in_(recordings)
    rows = session.scalars(select(FeatureRow).where(wanted, FeatureRow.extractor_version == EXTRACTOR_VERSION)).all()
    session.info.setdefault(HELD, []).extend(rows)


Stored = TypeVar("Stored", Extractor, FeatureRow)


def _held(session: Session, kind: type[Stored], key: str | tuple[str, str]) -> Stored | None:
    """Return a row, and keep hold of it: a session forgets what nobody holds, and reads it again."""
    row = session.get(kind, key)
    session.info.setdefault(HELD, []).append(row)
    return row
