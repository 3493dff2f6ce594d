"""CaseLibrary: retain, revise, retire, restore; the rows are the truth, the audio lies beside them."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from threading import Event

from sqlalchemy import Engine, func, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session
from sqlalchemy.orm.exc import StaleDataError

from casebase import audit, leases
from casebase.artifacts import active_version, newest_version, similarity_for, similarity_kind, store_similarity
from casebase.audio_store import AudioStore, StoredBytes
from casebase.case_filter import CaseFilter, selected
from casebase.case_table import CaseTable, load_table
from casebase.database import WRITING, create_engine_for, sqlite_url, upgrade_database
from casebase.description import Labelling, RecordingDescription, check_choice, check_label
from casebase.detection_limit import NO_LIMITS, detection_limits
from casebase.diagnoses import get_diagnosis, labelling_from, store_diagnosis
from casebase.diagnosis import Reasoner
from casebase.errors import (
    ConflictError,
    DuplicateError,
    ErasedError,
    InvalidRequestError,
    NotFoundError,
    StaleVersionError,
)
from casebase.evaluation import Evaluation, evaluate
from casebase.experience import calibrated
from casebase.kept_table import name_table, outgrown, read_table, remove_others, write_table
from casebase.learning import LearningStoppedError, Similarity, learn
from casebase.models import (
    CASE_STATES,
    Artifact,
    AuditEntry,
    Case,
    LibraryCounter,
    StoredDiagnosis,
    StoredRecording,
    now,
)
from casebase.origins import MEASURED, SIMULATED, origin_of
from casebase.pages import Page, page
from casebase.plausibility import Expected, measured
from casebase.private import make_private
from casebase.recordings import DISCARDED, store_recording
from casebase.rehearsal import rehearsed
from casebase.severity import Severity, severity_of
from casebase.signals.features import EXTRACTOR_VERSION, Extraction
from casebase.signals.recording import Recording
from casebase.sounds import cases_of, other_gearbox

REVISABLE = ("label", "verified_by", "note", "mechanism", "location", "severity", "quarantine_reason", "state")


CHANGED = "library_changed"
TABLES = "tables"


class CaseLibrary:
    """The library over one database and one data folder.

    Every method that takes a session works inside the caller's transaction (`transaction`), so that several
    steps happen together or not at all.
    """

    def __init__(self, engine: Engine, data_dir: Path) -> None:
        self.engine = engine
        self.data_dir = data_dir
        self.audio = AudioStore(data_dir / "audio")
        self.touched = Event()
        """Set whenever cases changed or what was learned proved outgrown: then `keep_learned` may have work."""
        self.lease: str | None = None
        """Of the worker that this library is opened by: nothing is written once it has ended."""
        self._tables: dict[str, CaseTable] = {}
        self._reasoners: dict[str, tuple[int | None, Reasoner]] = {}
        self._measured: dict[str, tuple[int, Expected]] = {}

    @classmethod
    def open(cls, data_dir: Path, url: str | None = None) -> "CaseLibrary":
        """Open, and create or upgrade where needed; SQLite in the data folder unless a URL is given.

        Folder and files belong to their owner alone, as does whatever this process writes from then on.
        """
        os.umask(0o077)
        data_dir.mkdir(parents=True, exist_ok=True)
        make_private(data_dir)
        engine = create_engine_for(url or sqlite_url(data_dir / "gearcase.db"))
        upgrade_database(engine)
        return cls(engine, data_dir)

    @contextmanager
    def transaction(self, actor: str, request_id: str | None = None) -> Iterator[Session]:
        """Give a session that commits when the block ends well and rolls back when it does not.

        Raises:
            LeaseLostError: if it is a worker's library and the worker's lease has ended; nothing is written then.
        """
        with Session(self.engine, expire_on_commit=False) as session:
            session.info.update({audit.ACTOR: actor, audit.REQUEST: request_id})
            session.connection(execution_options={WRITING: True})
            try:
                yield session
                if self.lease is not None:
                    session.flush()
                    leases.hold(session, self.lease)
                session.commit()
                audit.stored(session.info.get(audit.RECORDED, ()))
                for sha256 in session.info.get(DISCARDED, ()):
                    self.audio.discard(sha256)
                if CHANGED in session.info:
                    self.touched.set()
            except StaleDataError as error:
                raise StaleVersionError("somebody changed it at the same time; read it again") from error

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Give a session for reading; it is rolled back."""
        with Session(self.engine, expire_on_commit=False) as session:
            yield session

    def close(self) -> None:
        """Give back the database connections."""
        self.engine.dispose()

    # -- recordings

    def store_recording(
        self,
        session: Session,
        source: Path | bytes | StoredBytes,
        recording: Recording,
        extraction: Extraction,
        description: RecordingDescription,
    ) -> StoredRecording:
        """Keep a recording: audio on disk first, then its rows. The same again is the one that is there.

        Args:
            source: the file as it came, bytes or path, or what `audio.put` of it has said already.
            recording: what was decoded from it.
            extraction: its features.
            description: how it was taken.
        """
        return store_recording(session, self.audio, source, recording, extraction, description)

    def recording(self, session: Session, recording_id: str) -> StoredRecording:
        """Return a recording; raises NotFoundError."""
        row = session.get(StoredRecording, recording_id)
        if row is None:
            raise NotFoundError(f"no recording has the id {recording_id!r}")
        return row

    def audio_path(self, row: StoredRecording) -> Path:
        """Return the file of a recording as it came in.

        Raises:
            ErasedError: if it was erased.
            NotFoundError: if it is missing.
            DamagedError: if its bytes are not those that came in.
        """
        if row.erased_at is not None:
            raise ErasedError(
                f"the audio of this recording was erased on {row.erased_at:%Y-%m-%d} by {row.erased_by}; its features, "
                "diagnoses and cases are still here"
            )
        return self.audio.whole(row.file_sha256)

    # -- cases

    def retain(
        self,
        session: Session,
        recording: StoredRecording,
        labelling: Labelling,
        *,
        diagnosis_id: str | None = None,
    ) -> Case:
        """Make a case of a recording. The same sound with the same label and gearbox is the case that is there.

        A simulated sound makes a simulated case, whoever brings it.

        Raises:
            DuplicateError: if the sound is a case already with another label or gearbox, or a retired one.
        """
        if origin_of(session, recording) == SIMULATED:
            labelling = replace(labelling, origin=SIMULATED)
        existing = self._existing(session, recording, labelling)
        if existing is not None:
            return existing
        fields = asdict(labelling) | {"parameters": dict(labelling.parameters)}
        case = Case(
            recording=recording,
            diagnosis_id=diagnosis_id,
            labelled_by=audit.actor_of(session),
            library_version=self.next_version(session),
            **fields,
        )
        session.add(case)
        session.flush()
        audit.record(session, "case.retained", ("case", case.id), after=_summary(case))
        return case

    def _existing(self, session: Session, recording: StoredRecording, labelling: Labelling) -> Case | None:
        if labelling.key is not None:
            case = session.scalars(select(Case).where(Case.key == labelling.key)).first()
            if case is not None:
                return case
        twins = cases_of(session, recording.sound_id)
        if labelling.key is not None:
            # what is generated is known by its key
            twins = [case for case in twins if case.recording_id == recording.id]
        for case in twins:
            agrees = (case.label, case.origin) == (labelling.label, labelling.origin)
            if agrees and case.state != "retired" and not other_gearbox(case.recording, recording):
                return case
        if not twins:
            return None
        case = min(twins, key=lambda each: each.state == "retired")
        box = case.recording.gearbox
        state = "" if case.state == "confirmed" else f", {case.state}"
        raise DuplicateError(
            f"this sound is case {case.id} already ({case.label}, gearbox {box or 'not given'}{state}); "
            "change that case if it is wrong",
            case_id=case.id,
            label=case.label,
            gearbox=box,
        )

    def case(self, session: Session, case_id: str) -> Case:
        """Return a case, retired ones too; raises NotFoundError."""
        row = session.get(Case, case_id)
        if row is None:
            raise NotFoundError(f"no case has the id {case_id!r}")
        return row

    def cases(self, session: Session, wanted: CaseFilter, *, limit: int = 50, cursor: str | None = None) -> Page[Case]:
        """Return a page of cases, newest first."""
        return page(session, selected(wanted), Case.id, limit=limit, cursor=cursor)

    def revise(
        self,
        session: Session,
        case_id: str,
        changes: Mapping[str, object],
        *,
        expected_version: int | None = None,
    ) -> Case:
        """Change label, verification, note, mechanism, location, severity, quarantine or state.

        Raises:
            StaleVersionError: if the case is not at the expected version.
            InvalidRequestError: if a field cannot be changed or its value is none of its values.
        """
        unknown = set(changes) - set(REVISABLE)
        if unknown:
            raise InvalidRequestError(f"cannot change {sorted(unknown)}; changeable are {', '.join(REVISABLE)}")
        if "label" in changes:
            check_label(str(changes["label"]))
        if "state" in changes:
            check_choice("state", str(changes["state"]), CASE_STATES)
        case = self.case(session, case_id)
        if expected_version is not None and case.version != expected_version:
            raise StaleVersionError(
                f"case {case_id} is at version {case.version}, not {expected_version}; read it again"
            )
        before = {name: getattr(case, name) for name in changes if getattr(case, name) != changes[name]}
        if before:
            case.library_version = self.next_version(session)
            for name in before:
                setattr(case, name, changes[name])
            case.updated_at = now()
            session.flush()
            after = {name: changes[name] for name in before}
            audit.record(session, "case.revised", ("case", case.id), before=before, after=after)
        return case

    def retire(self, session: Session, case_id: str, *, expected_version: int | None = None) -> Case:
        """Take a case out of every search; it stays readable and can come back."""
        return self.revise(session, case_id, {"state": "retired"}, expected_version=expected_version)

    def restore(self, session: Session, case_id: str, *, expected_version: int | None = None) -> Case:
        """Bring a retired case back; raises ConflictError if it is not retired."""
        if self.case(session, case_id).state != "retired":
            raise ConflictError(f"case {case_id} is not retired, so there is nothing to restore")
        return self.revise(session, case_id, {"state": "confirmed"}, expected_version=expected_version)

    def retain_diagnosis(
        self, session: Session, diagnosis_id: str, *, label: str | None = None, verified_by: str | None = None
    ) -> Case:
        """Make a case of a diagnosed recording, with the label it was revised to unless another is given."""
        row = get_diagnosis(session, diagnosis_id)
        labelling = labelling_from(row, label=label, verified_by=verified_by)
        return self.retain(session, row.recording, labelling, diagnosis_id=row.id)

    def history(self, session: Session, case_id: str) -> Sequence[AuditEntry]:
        """Return all that happened to a case, oldest first; raises NotFoundError."""
        return audit.history(session, "case", self.case(session, case_id).id)

    # -- reuse

    def reasoner(self, session: Session, extractor_version: str = EXTRACTOR_VERSION) -> Reasoner:
        """Return what diagnoses, for the library as it is now; the same one until something changes."""
        table = self.table(session, extractor_version)
        basis = active_version(session, extractor_version)
        kept = self._reasoners.get(extractor_version)
        if kept is not None and kept[1].table is table and kept[0] == basis:
            return kept[1]
        reasoner = Reasoner(table, *similarity_for(session, table))
        if CHANGED not in session.info:
            self._reasoners[extractor_version] = (basis, reasoner)
        return reasoner

    def keep_learned(
        self, actor: str, extractor_version: str = EXTRACTOR_VERSION, *, stop: Event | None = None
    ) -> bool:
        """Learn again if the library outgrew what was learned; return whether it did.

        Nothing is locked while it learns. If somebody else stores something newer meanwhile, that stays. It is given
        up, with nothing stored, when `stop` is set.
        """
        with self.reading() as session:
            table = self.table(session, extractor_version)
            kind = similarity_kind(extractor_version)
            newest, (_, _, outgrown) = newest_version(session, kind), similarity_for(session, table)
        if not outgrown:
            return False
        try:
            with self.reading() as session:
                learned = self._learned(session, table, stop)
            with self.transaction(actor) as session:
                store_similarity(session, learned, kind, after=newest)
        except (IntegrityError, LearningStoppedError):
            return False
        return True

    def _learned(self, session: Session, table: CaseTable, stop: Event | None = None) -> Similarity:
        """Learn weights, and from disturbed copies of the recordings how far an answer holds."""
        learned = learn(table, stop)
        if learned.score is None:
            return learned
        return calibrated(table, learned, rehearsed(session, self.audio, table, stop))

    def table(self, session: Session, extractor_version: str = EXTRACTOR_VERSION) -> CaseTable:
        """Return all cases that count as they are now, copies once; only what changed is read."""
        return self._all_cases(session, extractor_version).voters

    def _all_cases(self, session: Session, extractor_version: str) -> CaseTable:
        known = self._tables.get(extractor_version)
        if known is None:
            known = read_table(session, self.data_dir / TABLES, extractor_version)
        table = load_table(session, extractor_version, known)
        if CHANGED not in session.info:
            # what this session changed may yet be rolled back, and must not be remembered
            self._tables[extractor_version] = table
        return table

    def keep_table(self, actor: str, extractor_version: str = EXTRACTOR_VERSION) -> bool:
        """Write the table of a large library beside the database, where much changed; return whether it was written."""
        folder = self.data_dir / TABLES
        with self.reading() as session:
            table = self._all_cases(session, extractor_version)
            if not outgrown(session, folder, table):
                return False
        document = write_table(folder, table)
        with self.transaction(actor) as session:
            name_table(session, extractor_version, document)
        remove_others(folder, document)
        return True

    def measured(self, session: Session, axis: str) -> Expected:
        """Return what the measured cases of an axis say of its motion; read again when cases have changed."""
        version = self.version(session)
        kept = self._measured.get(axis)
        if kept is not None and kept[0] == version:
            return kept[1]
        found = measured(session, axis)
        if found != Expected() and CHANGED not in session.info:
            self._measured[axis] = (version, found)
        return found

    def diagnose(
        self,
        session: Session,
        recording: StoredRecording,
        extraction: Extraction,
        remarks: tuple[str, ...] = (),
    ) -> StoredDiagnosis:
        """Diagnose a stored recording by its features and keep the diagnosis, with what else is to be remarked.

        A case of the same sound is named, and has no vote.
        """
        version = extraction.extractor_version
        reasoner = self.reasoner(session, version)
        if reasoner.outgrown:
            self.touched.set()
        values = extraction.features.values
        diagnosis = reasoner.diagnose(extraction, reasoner.table.samples == recording.sound_id, recording.axis)
        same = [case for case in cases_of(session, recording.sound_id) if case.state != "retired"]
        told = (*(_told(case) for case in same), *diagnosis.remarks, *remarks, *self._contradictions(session, version))
        diagnosis = replace(diagnosis, remarks=told)
        axis, origin = recording.axis, origin_of(session, recording)
        severity = self.severity(session, extraction, axis, diagnosis.label, origin) if diagnosis.label else None
        limits = detection_limits(session, reasoner.table, axis, values, origin) if extraction.usable else NO_LIMITS
        same_as = same[0].id if same else None
        return store_diagnosis(session, recording, diagnosis, reasoner, severity, limits, same_as)

    def severity(
        self, session: Session, extraction: Extraction, axis: str | None, label: str, origin: str = MEASURED
    ) -> Severity | None:
        """Return the size of a fault, for a diagnosis as for `gearcase size`; None where the library cannot say it."""
        table = self.table(session, extraction.extractor_version)
        return severity_of(session, table, axis, label, extraction.features.values, origin)

    def _contradictions(self, session: Session, extractor_version: str) -> tuple[str, ...]:
        count = self._all_cases(session, extractor_version).contradicting
        words = f"{count} cases have no vote, for their sound is a case of another label too: see the review"
        return (words,) if count else ()

    def evaluate(self, session: Session, *, group: str = "gearbox", origin: str = "both") -> Evaluation:
        """Return the library's own cross-validation; see `casebase.evaluation.evaluate`."""
        table = self.table(session)
        learned, version, _ = similarity_for(session, table)
        return evaluate(table, group=group, origin=origin, learned=learned if version and learned.fits(table) else None)

    def learn(self, session: Session, extractor_version: str = EXTRACTOR_VERSION) -> Artifact:
        """Learn the weights again now and make them the active ones."""
        learned = self._learned(session, self.table(session, extractor_version))
        return store_similarity(session, learned, similarity_kind(extractor_version))

    def counts(self, session: Session) -> Mapping[tuple[str, str], int]:
        """Return how many searchable cases there are per label and origin."""
        statement = select(Case.label, Case.origin, func.count()).where(
            Case.state == "confirmed", Case.quarantine_reason.is_(None)
        )
        rows = session.execute(statement.group_by(Case.label, Case.origin)).all()
        return {(label, origin): count for label, origin, count in rows}

    def version(self, session: Session) -> int:
        """Return the counter that goes up with every change of the cases."""
        return session.scalars(select(LibraryCounter.value)).one()

    def next_version(self, session: Session) -> int:
        """Count up, so that every process sees at its next query that something changed; return the new count."""
        session.info[CHANGED] = True
        counter = update(LibraryCounter).values(value=LibraryCounter.value + 1)
        return session.scalars(counter.returning(LibraryCounter.value)).one()


def _told(case: Case) -> str:
    return f"this is case {case.id} ({case.label}, gearbox {case.recording.gearbox or 'not given'})"


def _summary(case: Case) -> dict[str, object]:
    return {
        "label": case.label,
        "origin": case.origin,
        "state": case.state,
        "recording_id": case.recording_id,
        "verified_by": case.verified_by,
        "key": case.key,
    }
