"""Describe an axis by a form: from a template, from another axis, or as it is now."""

from collections.abc import Mapping
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import RedirectResponse, Response

from app.axes.axis_templates import TEMPLATES
from app.http.errors import Unprocessable
from app.http.security import Principal
from app.service import Reading, Service, TheService
from app.web.axis_form import FIELDS, MOST_STAGES, STAGE, described, filled
from app.web.session import FromOurPage, PageAdmin
from app.web.templating import Message, render
from casebase.axes import add_axis, find_axis, get_axis
from sim.description.axis_document import read_axis
from sim.errors import AxisError, ParameterError

router = APIRouter(prefix="/describe")


async def the_fields(request: Request) -> dict[str, str]:
    """What the form says."""
    return {name: value for name, value in (await request.form()).multi_items() if isinstance(value, str)}


Fields = Annotated[dict[str, str], Depends(the_fields)]


@router.get("")
def form(
    request: Request,
    session: Reading,
    principal: PageAdmin,
    axis: Annotated[str, Query(max_length=200)] = "",
    template: Annotated[str, Query(max_length=50)] = "",
    copy: Annotated[str, Query(max_length=200)] = "",
) -> Response:
    """The form: of a stored axis, of a new one like a stored one, of a template, or empty."""
    if axis:
        row = get_axis(session, axis)
        return _form(request, principal, filled(row.document), row.name, row.revision)
    if copy:
        return _form(request, principal, filled(copied(get_axis(session, copy).document)), copy=copy)
    if template and template not in TEMPLATES:
        raise Unprocessable(f"There is no template {template!r}; there are {', '.join(TEMPLATES)}.")
    values = filled(TEMPLATES[template].document("")) if template else {}
    return _form(request, principal, values, template=template)


def copied(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what another axis of the same kind has: not the name, and not what was found in this one."""
    return {key: value for key, value in document.items() if key not in ("name", "mechanisms")}


def _form(
    request: Request,
    principal: Principal,
    values: Mapping[str, str],
    axis: str = "",
    revision: int = 0,
    template: str = "",
    copy: str = "",
    wrong: str = "",
) -> Response:
    stages = max(MOST_STAGES, sum(key.startswith("stages.") and key.endswith(".name") for key in values))
    context: dict[str, Any] = {"values": values, "fields": FIELDS, "stage": STAGE, "stages": stages}
    context |= {"axis": axis, "revision": revision, "templates": TEMPLATES, "template": template, "copy": copy}
    messages = (Message(wrong, "bad"),) if wrong else ()
    status = 422 if wrong else 200
    return render(
        request, "describe.html", context, principal=principal, section="/axes", messages=messages, status=status
    )


@router.post("", dependencies=[FromOurPage])
def describe(request: Request, service: TheService, principal: PageAdmin, fields: Fields) -> Response:
    """Store what the form says as the next revision; a new axis leads to its first hour.

    What is wrong is said above the form, which keeps its fields.
    """
    axis, revision = fields.get("axis", ""), int(fields.get("revision", "0") or 0)
    try:
        name = _stored(service, principal, axis, revision, fields)
    except (AxisError, ParameterError) as error:
        return _form(request, principal, fields, axis, revision, copy=fields.get("copy", ""), wrong=str(error))
    page = f"{service.settings.root_path.rstrip('/')}/axes/{quote(name, safe='')}"
    return RedirectResponse(page if axis else f"{page}/first-hour", status_code=303)


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
