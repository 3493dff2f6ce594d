"""What needs a person, one after the other; and every step that somebody took, taken back."""

from collections import Counter
from typing import Annotated

from fastapi import APIRouter, Form, Request
from fastapi.responses import Response
from sqlalchemy import select

from app.http.errors import Forbidden
from app.http.security import Role
from app.report.steps import told
from app.report.words import how_sure, is_compared, name_of, names_fault, verdict_of
from app.service import Reading, TheService
from app.web.page import FromOurPage, PageOperator, PageViewer, lead, render
from casebase.errors import NotFoundError
from casebase.gearbox_state import NamedFault
from casebase.queue import FAULT, UNDECIDED, UNKNOWN, proposed, waiting
from casebase.steps import undo
from casebase.store.models import StoredDiagnosis

router = APIRouter()
SHOWN = 50
KINDS = {FAULT: "Fault likely, not confirmed", UNDECIDED: "Undecided", UNKNOWN: "Not in the library"}
LARGEST_NUMBER = 2**31 - 1


@router.get("/queue")
def queue(request: Request, service: TheService, session: Reading, principal: PageViewer) -> Response:
    """The diagnoses that need a person: likely faults first, then the most informative."""
    naming = service.fleet.naming(session)
    found = waiting(session, naming, faults_first=True)
    shown = list(found)[:SHOWN]
    given = session.scalars(select(StoredDiagnosis).where(StoredDiagnosis.id.in_(shown)))
    rows = sorted(given, key=lambda row: shown.index(row.id))
    kinds = Counter(found.values())
    context: dict[str, object] = {
        "kinds": [(words, kinds[kind]) for kind, words in KINDS.items() if kind in kinds],
        "rows": [
            (row, verdict_of(row.document).headline, reason_words(row, naming.get(row.recording_id))) for row in rows
        ],
        "count": len(found),
        "proposed": proposed(session),
        "step": told(session, number_of(request, "step")),
        "how_sure": how_sure,
    }
    return render(request, "queue.html", context, principal=principal, section="/diagnoses")


def reason_words(row: StoredDiagnosis, fault: NamedFault | None = None) -> str:
    """Say why a diagnosis needs a person.

    Args:
        fault: that it names and that stands of its gearbox.
    """
    if row.verdict == UNKNOWN and not is_compared(row.document):
        return "It could not be compared. Do what its page says."
    if row.verdict == UNKNOWN:
        return "Unlike every known kind. Listen, have it inspected if it comes again, and say what it is."
    if row.verdict == UNDECIDED and names_fault(row.document):
        return "A fault is likely, and the library cannot decide which. Do the checks on its page, and say what it is."
    if row.verdict == UNDECIDED:
        return "The library cannot decide. Listen, do the checks on its page, and say what it is."
    name = name_of(row.label).capitalize()
    if fault is not None and fault.good:
        since = "1 recording since then has" if fault.good == 1 else f"{fault.good} recordings since then have"
        return f"{name} was named, and {since} sounded good. A worn gear does not heal: do the checks on its page."
    return f"{name} is likely. Do the checks on its page, then confirm or correct."


def number_of(request: Request, name: str) -> int | None:
    """Return a number from the address of a page; None where there is none."""
    text = request.query_params.get(name, "")
    return min(int(text), LARGEST_NUMBER) if text.isascii() and text.isdigit() and len(text) < 12 else None


@router.post("/steps/undo", dependencies=[FromOurPage])
def take_back(
    service: TheService,
    principal: PageOperator,
    step: Annotated[int, Form(ge=1, le=LARGEST_NUMBER)],
    queue: Annotated[str, Form()] = "",
) -> Response:
    """Take a step back and show what it was about."""
    with service.library.transaction(principal.actor) as session:
        what = told(session, step)
        if what is None:
            raise NotFoundError("this step was taken back already, or never was")
        if what.by_admin and not principal.role.may(Role.ADMIN):
            raise Forbidden(f"Cases are changed by admins; you are signed in with the role {principal.role}.")
        undo(session, step)
    shown = "undone=1&queue=1" if queue and what.path.startswith("/diagnoses/") else "undone=1"
    return lead(service, f"{what.path}?{shown}")
