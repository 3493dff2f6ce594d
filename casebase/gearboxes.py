"""Gearboxes in service: what was heard of each, what was done to it, and where its history begins and ends.

A gearbox is known by its axis and its name. An exchange ends the history of the one that was there; the next one
begins with it, under the same name or another. A microphone that was moved ends the trend alone, for the gearbox is the
same.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Select, and_, case, exists, false, func, null, or_, select
from sqlalchemy.orm import Session, aliased

from casebase.labels import BASELINES
from casebase.origins import MEASURED, SIMULATED, demonstrations, is_measured, is_retired
from casebase.store.models import AxisRevision, Case, MaintenanceMark, StoredDiagnosis, StoredRecording

NOTE, REPAIR, EXCHANGE, MICROPHONE = "note", "repair", "exchange", "microphone"
KINDS = (NOTE, REPAIR, EXCHANGE, MICROPHONE)
REJECTED, OPEN = "rejected", "open"
Place = tuple[str | None, str | None]
"""Name of the axis, and of the gearbox as recordings give it; None where they give none, of one of the two alone."""
HEARD_AT: ColumnElement[datetime] = case(
    (StoredRecording.recorded_at <= StoredRecording.created_at, StoredRecording.recorded_at),
    else_=StoredRecording.created_at,
)
"""When a recording was taken; when it came where nobody said so, or the recorder's clock was ahead."""


@dataclass(frozen=True)
class GearboxRecording:
    """A recording of a gearbox, and the newest that was said of it.

    Args:
        at: see `HEARD_AT`.
        verdict: of its diagnosis; None where there is none.
        label: the diagnosis' or, where a person said one, that.
        review: what a person made of the diagnosis; `confirmed` where a person labelled the recording as a case.
        fault: whether an `ambiguous` diagnosis says that there is a fault; None of a recording that is too poor for it.
        left: the faults that it cannot exclude, where it says that there is one.
        timed: whether it is known when it was recorded; what is diagnosed counts as recorded when it came.
        by: who labelled or reviewed it.
        judged_at: when.
    """

    recording_id: str
    at: datetime
    file_name: str
    usable: bool
    speed_rad_s: float | None
    payload_kg_m2: float | None
    timed: bool = True
    verdict: str | None = None
    label: str | None = None
    probability: float | None = None
    review: str = OPEN
    diagnosis_id: str | None = None
    fault: bool | None = None
    left: tuple[str, ...] = ()
    by: str = ""
    judged_at: datetime | None = None

    @property
    def taught(self) -> bool:
        """Whether it came as a case of the library, and was never diagnosed."""
        return self.review != OPEN and self.diagnosis_id is None


@dataclass(frozen=True)
class Done:
    """Something that was done to a gearbox."""

    mark_id: str
    at: datetime
    kind: str
    text: str
    by: str
    gearbox: str | None
    successor: str | None


@dataclass(frozen=True)
class History:
    """A gearbox from when it was put in until it was exchanged.

    Args:
        number: counts the gearboxes that had this name at this axis, from 1.
        since, until: of the exchanges; None where there was none.
        heard: oldest first.
        done: oldest first, the exchanges at both ends included.
    """

    axis: str | None
    gearbox: str | None
    number: int
    since: datetime | None
    until: datetime | None
    heard: tuple[GearboxRecording, ...]
    done: tuple[Done, ...]

    @property
    def renewed(self) -> datetime | None:
        """When it was put in or repaired last: what was heard before says nothing of it now."""
        times = [each.at for each in self.done if each.kind == REPAIR]
        return max([*times, *([self.since] if self.since else [])], default=None)

    @property
    def since_renewed(self) -> tuple[GearboxRecording, ...]:
        """What was heard since."""
        renewed = self.renewed
        return self.heard if renewed is None else tuple(one for one in self.heard if one.at >= renewed)

    @property
    def comparable(self) -> tuple[GearboxRecording, ...]:
        """What was heard since, from where the microphone stands now."""
        moved = max((each.at for each in self.done if each.kind == MICROPHONE), default=None)
        return tuple(one for one in self.since_renewed if moved is None or one.at >= moved)


def histories(session: Session, axis: str | None, gearbox: str | None) -> list[History]:
    """Return the gearboxes that had this name at this axis, oldest first; see `histories_of`."""
    return histories_of(session, [(axis, gearbox)])[axis, gearbox]


def histories_of(session: Session, places: Sequence[Place]) -> dict[Place, list[History]]:
    """Return for each place the gearboxes that were in it, oldest first.

    The last one is in service if its history has no end. An exchange with a successor of another name leaves nothing
    under the old one, unless it is heard again.
    """
    done = _done(session, {axis for axis, _ in places if axis is not None})
    heard = _heard(session, places)
    return {place: _histories(place, heard.get(place, []), done.get(place[0] or "", [])) for place in places}


