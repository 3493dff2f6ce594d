"""The fleet, and one gearbox with all that is known of it."""

from collections import Counter
from collections.abc import Sequence
from typing import Annotated
from zoneinfo import ZoneInfo

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.report.charts import charts_of, level_chart
from app.report.standing_words import WORDS, day, evidence_words, next_steps, since_words, state_badge, trend_words, why
from app.report.words import VERDICTS, in_short, is_compared, sure_of
from app.service import Reading, TheService
from app.web.first_hour import axis_cases, known_of_axis
from app.web.page import ROWS, Headlined, PageViewer, newest, render, waiting_page
from casebase.axes import is_axis, unknown_axis
from casebase.errors import NotFoundError
from casebase.gearbox_state import Reason, Standing, State, standing
from casebase.gearboxes import History
from casebase.labels import BASELINES
from casebase.reasoning.trend import Trend, trend_of
from casebase.store.models import StoredDiagnosis, StoredInvestigation, StoredRecording, now

router = APIRouter()
SECTION = "/fleet"
SHOWN = 100
"""Gearboxes on a page of the fleet: more than one reads at once."""
LARGEST = 10**6
SAID_OF = (Reason.NAMED, Reason.UNDECIDED, Reason.UNLIKE)
SAID_BY = ("fault", "hypotheses", "labels", "quality", "remarks", "novelty", "recording", "provenance")
"""Parts of a diagnosis that are needed to say in short what it says."""


@router.get("/fleet")
def fleet(
    request: Request,
    session: Reading,
    service: TheService,
    principal: PageViewer,
    state: State | None = None,
    first: Annotated[int, Query(ge=0, le=LARGEST)] = 0,
) -> Response:
    """The gearboxes with their states, the worst first: all of them or those in one state, a page of them."""
    begun = service.fleet_soon(session)
    if begun is not None:
        words = "Every gearbox with its state, the worst first."
        basis = "all recordings, once after each start of the service"
        return waiting_page(request, principal, begun, "Fleet", words, basis, section=SECTION)
    at, zone = now(), service.settings.time_zone
    known = [(row, row.state) for row in service.fleet.gearboxes(session, at, service.settings.silent_after)]
    counts = Counter(here for _, here in known)
    wanted = [row for row, here in known if state in (None, here)]
    rows = wanted[first : first + SHOWN]
    said, of_axes = diagnoses_said(session, [row.standing for row in rows]), axis_cases(service, session)
    context = {
        "rows": [
            (row, state_badge(row.standing, at), why(row.standing, zone, told), next_steps(row.standing, told)[0])
            for row, told in zip(rows, said, strict=True)
        ],
        "known": {axis: known_of_axis(of_axes.get(axis, {}) if axis else {}) for axis in {row.axis for row in rows}},
        "counts": [(each, WORDS[each], counts[each]) for each in State if counts[each]],
        "state": state,
        "first": first,
        "of": len(wanted),
        "shown": SHOWN,
        "day": lambda value: day(value, zone),
    }
    return render(request, "fleet.html", context, principal=principal, section=SECTION)


@router.get("/axes/{name}/gearboxes")
def unnamed_gearbox(
    request: Request,
    session: Reading,
    service: TheService,
    principal: PageViewer,
    name: str,
    history: Annotated[int, Query(ge=0)] = 0,
    before: Annotated[str, Query(max_length=32)] = "",
) -> Response:
    """What was recorded of an axis without the name of a gearbox."""
    return gearbox_page(request, session, service, principal, name, "", history, before)


