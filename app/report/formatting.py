"""How numbers, times and labels are written, and the templates that use it."""

import re
import tomllib
from collections.abc import Iterable, Mapping
from datetime import datetime
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from zoneinfo import ZoneInfo

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from app.report.svg import shape_name, shape_path, sign_of
from signals.features import feature_words
from sim.investigation.report.formatting import angle, named, words_of

FOLDER = Path(__file__).parents[1] / "web"
STATIC = FOLDER / "static"
MINUS, NO_BREAK = "\N{MINUS SIGN}", "\N{NO-BREAK SPACE}"
RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
SQUARE = re.compile(r"(?<=[a-z])2\b")
WORDS: dict[str, dict[str, str]] = tomllib.loads((Path(__file__).parent / "english.toml").read_text("utf-8"))
"""The words for what the interface for programs calls otherwise, by what they are of."""
NAMES = WORDS["labels"]
LABEL = re.compile(rf"(?<![\w/])({'|'.join(NAMES)})(?![\w/])")
LONGEST = 7
"""From this power of ten on a number is written with one."""


def style_sheet() -> Markup:
    """Return the style sheet of the pages, to stand inside a file."""
    return Markup((STATIC / "gearcase.css").read_text())  # noqa: S704  our own file


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

    >>> sentence("too few gearboxes of notch are known")
    'Too few gearboxes of tooth damage are known.'
    """
    text = LABEL.sub(lambda found: NAMES[found[0]], text)
    return f"{text[:1].upper()}{text[1:]}" if "\n" in text else f"{text[:1].upper()}{text[1:].removesuffix('.')}."


def in_series(words: Iterable[str], joined: str = "and") -> str:
    """Write words as a series: "no fault, tooth damage and backlash"."""
    *others, last = words
    return f"{', '.join(others)} {joined} {last}" if others else last


def counted(number: int, one: str, more: str = "") -> str:
    """Write a number of things.

    >>> counted(1, "case"), counted(2, "case"), counted(2, "gearbox", "gearboxes")
    ('1 case', '2 cases', '2 gearboxes')
    """
    return f"{number} {one if number == 1 else more or f'{one}s'}"


@lru_cache(maxsize=256)
def shape(label: str | None) -> Markup:
    """Draw the shape that belongs to a label, so that colour never speaks alone."""
    outline = shape_path(label or "", 8.0, 8.0, 6.0)
    return Markup(
        '<svg viewBox="0 0 16 16" class="shape" aria-hidden="true"><path fill="currentColor" d="{}"/></svg>'
    ).format(outline)


def name_of(label: str | None) -> str:
    """Return a label as words.

    >>> name_of("notch"), name_of("tooth_wear")
    ('tooth damage', 'tooth wear')
    """
    return NAMES.get(label or "", (label or "unknown").replace("_", " "))


def term(name: str, of: str) -> str:
    """Return what something is called on pages.

    >>> term("bump", "quality"), term("foreign_sound", "quality")
    ('knock', 'foreign sound')
    """
    return WORDS[of].get(name, name.replace("_", " "))


@lru_cache(maxsize=256)
def label_badge(label: str | None) -> Markup:
    """Write a label with its shape."""
    return Markup('<span class="label {}">{}{}</span>').format(
        shape_name(label or ""), shape(label), name_of(label or "none")
    )


@lru_cache(maxsize=256)
def answer_badge(label: str | None) -> Markup:
    """Write the label that was answered with the shape of the state that it means, which every fault has alike."""
    sign = sign_of(label)
    return Markup('<span class="label {}">{}{}</span>').format(sign, shape(sign), name_of(label or "none"))


@lru_cache(maxsize=256)
def origin_badge(origin: str) -> Markup:
    """Write where a case comes from."""
    return Markup('<span class="badge {}">{}</span>').format(origin, origin)


def reason(error: str) -> str:
    """Return why a job failed as a sentence, without the number of the part that failed.

    >>> reason("task 0: there is no channel 5")
    'There is no channel 5.'
    """
    return sentence(re.sub(r"^task \d+: ", "", error))


def person(actor: str) -> str:
    """Return the name of who did something, without the ending by which the audit tells keys of one name apart.

    >>> person("night shift#6e0b70")
    'night shift'
    """
    return actor.rsplit("#", 1)[0]


def changes(after: Mapping[str, object], before: Mapping[str, object]) -> str:
    """Write what an audit entry changed as words.

    >>> changes({"label": "notch", "file_sha256": "00"}, {"label": "normal"})
    'label: tooth damage, before: no fault'
    """
    changed = [one for one in {**before, **after} if term(one, "fields") and after.get(one) != before.get(one)]
    sides = [(term(one, "fields"), *(_value(one, each.get(one)) for each in (after, before))) for one in changed]
    return "; ".join(f"{name}: {', before: '.join(filter(None, (new, old)))}" for name, new, old in sides) or "–"


def _value(field: str, value: object) -> str:
    return term(str(value), f"{field}s") if f"{field}s" in WORDS and value else str(value or "")


def instant(value: datetime | None, zone: str) -> Markup:
    """Write a time in the zone of the site, with its abbreviation, machine-readable besides."""
    if value is None:
        return Markup("–")
    local = value.astimezone(ZoneInfo(zone))
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
        counted=counted,
        in_series=in_series,
        term=term,
        person=person,
        reason=reason,
        angle=angle,
        feature_words=feature_words,
        named=named,
        quantity=quantity,
        sentence=sentence,
        parameter_words=words_of,
        percent=percent,
        label_badge=label_badge,
        name_of=name_of,
        answer_badge=answer_badge,
        origin_badge=origin_badge,
        shape=shape,
    )
    environment.globals.update(version=version("gearcase"), shape_name=shape_name)
    return environment


ENVIRONMENT = _environment()