def _histories(place: Place, heard: Sequence[GearboxRecording], done: Sequence[Done]) -> list[History]:
    axis, gearbox = place
    edges = sorted({each.at for each in done if _ends(each, gearbox) or _begins(each, gearbox)})
    found: list[History] = []
    for since, until in zip([None, *edges], [*edges, None], strict=True):
        here = tuple(one for one in heard if _within(one.at, since, until))
        if here or any(_begins(each, gearbox) and each.at == since for each in done):
            told = tuple(
                each
                for each in done
                if (each.gearbox in (None, gearbox) or _begins(each, gearbox))
                and (_within(each.at, since, until) or each.at == until)
            )
            found.append(History(axis, gearbox, len(found) + 1, since, until, here, told))
    return found


def _begins(mark: Done, gearbox: str | None) -> bool:
    return _ends(mark, gearbox) if mark.successor is None else mark.kind == EXCHANGE and mark.successor == gearbox


def _ends(mark: Done, gearbox: str | None) -> bool:
    return mark.kind == EXCHANGE and mark.gearbox in (None, gearbox)


def _within(at: datetime, since: datetime | None, until: datetime | None) -> bool:
    return (since is None or at >= since) and (until is None or at < until)


def _heard(session: Session, places: Sequence[Place]) -> dict[Place, list[GearboxRecording]]:
    recordings = session.execute(
        select(
            StoredRecording.axis,
            StoredRecording.gearbox,
            StoredRecording.id,
            HEARD_AT,
            StoredRecording.file_name,
            StoredRecording.usable,
            StoredRecording.speed_rad_s,
            StoredRecording.payload_kg_m2,
            func.coalesce(StoredRecording.recorded_at <= StoredRecording.created_at, false()),
        ).where(of_places(places), ~is_retired(), *is_measured(session))
    ).all()
    said = _said(session, places, {row[2]: GearboxRecording(*row[2:]) for row in recordings})
    found: dict[Place, list[GearboxRecording]] = {}
    for axis, gearbox, identity, *_ in recordings:
        found.setdefault((axis, gearbox), []).append(said[identity])
    return {place: sorted(heard, key=lambda one: (one.at, one.recording_id)) for place, heard in found.items()}


def _said(session: Session, places: Sequence[Place], heard: dict[str, GearboxRecording]) -> dict[str, GearboxRecording]:
    """Add to recordings, by id, what their diagnoses and their cases say."""
    cases = session.execute(
        select(Case.recording_id, Case.label, Case.labelled_by, Case.created_at)
        .join(StoredRecording, StoredRecording.id == Case.recording_id)
        .where(of_places(places), Case.origin == MEASURED, Case.state == "confirmed", Case.diagnosis_id.is_(None))
    )
    for recording_id, known, by, at in cases:
        if recording_id in heard:
            heard[recording_id] = replace(
                heard[recording_id], verdict="diagnosed", label=known, review="confirmed", by=by, judged_at=at
            )
    undecided = (
        case((StoredDiagnosis.verdict == "ambiguous", StoredDiagnosis.document[name]), else_=null())  # it is long
        for name in ("fault", "labels", "quality")
    )
    given = session.execute(
        select(
            StoredDiagnosis.recording_id,
            StoredDiagnosis.id,
            StoredDiagnosis.verdict,
            StoredDiagnosis.label,
            StoredDiagnosis.probability,
            StoredDiagnosis.state,
            StoredDiagnosis.revised_label,
            StoredDiagnosis.revised_by,
            StoredDiagnosis.revised_at,
            *undecided,
        )
        .join(StoredRecording, StoredRecording.id == StoredDiagnosis.recording_id)
        .where(of_places(places))
        .order_by(StoredDiagnosis.id)
    )
    for recording_id, identity, verdict, label, probability, state, revised, by, at, fault, labels, quality in given:
        if recording_id in heard and not (state == OPEN and heard[recording_id].review == "confirmed"):
            present = None if revised or fault is None or is_too_poor(quality or (), fault) else fault["present"]
            left = tuple(each for each in labels or () if each not in BASELINES) or (label,)
            heard[recording_id] = replace(
                heard[recording_id],
                verdict="diagnosed" if revised else verdict,
                label=revised or label,
                probability=probability,
                review=state,
                diagnosis_id=identity,
                fault=present,
                left=left if present else (),
                timed=True,
                by=by or "",
                judged_at=at,
            )
    return heard


def is_too_poor(quality: Iterable[Mapping[str, Any]], fault: Mapping[str, Any]) -> bool:
    """Whether a recording is too poor to tell if there is a fault; that there is one a short recording tells, too."""
    poor = (flag["name"] for flag in quality if flag["severity"] == "poor")
    return any(not (fault["present"] and name.startswith("too_short")) for name in poor)


def gearbox_names(session: Session, axis: str | None = None, holding: str = "", most: int = 200) -> Sequence[str]:
    """Return names of gearboxes of an axis, or of all, that hold a text, the last recorded first; of none simulated."""
    real = StoredRecording.gearbox.is_not(None), StoredRecording.gearbox.not_like(f"{SIMULATED}-%")
    recorded = *real, StoredRecording.gearbox.icontains(holding, autoescape=True)
    wanted = select(StoredRecording.gearbox).where(*recorded, *([] if axis is None else [StoredRecording.axis == axis]))
    newest = wanted.group_by(StoredRecording.gearbox).order_by(func.max(StoredRecording.id).desc())
    return [str(name) for name in session.scalars(newest.limit(most))]


