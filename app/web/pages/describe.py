"""Describe an axis by a form: from a template, from another axis, or as it is now; fields have units to choose."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import Response

from app.axes import TEMPLATES, in_si, units_of
from app.http.errors import Unprocessable
from app.http.security import Principal
from app.service import Reading, Service, TheService
from app.web.page import FromOurPage, Message, PageAdmin, lead, render
from casebase.axes import add_axis, find_axis, get_axis
from sim.description.axis_document import read_axis
from sim.errors import AxisError, ParameterError

router = APIRouter(prefix="/describe")
MOST_STAGES = 4


@dataclass(frozen=True)
class Field:
    """One number of a table of the description, and what it is called."""

    table: str
    key: str
    words: str
    hint: str = ""

    @property
    def name(self) -> str:
        return f"{self.table}.{self.key}"

    @property
    def units(self) -> list[str]:
        return [unit for unit in units_of(self.key) if unit]


FIELDS = (
    Field("motor", "inertia_kg_m2", "Inertia of the motor", "with all that turns on its shaft; empty if nobody knows"),
    Field("motor", "coulomb_friction_n_m", "Dry friction of the motor"),
    Field("motor", "viscous_friction_n_m_s_per_rad", "Viscous friction of the motor"),
    Field("load", "inertia_kg_m2", "Inertia of the load", "arm and payload, about the axis"),
    Field("load", "coulomb_friction_n_m", "Dry friction of the joint"),
    Field("load", "viscous_friction_n_m_s_per_rad", "Viscous friction of the joint"),
    Field("transmission", "stiffness_n_m_per_rad", "Stiffness of the whole gear", "at the output, the motor locked"),
    Field("motion", "load_speed_rad_s", "Largest speed of the output", "in its usual motion"),
)
STAGE = (
    Field("stages", "driver_teeth", "Teeth of the driver"),
    Field("stages", "driven_teeth", "Teeth of the driven gear"),
    Field("stages", "ratio", "Ratio", "instead of teeth"),
    Field("stages", "inertia_kg_m2", "Inertia", "of the driven shaft"),
    Field("stages", "mesh_efficiency", "Efficiency", "0 to 1"),
    Field("stages", "stiffness_n_m_per_rad", "Stiffness", "at the driven gear"),
    Field("stages", "backlash_rad", "Backlash as new", "at most"),
)
TEETH = ("driver_teeth", "driven_teeth")


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


def filled(document: Mapping[str, Any]) -> dict[str, str]:
    """Return what stands in the fields for a description: SI units, as short as they are exact."""
    values = {"name": str(document.get("name", ""))}
    for field in FIELDS:
        values[field.name] = _text(document.get(field.table, {}).get(field.key))
    for number, stage in enumerate(document.get("stages", ())):
        values[f"stages.{number}.name"] = str(stage["name"])
        teeth = stage.get("driver_teeth") is not None
        for field in STAGE:
            shown = None if teeth and field.key == "ratio" else stage.get(field.key)
            values[f"stages.{number}.{field.key}"] = _text(shown)
    return values


def _text(value: float | None) -> str:
    if value is None:
        return ""
    short = f"{value:.12g}"
    return short if float(short) == value else repr(value)


def described(given: Mapping[str, str], before: Mapping[str, Any]) -> dict[str, Any]:
    """Return the description that the fields make of the one before, of which all else is kept.

    Raises:
        ParameterError: where a field has no number, or a unit that is not its own.
    """
    document: dict[str, Any] = {key: value for key, value in before.items() if key != "stages"}
    document["name"] = given.get("name", "").strip()
    for field in FIELDS:
        table = {**document.get(field.table, {})}
        table.pop(field.key, None)
        if text := given.get(field.name, "").strip():
            table[field.key] = in_si(field.name, text, given.get(f"{field.name}.unit", ""))
        document[field.table] = table
    known = {stage["name"]: stage for stage in before.get("stages", ())}
    stages = [
        _stage(given, number, known)
        for number in range(max(MOST_STAGES, len(known)))
        if given.get(f"stages.{number}.name", "").strip()
    ]
    optional = {"transmission", "motion"}
    return {key: value for key, value in document.items() if value or key not in optional} | {"stages": stages}


def _stage(given: Mapping[str, str], number: int, known: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    name = given[f"stages.{number}.name"].strip()
    own = {field.key for field in STAGE}
    stage = {key: value for key, value in known.get(name, {}).items() if key not in own} | {"name": name}
    for field in STAGE:
        if text := given.get(f"stages.{number}.{field.key}", "").strip():
            value = in_si(f"{name}.{field.key}", text, given.get(f"{field.name}.unit", ""))
            if field.key in TEETH and not value.is_integer():
                raise ParameterError(f"{field.words} of {name}: must be a whole number, got {text}.")
            stage[field.key] = int(value) if field.key in TEETH else value
    return stage
