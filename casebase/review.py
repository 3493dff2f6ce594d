"""Care of the library: what is redundant, contradictory, suspect, far from reality or missing. Reports first.

All distances are those that diagnosis uses; a case is never held against its own gearbox or its own samples.
Edits are made on request, kept as an artifact and undone as a whole.

Sources: Smyth and McKenna, Competence models and the maintenance problem, Computational Intelligence 17 (2001), for
competence, coverage, footprint and redundancy; Wilson, Asymptotic properties of nearest neighbor rules (1972), for
suspect labels.
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

from casebase.errors import InvalidRequestError, NotFoundError
from casebase.library import CaseLibrary
from casebase.reasoning.diagnosis import Reasoner
from casebase.reasoning.novelty import spread_out
from casebase.search.case_table import CaseTable, numbered
from casebase.search.similarity import Floats
from casebase.sounds import other_gearbox
from casebase.store.artifacts import add_artifact
from casebase.store.models import Artifact, Case, StoredRecording

KIND = "review"
MOST_ASKED, NEWEST = 10_000, 4_000  # cases looked at while somebody waits, the newest among them
CHUNK = 4_096  # cases held against the library together
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
class Competence:
    """How much the library knows by itself.

    Args:
        solved: cases that a case of another gearbox solves, of those that were looked at.
        of: how many were looked at.
        footprint: how few cases solve as many as all of them; see `competence`.
    """

    solved: int
    of: int
    footprint: int


@dataclass(frozen=True)
class Review:
    """What was found, worst first within each kind; `plan` is what `generate` and `POST /simulations` take.

    Args:
        cases: in the library.
        looked_at: how many of them were held against all.
    """

    cases: int
    looked_at: int
    redundant: tuple[Finding, ...]
    contradictory: tuple[Finding, ...]
    suspect: tuple[Finding, ...]
    far: tuple[Finding, ...]
    uncovered: tuple[Hole, ...]
    competence: Competence

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


def review(session: Session, reasoner: Reasoner, most: int | None = MOST_ASKED) -> Review:
    """Look through the library; changes nothing.

    Every case is held against all others: as many searches as there are cases, so the cost grows with their square.

    Args:
        most: how many cases are looked at, at most: the NEWEST, and others evenly spread; None for all. What they are
            held against is the whole library all the same.
    """
    contradicting, copies = _copies(session)
    table = reasoner.table
    holes = _holes(session)
    if len(table) < 2:
        return Review(len(table), len(table), copies, contradicting, (), (), holes, Competence(0, 0, len(table)))
    near = _nearby(reasoner, _asked(len(table), most))
    typical = float(np.median(near.own[np.isfinite(near.own)])) if np.isfinite(near.own).any() else math.inf

    def finding(row: int, reason: str, other: int | None = None) -> Finding:
        other_id = None if other is None else str(table.ids[other])
        return Finding(str(table.ids[row]), str(table.labels[row]), str(table.origins[row]), reason, other_id)

    contradictory, suspect, redundant = list(contradicting), [], list(copies)
    dropped: set[int] = set()
    looked_at = set(near.asked.tolist())
    for place, row in enumerate(near.asked.tolist()):
        found = near.rows[place][near.rows[place] >= 0].tolist()
        if not found:
            continue
        first, labels = found[0], Counter(str(table.labels[each]) for each in found)
        same, close = table.labels[first] == table.labels[row], near.distances[place, 0] < typical * SAME
        if not same and close and (row < first or first not in looked_at):
            reason = f"as good as the same recording as a case of {table.labels[first]}"
            contradictory.append(finding(row, reason, first))
        label, count = labels.most_common(1)[0]
        if label != table.labels[row] and len(found) == NEIGHBOURS and count >= AGREEING:
            suspect.append(finding(row, f"{count} of its {NEIGHBOURS} nearest cases are {label}", first))
        twin = row > first and first not in dropped and table.origins[row] == table.origins[first]
        if same and close and twin and len(labels) == 1:
            dropped.add(row)
            redundant.append(finding(row, "adds nothing to a case that is there and agrees with all around", first))
    far = tuple(finding(row, reason) for row, reason in _far(table, near))
    found_all = tuple(redundant), tuple(contradictory), tuple(suspect), far
    return Review(len(table), near.asked.size, *found_all, holes, competence(table.class_numbers, near))


def _asked(count: int, most: int | None) -> NDArray[np.intp]:
    """Return the rows to look at, in order."""
    if most is None or count <= most:
        return np.arange(count)
    older = max(0, count - NEWEST)
    return np.concatenate([spread_out(np.arange(older), most - NEWEST), np.arange(older, count)])


@dataclass(frozen=True, eq=False)
class Nearby:
    """The nearest cases to some cases, of other gearboxes and sounds.

    Args:
        asked: the rows that were looked at, ascending, shape (asked,).
        rows, distances: the nearest of all, shape (asked, NEIGHBOURS), -1 and infinite where there are fewer.
        own: distance to the nearest case of the same label, shape (asked,).
        measured: distance to the nearest measured case of the same label, shape (asked,).
    """

    asked: NDArray[np.intp]
    rows: NDArray[np.int64]
    distances: Floats
    own: Floats
    measured: Floats


def _nearby(reasoner: Reasoner, asked: NDArray[np.intp]) -> Nearby:
    table, count = reasoner.table, 2 * len(reasoner.table.classes)
    groups = (2 * table.class_numbers + (table.origins == "measured")).astype(np.int16)
    boxes = numbered(table.groups)
    rows = np.full((asked.size, NEIGHBOURS), -1, np.int64)
    distances = np.full(rows.shape, np.inf)
    own, measured = np.full(asked.size, np.inf), np.full(asked.size, np.inf)
    for start in range(0, asked.size, CHUNK):
        part = slice(start, start + CHUNK)
        these = asked[part]
        kin = [(boxes, boxes[these]), (table.sounds, table.sounds[these])]
        found, apart = reasoner.matrix.nearest_strangers(table.values[these], groups, count, NEIGHBOURS, kin)
        labels = 2 * table.class_numbers[these]
        measured[part] = apart[np.arange(these.size), labels + 1, 0]
        own[part] = np.minimum(apart[np.arange(these.size), labels, 0], measured[part])
        flat, far = found.reshape(these.size, -1), apart.reshape(these.size, -1)
        order = np.lexsort((flat, far))[:, :NEIGHBOURS]
        rows[part], distances[part] = (np.take_along_axis(each, order, axis=1) for each in (flat, far))
    return Nearby(asked, rows, distances, own, measured)


def competence(labels: NDArray[np.int16], near: Nearby) -> Competence:
    """Return what the library can do by itself, from its NEIGHBOURS nearest cases.

    A case solves another one of its label that is nearer to it than to any case of another label: that is its coverage.
    The footprint is built of the cases in order of their relative coverage, each case solved counting the less the more
    cases solve it; a case is left out if one in the footprint solves it.

    Args:
        labels: numbers of the labels of all cases, shape (cases,).
    """
    agree = (near.rows >= 0) & (labels[near.rows] == labels[near.asked][:, None])
    solving = np.logical_and.accumulate(agree, axis=1)
    solved = solving.sum(axis=1)
    share = np.repeat(1 / np.maximum(solved, 1), solved)
    coverage = np.bincount(near.rows[solving], weights=share, minlength=labels.size)[near.asked]
    kept, footprint = np.zeros(labels.size, np.bool_), 0
    for place in np.argsort(-coverage, kind="stable").tolist():
        if not kept[near.rows[place, : solved[place]]].any():
            kept[near.asked[place]] = True
            footprint += 1
    return Competence(int(np.count_nonzero(solved)), int(near.asked.size), footprint)


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


def _far(table: CaseTable, near: Nearby) -> list[tuple[int, str]]:
    """Simulated cases that are far from every measured case of their label, where their axis has three or more."""
    out = []
    kinds = sorted(set(zip(table.class_numbers.tolist(), table.axes.tolist(), strict=True)))
    labels, axes = table.class_numbers[near.asked], table.axes[near.asked]
    simulated = table.origins[near.asked] == "simulated"
    for number, axis in kinds:
        label, here = table.classes[number], (labels == number) & (axes == axis)
        known = (table.class_numbers == number) & (table.axes == axis) & (table.origins == "measured")
        among = near.measured[here & ~simulated]
        among = among[np.isfinite(among)]
        if np.count_nonzero(known) < FEWEST_MEASURED or among.size == 0:
            continue
        limit = max(FAR * float(np.median(among)), float(among.max()))
        these = np.flatnonzero(here & simulated & np.isfinite(near.measured) & (near.measured > limit))
        for place in these[np.argsort(-near.measured[these], kind="stable")].tolist():
            distance = near.measured[place]
            reason = f"its nearest measured case of {label} is {distance:.2f} away; those lie within {limit:.2f}"
            out.append((int(near.asked[place]), reason))
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
        case = library.retrieve.case(session, each.case_id)
        before: dict[str, object] = {"state": case.state, "quarantine_reason": case.quarantine_reason}
        change: dict[str, object] = {"state": "retired"} if kind == "redundant" else {"quarantine_reason": each.reason}
        library.revise.case(session, each.case_id, change)
        edits.append({"case_id": each.case_id, "before": before})
    return add_artifact(session, KIND, {"kind": kind, "edits": edits}, score_detail={"edits": len(edits)})


def quarantine_far(library: CaseLibrary, actor: str) -> int:
    """Quarantine simulated cases that are far from every measured case of their label; return how many those were.

    Does nothing where no label has simulated cases and three measured ones to hold them against.
    """
    with library.reading() as session:
        counts = library.retrieve.counts(session)
        if not any(
            counts.get((label, "simulated")) and count >= FEWEST_MEASURED
            for (label, origin), count in counts.items()
            if origin == "measured"
        ):
            return 0
        found = review(session, library.reuse.reasoner(session))
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
        library.revise.case(session, edit["case_id"], edit["before"])
    return len(edits)
