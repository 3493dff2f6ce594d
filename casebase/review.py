"""Care of the library: what is redundant, contradictory, suspect, far from reality or missing. Reports first.

All distances are those that diagnosis uses; a case is never held against its own gearbox or its own samples.
Edits are made on request, kept as an artifact and undone as a whole.

Sources: Smyth and McKenna, Competence models and the maintenance problem, Computational Intelligence 17 (2001), for
redundancy by coverage; Wilson, Asymptotic properties of nearest neighbor rules (1972), for suspect labels.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import func, select
from sqlalchemy.orm import Session

from casebase.artifacts import add_artifact
from casebase.diagnosis import Reasoner
from casebase.errors import InvalidRequestError, NotFoundError
from casebase.library import CaseLibrary
from casebase.models import Artifact, Case, StoredRecording
from casebase.similarity import Floats
from casebase.sounds import other_gearbox

KIND = "review"
LARGEST = 4000  # cases looked at; beyond, the newest
NEIGHBOURS, AGREEING = 5, 4
SAME = 0.25  # of the typical distance to the nearest case of the label: as good as the same case
FAR = 3.0  # times the typical distance between measured cases of a label, and farther than any: not the same world
FEWEST_MEASURED = 3  # cases of a label that say how far apart real ones are
FEWEST = 20  # simulated cases that a label should have at least
PER_CELL = 4  # cases for a range of payload and speed that has none
CELLS = 3  # payload and speed are looked at in so many ranges each


@dataclass(frozen=True)
class Finding:
    """One case to look at: what about it, in a sentence, and which case speaks against it."""

    case_id: str
    label: str
    origin: str
    reason: str
    other_id: str | None = None


@dataclass(frozen=True)
class Hole:
    """Operating conditions under which a label has no case, and how many would fill them.

    Args:
        payload_kg_m2, speed_rad_s: from where to where the cases should lie; None where it does not matter.
    """

    label: str
    reason: str
    cases: int
    payload_kg_m2: tuple[float, float] | None = None
    speed_rad_s: tuple[float, float] | None = None

    def campaign(self) -> dict[str, object]:
        """Return what `generate --plan` and `POST /simulations` take to fill it, beside the axis."""
        ranges = {"payload_kg_m2": self.payload_kg_m2, "speed_rad_s": self.speed_rad_s}
        return {"counts": {self.label: self.cases}, **{name: list(ends) for name, ends in ranges.items() if ends}}


@dataclass(frozen=True)
class Review:
    """What was found, worst first within each kind; `plan` is what `generate` and `POST /simulations` take."""

    cases: int
    redundant: tuple[Finding, ...]
    contradictory: tuple[Finding, ...]
    suspect: tuple[Finding, ...]
    far: tuple[Finding, ...]
    uncovered: tuple[Hole, ...]

    @property
    def plan(self) -> dict[str, int]:
        counts: Counter[str] = Counter()
        for hole in self.uncovered:
            counts[hole.label] += hole.cases
        return dict(counts)

    def to_document(self) -> dict[str, object]:
        """Return it as JSON."""
        campaigns = [hole.campaign() for hole in self.uncovered]
        return {**asdict(self), "plan": {"counts": self.plan, "campaigns": campaigns}}


def review(session: Session, reasoner: Reasoner) -> Review:
    """Look through the library; changes nothing."""
    contradicting, copies = _copies(session)
    table = reasoner.table
    rows = np.arange(len(table))[-LARGEST:]
    table = table.take(rows)
    if len(table) < 2:
        return Review(len(table), copies, contradicting, (), (), _holes(session))
    apart = _distances(reasoner, rows)
    foreign = (table.groups[:, None] != table.groups) & (table.samples[:, None] != table.samples)
    apart = np.where(foreign, apart, np.inf)
    same = table.labels[:, None] == table.labels
    own = np.where(same, apart, np.inf).min(axis=1)
    known = own[np.isfinite(own)]
    typical = float(np.median(known)) if known.size else math.inf
    order = np.argsort(apart, axis=1)[:, :NEIGHBOURS]

    def finding(row: int, reason: str, other: int | None = None) -> Finding:
        other_id = None if other is None else str(table.ids[other])
        return Finding(str(table.ids[row]), str(table.labels[row]), str(table.origins[row]), reason, other_id)

    contradictory, suspect, redundant = list(contradicting), [], list(copies)
    dropped: set[int] = set()
    for row in range(len(table)):
        near = [int(each) for each in order[row] if np.isfinite(apart[row, each])]
        if not near:
            continue
        first, labels = near[0], Counter(str(table.labels[each]) for each in near)
        if not same[row, first] and apart[row, first] < typical * SAME and row < first:
            reason = f"as good as the same recording as a case of {table.labels[first]}"
            contradictory.append(finding(row, reason, first))
        label, count = labels.most_common(1)[0]
        if label != table.labels[row] and len(near) == NEIGHBOURS and count >= AGREEING:
            suspect.append(finding(row, f"{count} of its {NEIGHBOURS} nearest cases are {label}", first))
        twin = row > first and first not in dropped and table.origins[row] == table.origins[first]
        if same[row, first] and twin and len(labels) == 1 and apart[row, first] < typical * SAME:
            dropped.add(row)
            redundant.append(finding(row, "adds nothing to a case that is there and agrees with all around", first))
    far = tuple(finding(row, reason) for row, reason in _far(table.labels, table.origins, apart))
    return Review(len(table), tuple(redundant), tuple(contradictory), tuple(suspect), far, _holes(session))


def _copies(session: Session) -> tuple[tuple[Finding, ...], tuple[Finding, ...]]:
    """Return every pair of cases of one sound that contradict each other, and the copies that do not."""
    searched = (Case.state == "confirmed") & Case.quarantine_reason.is_(None)
    own = select(StoredRecording.sound_id).join(Case, Case.recording_id == StoredRecording.id).where(searched)
    several = own.group_by(StoredRecording.sound_id).having(func.count() > 1)
    statement = select(Case).join(StoredRecording, StoredRecording.id == Case.recording_id)
    cases = session.scalars(statement.where(searched, StoredRecording.sound_id.in_(several)).order_by(Case.id)).all()
    contradicting, copies = [], []
    sounds: dict[str, list[Case]] = {}
    for case in cases:
        sounds.setdefault(case.recording.sound_id, []).append(case)
    for twins in sounds.values():
        agreeing: set[str] = set()
        for one, other in combinations(twins, 2):
            reasons = _contradictions(one, other)
            if reasons:
                contradicting.append(_finding(one, f"the same sound as a case of {' and of '.join(reasons)}", other))
            elif other.id not in agreeing:
                agreeing.add(other.id)
                copies.append(_finding(other, "the same sound as a case that is there: it counts once", one))
    return tuple(contradicting), tuple(copies)


def _contradictions(one: Case, other: Case) -> list[str]:
    reasons = [other.label] if one.label != other.label else []
    if other_gearbox(one.recording, other.recording):
        reasons.append(f"gearbox {other.recording.gearbox} (here {one.recording.gearbox})")
    return reasons


def _finding(case: Case, reason: str, other: Case) -> Finding:
    return Finding(case.id, case.label, case.origin, reason, other.id)


def _distances(reasoner: Reasoner, rows: NDArray[np.intp]) -> Floats:
    squares = [reasoner.matrix.squared_distances(reasoner.table.values[row])[rows] for row in rows]
    return np.asarray(np.sqrt(np.maximum(np.array(squares, dtype=np.float64), 0.0)))


def _far(labels: NDArray[np.str_], origins: NDArray[np.str_], apart: Floats) -> list[tuple[int, str]]:
    """Simulated cases that are far from every measured case of their label, where there are three or more."""
    out = []
    for label in sorted({str(each) for each in labels}):
        measured = np.flatnonzero((labels == label) & (origins == "measured"))
        simulated = np.flatnonzero((labels == label) & (origins == "simulated"))
        if measured.size < FEWEST_MEASURED or simulated.size == 0:
            continue
        among = apart[np.ix_(measured, measured)].min(axis=1)
        among = among[np.isfinite(among)]
        if among.size == 0:
            continue
        limit = max(FAR * float(np.median(among)), float(among.max()))
        nearest = apart[np.ix_(simulated, measured)].min(axis=1)
        for row, distance in sorted(zip(simulated, nearest, strict=True), key=lambda each: -each[1]):
            if math.isfinite(distance) and distance > limit:
                reason = f"its nearest measured case of {label} is {distance:.2f} away; those lie within {limit:.2f}"
                out.append((int(row), reason))
    return out


def _holes(session: Session) -> tuple[Hole, ...]:
    """Labels with few simulated cases, and ranges of payload and speed that measured cases have and they have not."""
    statement = select(Case.label, Case.origin, StoredRecording.payload_kg_m2, StoredRecording.speed_rad_s).join(
        StoredRecording, Case.recording_id == StoredRecording.id
    )
    statement = statement.where(Case.state == "confirmed", Case.quarantine_reason.is_(None))
    rows = session.execute(statement).all()
    holes = []
    cells = _cells([(payload, speed) for _, _, payload, speed in rows if payload and speed])
    for label in sorted({label for label, *_ in rows}):
        simulated = [(p, s) for each, origin, p, s in rows if each == label and origin == "simulated"]
        if len(simulated) < FEWEST:
            reason = f"{len(simulated)} simulated cases; {FEWEST} give the features their spread"
            holes.append(Hole(label, reason, FEWEST - len(simulated)))
        elif cells is not None:
            full = {_cell(cells, p, s) for p, s in simulated if p and s}
            wanted = {_cell(cells, p, s) for _, origin, p, s in rows if origin == "measured" and p and s}
            holes += [_empty(label, cells, cell) for cell in sorted(wanted - full)]
    return tuple(holes)


def _empty(label: str, edges: tuple[Floats, Floats], cell: tuple[int, int]) -> Hole:
    payload, speed = ((float(ends[i]), float(ends[i + 1])) for ends, i in zip(edges, cell, strict=True))
    reason = (
        f"measured cases, but no simulated one, at {payload[0]:.3g} to {payload[1]:.3g} kg m2 "
        f"and {speed[0]:.3g} to {speed[1]:.3g} rad/s"
    )
    return Hole(label, reason, PER_CELL, payload, speed)


def _cells(points: Sequence[tuple[float, float]]) -> tuple[Floats, Floats] | None:
    """Return the edges of the ranges of payload and of speed, outermost included, shape (CELLS + 1,) each."""
    if len(points) < 2:
        return None
    both = np.array(points)
    low, high = both.min(axis=0), both.max(axis=0)
    edges = [np.linspace(a, b, CELLS + 1) for a, b in zip(low, high, strict=True)]
    return edges[0], edges[1]


def _cell(edges: tuple[Floats, Floats], payload: float, speed: float) -> tuple[int, int]:
    return int(np.searchsorted(edges[0][1:-1], payload)), int(np.searchsorted(edges[1][1:-1], speed))


def apply(library: CaseLibrary, session: Session, found: Review, kind: str) -> Artifact:
    """Retire redundant cases (`kind` redundant) or quarantine far ones (far); undone by `undo` with its version.

    Raises InvalidRequestError where there is nothing of that kind to do.
    """
    findings = {"redundant": found.redundant, "far": found.far}.get(kind)
    if findings is None:
        raise InvalidRequestError(f"edits are 'redundant' (retired) or 'far' (quarantined), got {kind!r}")
    if not findings:
        raise InvalidRequestError(f"the review found nothing {kind}: there is nothing to change")
    edits = []
    for each in findings:
        case = library.case(session, each.case_id)
        before: dict[str, object] = {"state": case.state, "quarantine_reason": case.quarantine_reason}
        change: dict[str, object] = {"state": "retired"} if kind == "redundant" else {"quarantine_reason": each.reason}
        library.revise(session, each.case_id, change)
        edits.append({"case_id": each.case_id, "before": before})
    return add_artifact(session, KIND, {"kind": kind, "edits": edits}, score_detail={"edits": len(edits)})


def quarantine_far(library: CaseLibrary, actor: str) -> int:
    """Quarantine simulated cases that are far from every measured case of their label; return how many those were.

    Does nothing where no label has simulated cases and three measured ones to hold them against.
    """
    with library.reading() as session:
        counts = library.counts(session)
        if not any(
            counts.get((label, "simulated")) and count >= FEWEST_MEASURED
            for (label, origin), count in counts.items()
            if origin == "measured"
        ):
            return 0
        found = review(session, library.reasoner(session))
    if found.far:
        with library.transaction(actor) as session:
            apply(library, session, found, "far")
    return len(found.far)


def undo(library: CaseLibrary, session: Session, version: int) -> int:
    """Take back the edits of a version; how many cases that were. Raises NotFoundError."""
    row = session.get(Artifact, (KIND, version))
    if row is None:
        raise NotFoundError(f"no edit of a review has the version {version}")
    edits = row.content["edits"]
    assert isinstance(edits, list)
    for edit in edits:
        library.revise(session, edit["case_id"], edit["before"])
    return len(edits)