def is_gearbox(session: Session, axis: str | None, gearbox: str) -> bool:
    """Whether a gearbox is known at an axis, or at any: recorded, or put in for another."""
    recorded = exists().where(StoredRecording.gearbox == gearbox, *([StoredRecording.axis == axis] if axis else []))
    put_in = exists().where(MaintenanceMark.successor == gearbox, *([MaintenanceMark.axis == axis] if axis else []))
    return bool(session.scalar(select(or_(recorded, put_in))))


def of_places(places: Sequence[Place]) -> ColumnElement[bool]:
    """Return the condition that leaves the recordings of some gearboxes."""
    return or_(
        false(), *(and_(StoredRecording.axis == axis, StoredRecording.gearbox == gearbox) for axis, gearbox in places)
    )


def _done(session: Session, axes: Collection[str]) -> dict[str, list[Done]]:
    rows = session.scalars(
        select(MaintenanceMark).where(MaintenanceMark.axis.in_(axes)).order_by(MaintenanceMark.at, MaintenanceMark.id)
    )
    found: dict[str, list[Done]] = {}
    for row in rows:
        each = Done(row.id, row.at, row.kind, row.text, row.created_by, row.gearbox, row.successor)
        found.setdefault(row.axis, []).append(each)
    return found


def places_of(session: Session, mark: MaintenanceMark) -> list[Place]:
    """Return the gearboxes that a mark is of: one and its successor, or all that the axis was heard with."""
    if mark.gearbox is not None:
        return [(mark.axis, name) for name in {mark.gearbox, mark.successor or mark.gearbox}]
    names = session.scalars(select(StoredRecording.gearbox).where(StoredRecording.axis == mark.axis).distinct())
    return [(mark.axis, name) for name in names]


def signatures(
    session: Session, axis: str | None = None, gearbox: str | None = None
) -> dict[Place, tuple[object, ...]]:
    """Return for every gearbox that was recorded or put in what changes when anything is added to or changed of it.

    Args:
        axis: only its gearboxes; those of all axes where None.
        gearbox: only this one of the axis; all of it where None.
    """
    place = (StoredRecording.axis, StoredRecording.gearbox)
    wanted = [] if axis is None else [StoredRecording.axis == axis]
    wanted += [] if gearbox is None else [StoredRecording.gearbox == gearbox]
    shown = tuple(demonstrations(session))
    found: dict[Place, tuple[object, ...]] = {}
    # whether a recording counts as heard hangs on cases: its own are counted below, those of the same sound here
    recorded = select(*place, func.count(), func.max(StoredRecording.id)).where(*wanted).group_by(*place)
    for here, gearbox_here, *told in session.execute(recorded):
        if (here, gearbox_here) != (None, None):
            found[here, gearbox_here] = (*told, *shown)
    changes = [
        select(*place, func.count(), func.sum(row.version)).join(row.recording).where(*wanted).group_by(*place)
        for row in (StoredDiagnosis, Case)
    ]
    for number, statement in enumerate((*changes, _simulated_elsewhere(wanted))):
        for here, gearbox_here, *told in session.execute(statement):
            if (here, gearbox_here) in found:
                found[here, gearbox_here] += (number, *told)
    marks = select(MaintenanceMark).order_by(MaintenanceMark.id)
    of_axis: dict[str, list[str]] = {}
    for mark in session.scalars(marks if axis is None else marks.where(MaintenanceMark.axis == axis)):
        of_axis.setdefault(mark.axis, []).append(mark.id)
        if mark.successor is not None and gearbox in (None, mark.successor):
            found.setdefault((mark.axis, mark.successor), ())
    return {(here, name): (*told, *of_axis.get(here or "", ())) for (here, name), told in found.items()}


def _simulated_elsewhere(wanted: Sequence[ColumnElement[bool]]) -> Select[Any]:
    """Select how many recordings of each gearbox have the sound of a simulated case that is another recording's."""
    made = aliased(StoredRecording)
    columns: tuple[Any, ...] = (StoredRecording.axis, StoredRecording.gearbox, func.count())
    return (
        select(*columns)
        .join(made, and_(made.sound_id == StoredRecording.sound_id, made.id != StoredRecording.id))
        .join(Case, Case.recording_id == made.id)
        .where(Case.origin == SIMULATED, made.sound_id != "", *wanted)
        .group_by(StoredRecording.axis, StoredRecording.gearbox)
    )


def described(session: Session, axis: str | None = None) -> Mapping[str, int]:
    """Return the axes that are described, with their current revision; one alone, or all."""
    newest = select(AxisRevision.name, func.max(AxisRevision.revision)).group_by(AxisRevision.name)
    if axis is not None:
        newest = newest.where(AxisRevision.name == axis)
    return {name: revision for name, revision in session.execute(newest.order_by(AxisRevision.name))}  # noqa: C416
