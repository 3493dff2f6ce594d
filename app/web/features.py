"""Stored features of a recording, by name."""

from sqlalchemy.orm import Session

from casebase.models import Extractor, FeatureRow
from casebase.recordings import named_features
from casebase.signals.features import EXTRACTOR_VERSION

SHOWN = ("crest_factor_whole_record", "crest_factor_low_pass_200_hz_whole_record", "rms", "peak")


def features_of(session: Session, recording_id: str) -> dict[str, float | None]:
    """Return the stored features of a recording; those that a page shows are unknown with an older extractor."""
    stored = session.get(FeatureRow, (recording_id, EXTRACTOR_VERSION))
    extractor = session.get(Extractor, EXTRACTOR_VERSION)
    if stored is None or extractor is None:
        return dict.fromkeys(SHOWN)
    return named_features(stored, extractor.names)
