"""Rules: made and removed by admins, and held against the state of a gearbox whenever that may have changed.

A rule is told when it begins to hold of a gearbox, and again only after it has ceased to hold in between.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from casebase.alarms import outbox
from casebase.alarms.state import State, state_of, states_of
from casebase.description import check_choice
from casebase.errors import InvalidRequestError, NotFoundError
from casebase.gearboxes import GearboxRecording, History, Place
from casebase.labels import BASELINES
from casebase.store import audit
from casebase.store.models import ALARM_KINDS, Alarm, AlarmReceiver, AlarmRule, now


@dataclass(frozen=True)
class Condition:
    """What a rule asks: of the state of a gearbox, or how long it has been silent.

    Args:
        kind: `state`, `change` or `silence`.
        axis, gearbox: of which; of any where None.
        verdict: of the newest diagnosis; where None or `diagnosed` it is the fault that stands.
        label: the fault; any where None. Only of what is diagnosed, like the next two.
        least_probability, least_size_rad: no less than this; a size that is not known is less.
        silent_days: no recording for so long [d].

    Raises:
        InvalidRequestError: if it asks what does not go with its kind.
    """

    kind: str
    axis: str | None = None
    gearbox: str | None = None
    verdict: str | None = None
    label: str | None = None
    least_probability: float | None = None
    least_size_rad: float | None = None
    silent_days: float | None = None

    def __post_init__(self) -> None:
        check_choice("kind", self.kind, ALARM_KINDS)
        of_fault = (self.label, self.least_probability, self.least_size_rad)
        if self.kind == "silence" and (self.silent_days is None or self.verdict or any(of_fault)):
            raise InvalidRequestError("a rule of silence needs `silent_days`, and neither verdict nor fault")
        if self.kind != "silence" and self.silent_days is not None:
            raise InvalidRequestError("`silent_days` goes with the kind `silence`; make another rule for it")
        if self.kind == "change" and (self.verdict or any(of_fault)):
            raise InvalidRequestError("a rule of change has neither verdict nor fault: the trend names none")
        if self.verdict not in (None, "diagnosed") and any(of_fault):
            raise InvalidRequestError("label, probability and size go with the verdict `diagnosed` alone")
        if self.label in BASELINES:
            raise InvalidRequestError(f"{self.label!r} is no fault; leave the label empty for any fault")


def add_rule(session: Session, name: str, condition: Condition, receivers: Sequence[str]) -> AlarmRule:
    """Make a rule; where it holds already is found when all gearboxes are looked at next.

    Raises:
        InvalidRequestError: if it has no receiver, or one that is not there.
    """
    known = set(session.scalars(select(AlarmReceiver.id).where(AlarmReceiver.id.in_(receivers))))
    if not receivers or not known.issuperset(receivers):
        raise InvalidRequestError("a rule needs receivers that are there: make one first, then name it")
    asked = asdict(condition)
    row = AlarmRule(name=name, receivers=sorted(known), created_by=audit.actor_of(session), **asked)
    session.add(row)
    session.flush()
    audit.record(session, "rule.created", ("rule", row.id), after={"name": name, **asked})
    return row


def remove_rule(session: Session, rule_id: str) -> None:
    """Remove a rule and its alarms; what is in the outbox is still sent. Raises NotFoundError."""
    row = session.get(AlarmRule, rule_id)
    if row is None:
        raise NotFoundError(f"no rule has the id {rule_id!r}")
    audit.record(session, "rule.removed", ("rule", row.id), before={"name": row.name})
    session.delete(row)


def list_rules(session: Session) -> Sequence[AlarmRule]:
    """Return all rules, oldest first."""
    return session.scalars(select(AlarmRule).order_by(AlarmRule.id)).all()


def standing(session: Session) -> Sequence[Alarm]:
    """Return the alarms that stand, the newest first."""
    return session.scalars(select(Alarm).where(Alarm.ended_at.is_(None)).order_by(Alarm.id.desc())).all()


def review(
    session: Session, axis: str | None, gearbox: str | None, changed: Mapping[Place, datetime] | None = None
) -> None:
    """Hold all rules against a gearbox of which something new is known, and put into the outbox what is to be told.

    Args:
        changed: since when gearboxes sound otherwise than they did; rules of change stay as they are where None.
    """
    if axis is None and gearbox is None:
        return
    of_it = select(AlarmRule).where(
        AlarmRule.kind.in_(ALARM_KINDS if changed is not None else ("state", "silence")),
        or_(AlarmRule.axis.is_(None), AlarmRule.axis == axis),
        or_(AlarmRule.gearbox.is_(None), AlarmRule.gearbox == gearbox),
    )
    rules = session.scalars(of_it).all()
    state = state_of(session, axis, gearbox) if rules else None
    for rule in rules:
        _settle(session, rule, (axis, gearbox), matched(rule, state, (changed or {}).get((axis, gearbox))))


def unsettled(session: Session, serving: Iterable[History], changed: Mapping[Place, datetime]) -> list[Place]:
    """Return the gearboxes of which the alarms do not say what is known: those that `review` has something to do for.

    Args:
        serving: all gearboxes in service.
        changed: as `review` takes it.
    """
    rules = list_rules(session)
    states = {(each.axis, each.gearbox): each for each in (states_of(session, list(serving)) if rules else ())}
    meant = {
        (rule.id, axis or "", gearbox or "")
        for axis, gearbox in {**states, **changed}
        for rule in rules
        if rule.axis in (None, axis)
        and rule.gearbox in (None, gearbox)
        and matched(rule, states.get((axis, gearbox)), changed.get((axis, gearbox)))
    }
    told = {(row.rule_id, row.axis, row.gearbox) for row in standing(session)}
    return sorted({(axis or None, gearbox or None) for _, axis, gearbox in meant ^ told}, key=str)


def matched(rule: AlarmRule, state: State | None, changed_at: datetime | None = None) -> dict[str, object] | None:
    """Return the facts, JSON, by which a rule holds of a gearbox; None where it does not hold."""
    if rule.kind == "change":
        return None if changed_at is None else {"began_at": changed_at.isoformat()}
    if state is None:
        return None
    if rule.kind == "silence":
        silent = state.newest.at < now() - timedelta(days=rule.silent_days or 0.0)
        return _told_of(state.newest, silent_days=rule.silent_days) if silent else None
    if rule.verdict not in (None, "diagnosed"):
        return _told_of(state.newest, verdict=rule.verdict) if state.verdict == rule.verdict else None
    if state.fault is None:
        return None
    for place, (label, probability) in enumerate(state.fault.faults):
        size_rad = state.fault.size_rad if place == 0 else None
        if (
            label not in BASELINES
            and rule.label in (None, label)
            and (rule.least_probability is None or (probability or 0.0) >= rule.least_probability)
            and (rule.least_size_rad is None or (size_rad or 0.0) >= rule.least_size_rad)
        ):
            return _told_of(
                state.fault.heard,
                verdict=state.fault.heard.verdict,
                label=label,
                labels=state.fault.heard.left or (label,),
                probability=probability,
                calibrated=state.fault.calibrated,
                size_rad=size_rad,
            )
    return None


def _told_of(heard: GearboxRecording, **facts: object) -> dict[str, object]:
    return {"heard_at": heard.at.isoformat(), "diagnosis_id": heard.diagnosis_id, **facts}


def _settle(session: Session, rule: AlarmRule, place: Place, facts: Mapping[str, object] | None) -> None:
    """Begin the alarm of a rule that holds by these facts and tell its receivers; end it where there are none."""
    if (facts is not None) == (_standing(session, rule, place) is not None):
        return
    # of several who notice at once one tells it
    if session.scalar(select(AlarmRule.id).where(AlarmRule.id == rule.id).with_for_update()) is None:
        return
    alarm, (axis, gearbox) = _standing(session, rule, place), place
    if alarm is not None and facts is None:
        alarm.ended_at = now()
    if alarm is None and facts is not None:
        session.add(Alarm(rule_id=rule.id, axis=axis or "", gearbox=gearbox or ""))
        about = {"kind": rule.kind, "rule": rule.name, "axis": axis, "gearbox": gearbox}
        outbox.post(session, [str(each) for each in rule.receivers], {**about, **facts})


def _standing(session: Session, rule: AlarmRule, place: Place) -> Alarm | None:
    axis, gearbox = place
    statement = select(Alarm).where(
        Alarm.rule_id == rule.id,
        Alarm.axis == (axis or ""),
        Alarm.gearbox == (gearbox or ""),
        Alarm.ended_at.is_(None),
    )
    return session.scalar(statement.execution_options(populate_existing=True))
