"""Describe an axis by a form: from a template, from another axis, or as it is now; fields have units to choose."""

from collections.abc import Mapping
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from app.axes import TEMPLATES
from app.axis_form import FIELDS, MOST_STAGES, STAGE, copied, described, filled, in_words
from app.http.errors import Unprocessable
from app.http.security import Principal
from app.service import Reading, Service, TheService
from app.web.forms import Fields
from app.web.page import FromOurPage, Message, PageAdmin, lead, render
from casebase.axes import add_axis, find_axis, get_axis
from sim.description.axis_document import read_axis
from sim.errors import AxisError, ParameterError

router = APIRouter(prefix="/describe")


@router.get("")
def form(
    request: Request,
    session: Reading,
    _: PageAdmin,
    axis: Annotated[str, Query(max_length=200)] = "",
    template: Annotated[str, Query(max_length=50)] = "",
    copy: Annotated[str, Query(max_length=200)] = "",
    back: Annotated[str, Query(max_length=1)] = "",
    stored: Annotated[str, Query(max_length=200)] = "",
) -> Response:
    """The form: of a stored axis, of a new one like a stored one, of a template, or empty; or that an axis is `stored`
    for the investigation that waits in another tab."""
    if stored:
        return render(request, "describe.html", {"stored": stored}, section="/axes")
    if axis:
        row = get_axis(session, axis)
        return _form(request, filled(row.document), axis=row.name, revision=row.revision)
    if copy:
        return _form(request, filled(copied(get_axis(session, copy).document)), copy=copy)
    if template and template not in TEMPLATES:
        raise Unprocessable(f"There is no template {template!r}; there are {', '.join(TEMPLATES)}.")
    values = filled(TEMPLATES[template].document("")) if template else {}
    if back:
        values["motor.inertia_kg_m2"] = ""  # a log shows it, and nobody knows it by the gear
    return _form(request, values, template=template, back=back)


def _form(request: Request, values: Mapping[str, str], wrong: str = "", **about: object) -> Response:
    stages = max(MOST_STAGES, sum(key.startswith("stages.") and key.endswith(".name") for key in values))
    context = {"values": values, "fields": FIELDS, "stage": STAGE, "stages": stages, "templates": TEMPLATES}
    context |= {"axis": "", "revision": 0, "template": "", "copy": "", "back": "", **about}
    messages, status = ((Message(wrong, "bad"),), 422) if wrong else ((), 200)
    return render(request, "describe.html", context, section="/axes", messages=messages, status=status)


@router.post("", dependencies=[FromOurPage])
def describe(request: Request, service: TheService, principal: PageAdmin, fields: Fields) -> Response:
    """Store what the form says as the next revision; a new axis leads to its first hour.

    What is wrong is said above the form, which keeps its fields.
    """
    axis, revision, back = fields.get("axis", ""), int(fields.get("revision", "0") or 0), fields.get("back", "")
    try:
        name = _stored(service, principal, axis, revision, fields)
    except (AxisError, ParameterError) as error:
        about = {"axis": axis, "revision": revision, "copy": fields.get("copy", ""), "back": back}
        return _form(request, fields, in_words(str(error), fields), **about)
    if back:
        return lead(service, f"/describe?stored={quote(name, safe='')}")
    return lead(service, f"/axes/{quote(name, safe='')}{'' if axis else '/first-hour'}")


def _stored(service: Service, principal: Principal, axis: str, revision: int, fields: Mapping[str, str]) -> str:
    with service.library.transaction(principal.actor) as session:
        like = fields.get("copy", "")
        before: Mapping[str, Any] = (
            get_axis(session, axis).document if axis else copied(get_axis(session, like).document) if like else {}
        )
        found = read_axis(described({**fields, "name": axis or fields.get("name", "")}, before))
        if not axis and find_axis(session, found.name) is not None:
            raise AxisError(f"An axis is called {found.name!r} already: change that one, or give another name.")
        return add_axis(session, found.name, found.to_mapping(), based_on=revision if axis else None).name
