"""Templates, what every page is given, and how numbers, times and labels are written."""

import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from zoneinfo import ZoneInfo

from fastapi import Request
from fastapi.responses import HTMLResponse
from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from app.security import COOKIE, Principal, csrf_token
from app.service import service_of
from app.web.svg import shape_name, shape_path, sign_of
from casebase.signals.features import feature_words
from sim.discrepancy.report.formatting import angle, named, words_of

FOLDER = Path(__file__).parent
STATIC = FOLDER / "static"
NAVIGATION = (
    ("/fleet", "Fleet", "1", "viewer"),
    ("/diagnoses", "Diagnoses", "2", "viewer"),
    ("/library", "Library", "3", "viewer"),
    ("/axes", "Axes and robots", "4", "viewer"),
    ("/investigations", "Model and measurement", "5", "viewer"),
    ("/simulate", "Simulate", "0", "viewer"),
    ("/jobs", "Jobs", "6", "operator"),
    ("/alarms", "Alarms", "7", "admin"),
    ("/keys", "Keys", "8", "admin"),
    ("/audit", "Audit", "9", "admin"),
)
MINUS, NO_BREAK = "\N{MINUS SIGN}", "\N{NO-BREAK SPACE}"
RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
SQUARE = re.compile(r"(?<=[a-z])2\b")
LONGEST = 7
"""From this power of ten on a number is written with one."""


@dataclass(frozen=True)
class Message:
    """One notice above the content: kind is empty, 'warn' or 'bad'."""

    text: str
    kind: str = ""


def quantity(value: float | None, unit: str = "", digits: int = 3) -> Markup:
    """Write a number with its unit, or a dash where there is none.

    >>> quantity(0.00091, "rad")
    Markup('0.00091\\xa0rad')
    >>> quantity(1920.0, "kg m2"), quantity(2.5e-7)
    (Markup('1920\\xa0kg m²'), Markup('2.5 × 10⁻⁷'))
    """
    if value is None:
        return Markup("–")
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        plain = 0 < int(exponent) < LONGEST
        text = f"{float(text):.0f}" if plain else f"{mantissa} × 10{str(int(exponent)).translate(RAISED)}"
    text = text.replace("-", MINUS)
    if not unit or unit == "1":
        return escape(text)
    return escape(f"{text}{'' if unit == '°' else NO_BREAK}{SQUARE.sub('²', unit)}")


def percent(value: float | None, digits: int = 0) -> str:
    """Write a ratio in per cent."""
    return "–" if value is None else f"{100 * value:.{digits}f}\N{NO-BREAK SPACE}%"


def sentence(text: str) -> str:
    """Return a statement as a sentence; what ends in lines of a document gets no full stop.

    >>> sentence("the motion repeats")
    'The motion repeats.'
    """
    return f"{text[:1].upper()}{text[1:]}" if "\n" in text else f"{text[:1].upper()}{text[1:].removesuffix('.')}."


@lru_cache(maxsize=256)
def shape(label: str | None) -> Markup:
    """Draw the shape that belongs to a label, so that colour never speaks alone."""
    outline = shape_path(label or "", 8.0, 8.0, 6.0)
    return Markup(
        '<svg viewBox="0 0 16 16" class="shape" aria-hidden="true"><path fill="currentColor" d="{}"/></svg>'
    ).format(outline)


@lru_cache(maxsize=256)
def label_badge(label: str | None) -> Markup:
    """Write a label with its shape."""
    return Markup('<span class="label {}">{}{}</span>').format(shape_name(label or ""), shape(label), label or "none")


@lru_cache(maxsize=256)
def answer_badge(label: str | None) -> Markup:
    """Write the label that was answered with the shape of the state that it means, which every fault has alike."""
    sign = sign_of(label)
    return Markup('<span class="label {}">{}{}</span>').format(sign, shape(sign), label or "none")


@lru_cache(maxsize=256)
def origin_badge(origin: str) -> Markup:
    """Write where a case comes from."""
    return Markup('<span class="badge {}">{}</span>').format(origin, origin)


def person(actor: str) -> str:
    """Return the name of who did something, without the ending by which the audit tells keys of one name apart.

    >>> person("night shift#6e0b70")
    'night shift'
    """
    return actor.rsplit("#", 1)[0]


def changes(document: Mapping[str, object]) -> str:
    """Write what an audit entry holds as words."""
    entries = [
        f"{name.replace('_', ' ')}: {value}" for name, value in document.items() if value not in (None, "", {}, [])
    ]
    return "; ".join(entries) or "–"


def _clock(zone: str) -> ZoneInfo:
    return ZoneInfo(zone)


def instant(value: datetime | None, zone: str) -> Markup:
    """Write a time in the zone of the site, with its abbreviation, machine-readable besides."""
    if value is None:
        return Markup("–")
    local = value.astimezone(_clock(zone))
    return Markup('<time datetime="{}">{}</time>').format(value.isoformat(), f"{local:%Y-%m-%d %H:%M} {local.tzname()}")


def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(FOLDER / "templates"),
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        changes=changes,
        person=person,
        angle=angle,
        feature_words=feature_words,
        named=named,
        quantity=quantity,
        parameter_words=words_of,
        percent=percent,
        label_badge=label_badge,
        answer_badge=answer_badge,
        origin_badge=origin_badge,
        shape=shape,
    )
    environment.globals.update(version=version("gearcase"), shape_name=shape_name)
    return environment


ENVIRONMENT = _environment()


def content_security_policy(nonce: str) -> str:
    """Scripts and styles of our own only; the nonce is for the style of the waveform player's shadow root."""
    return (
        "default-src 'none'; script-src 'self'; frame-src 'self'; connect-src 'self'; "
        "img-src 'self' data:; media-src 'self' blob:; "
        f"style-src 'self' 'nonce-{nonce}'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    )


def render(
    request: Request,
    template: str,
    context: Mapping[str, object],
    *,
    principal: Principal | None,
    section: str = "",
    messages: tuple[Message, ...] = (),
    status: int = 200,
) -> HTMLResponse:
    """Fill a page's template; everything a value holds is escaped."""
    service = service_of(request)
    root = service.settings.root_path.rstrip("/")
    zone = service.settings.time_zone
    nonce = secrets.token_urlsafe(12)
    navigation = [
        (href, words, key)
        for href, words, key, role in NAVIGATION
        if principal is not None and principal.role.may(type(principal.role)(role))
    ]
    given: dict[str, object] = {
        "root": root,
        "request_path": request.url.path,
        "static": lambda name: f"{root}/static/{name}",
        "nonce": nonce,
        "csrf": csrf_token(request.cookies.get(COOKIE, "")) if principal else "",
        "principal": principal,
        "may_operate": principal is not None and principal.role.may(type(principal.role)("operator")),
        "may_admin": principal is not None and principal.role.may(type(principal.role)("admin")),
        "navigation": navigation,
        "section": section,
        "messages": messages,
        "zone": zone,
        "at": lambda value: instant(value, zone),
    }
    page = ENVIRONMENT.get_template(template).render({**given, **context})
    headers = {"Content-Security-Policy": content_security_policy(nonce), "Cache-Control": "no-store"}
    return HTMLResponse(page, status_code=status, headers=headers)
