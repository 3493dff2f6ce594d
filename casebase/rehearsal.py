"""Rehearsal: the library's own recordings, disturbed as people would disturb them, for calibration to learn from."""

from threading import Event

import numpy as np
from sqlalchemy import select
from sqlalchemy.orm import Session

from casebase.audio_store import AudioStore
from casebase.case_table import CaseTable
from casebase.description import condition_of
from casebase.errors import NotFoundError
from casebase.experience import Copies, representative
from casebase.learning import LearningStoppedError
from casebase.models import Case, StoredRecording
from casebase.novelty import spread_out
from casebase.signals.decode import read_recording
from casebase.signals.errors import SignalError
from casebase.signals.features import extract

MOST_REHEARSED = 30
"""Recordings of which copies are made: more would tell little more, and each costs as much as ten recordings do."""


def rehearsed(session: Session, audio: AudioStore, table: CaseTable, stop: Event | None = None) -> Copies:
    """Return disturbed copies of cases spread over the library; a recording whose audio is gone is passed over.

    Raises:
        LearningStoppedError: if `stop` is set before it is done.
    """
    from casebase.augmentation import disturbed_copies  # needs filters, which are slow to import

    rows = spread_out(representative(table), MOST_REHEARSED)
    found, values = [], []
    for row in rows:
        if stop is not None and stop.is_set():
            raise LearningStoppedError
        statement = select(StoredRecording).join(Case, Case.recording_id == StoredRecording.id)
        stored = session.scalar(statement.where(Case.id == str(table.ids[row])))
        if stored is None or not stored.usable:
            continue
        try:
            recording = read_recording(audio.path(stored.file_sha256), channel=stored.channel)
        except (SignalError, NotFoundError):
            continue
        condition = condition_of(stored.description)
        for copy in disturbed_copies(recording):
            extraction = extract(copy, condition)
            if extraction.usable:
                found.append(int(row))
                values.append(extraction.features.values)
    size = len(table.names)
    return Copies(np.array(found, np.intp), np.array(values, np.float32).reshape(len(found), size))