@router.get("/axes/{name}/gearboxes/{gearbox:path}")
def gearbox_page(
    request: Request,
    session: Reading,
    service: TheService,
    principal: PageViewer,
    name: str,
    gearbox: str,
    history: Annotated[int, Query(ge=0)] = 0,
    before: Annotated[str, Query(max_length=32)] = "",
) -> Response:
    """One gearbox: its state, its trend, what was heard of it and what was done to it.

    Args:
        history: which of the gearboxes that had this name, from 1; the last one where 0.
        before: the newest recordings before this one.
    """
    known = service.fleet.place(session, name, gearbox or None)
    found = known.histories if known else ()
    if known is None or not found or history > len(found):
        if not is_axis(session, name):
            raise NotFoundError(unknown_axis(session, name))
        raise NotFoundError(f"no gearbox {gearbox!r} is known at axis {name!r}")
    shown = found[history - 1 if history else -1]
    trend = known.trend if shown.until is None else trend_of(session, shown)
    at, zone = now(), service.settings.time_zone
    stands = standing(shown, trend, at, service.settings.silent_after) if shown.until is None else None
    heard = list(reversed(shown.heard))
    first = next((k + 1 for k, one in enumerate(heard) if one.recording_id == before), 0)
    page = heard[first : first + ROWS]
    said = diagnoses_said(session, [stands])[0]
    context = {
        "name": name,
        "gearbox": gearbox or None,
        "shown": shown,
        "others": [one for one in found if one.number != shown.number],
        "standing": stands,
        "badge": state_badge(stands, at) if stands else None,
        "why": why(stands, zone, said) if stands else None,
        "since": since_words(stands, zone) if stands else "",
        "steps": next_steps(stands, said) if stands else (),
        "changed": trend_words(trend, zone),
        "at_once": question_of(shown, trend, zone),
        "evidence": evidence_words(trend) if trend else None,
        "charts": charts_of(trend, shown, sizes_of(session, shown)) if trend else (),
        "level": level_chart(trend, shown) if trend else None,
        "heard": page,
        "older": page[-1].recording_id if first + ROWS < len(heard) else None,
        "investigations": investigations_of(session, shown),
        "verdicts": VERDICTS,
        "day": lambda value: day(value, zone),
    }
    return render(request, "gearbox.html", context, principal=principal, section=SECTION)


def question_of(history: History, trend: Trend | None, zone: str) -> tuple[str, str] | None:
    """Return the day of a change at once, in words and as its form has the time; None where there is nothing to ask."""
    at_once = None if trend is None or history.until is not None else trend.at_once
    if at_once is None:
        return None
    return day(at_once.at, zone), f"{at_once.at.astimezone(ZoneInfo(zone)):%Y-%m-%dT%H:%M}"


def diagnoses_said(session: Session, standings: Sequence[Standing | None]) -> list[str | None]:
    """Return for each gearbox how sure the diagnosis is that names its fault, or what one says that names none."""
    shown = [
        one.recording.diagnosis_id if one and one.reason in SAID_OF and one.recording else None for one in standings
    ]
    ids = [each for each in shown if each]
    columns = (StoredDiagnosis.id, StoredDiagnosis.verdict, StoredDiagnosis.label, StoredDiagnosis.probability)
    parts = [StoredDiagnosis.document[name] for name in SAID_BY]  # a document is long
    rows = session.execute(select(*columns, *parts).where(StoredDiagnosis.id.in_(ids))) if ids else ()
    told: dict[str, str] = {}
    for identity, verdict, label, probability, *found in rows:
        known = dict(zip(SAID_BY, found, strict=True))
        document = {"verdict": verdict, "label": label, "probability": probability, **known}
        if verdict == "diagnosed":
            told[identity] = sure_of(document)
        elif verdict == "ambiguous" or not is_compared(document):
            told[identity] = in_short(document)
    return [told.get(each) if each else None for each in shown]


def sizes_of(session: Session, history: History) -> dict[str, dict[str, float]]:
    """Return the size of the fault that the diagnosis of a recording gives, by the recording's id."""
    size = StoredDiagnosis.document["severity"]
    rows = session.execute(
        select(StoredDiagnosis.recording_id, size)
        .join(StoredDiagnosis.recording)
        .where(StoredRecording.axis == history.axis, StoredRecording.gearbox == history.gearbox)
        .where(StoredDiagnosis.label.not_in(BASELINES))  # what is good has no size, and its document is long
        .order_by(StoredDiagnosis.id)
    )
    return {recording_id: found for recording_id, found in rows if found}


def investigations_of(session: Session, history: History) -> list[Headlined]:
    """Return the newest investigations of the axis while the gearbox was in it, with what each found."""
    while_in_it = [StoredInvestigation.axis == history.axis]
    while_in_it += [StoredInvestigation.created_at >= history.since] if history.since else []
    while_in_it += [StoredInvestigation.created_at < history.until] if history.until else []
    return newest(session, 10, *while_in_it)
