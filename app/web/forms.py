"""What forms of the pages say: of a recording and its label, which is asked for again where it looks like a known one.

A second word for a known kind would split its cases in two.
"""

import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from difflib import get_close_matches
from typing import Annotated, Literal, TypeVar

from fastapi import Depends, Request
from pydantic import TypeAdapter, ValidationError
from sqlalchemy.orm import Session

from app.axes import check_place, in_si
from app.fleet import natural
from app.http.errors import Forbidden, Unprocessable
from app.http.security import Principal, Role, check_csrf
from app.http.uploads import TheUpload, Upload
from app.recordings.intake import Intake, RecordingMetadata, read_metadata, take_in
from app.report.formatting import NAMES, name_of
from app.service import Service, TheService
from casebase.axes import axis_names
from casebase.gearboxes import gearbox_names
from casebase.labels import GEAR_DAMAGE, OTHER_WORDS
from casebase.store.fields import Label
from sim.errors import ParameterError
from sim.experiment.design_of_experiments import LABELS
from sim.mechanisms import MECHANISMS

LABEL: TypeAdapter[str] = TypeAdapter(Label)
ANOTHER = "+"
"""What a list of labels sends for a label that is not in it."""
BEARING_DAMAGE = ("fatigue", "wear", "corrosion", "electrical_erosion", "plastic_deformation", "fracture")
STANDARDS = (
    ("Damage of gear teeth, in the words of ISO 10825-1", tuple(GEAR_DAMAGE)),
    ("Damage of rolling bearings, in the words of ISO 15243", tuple(f"bearing_{kind}" for kind in BEARING_DAMAGE)),
)
OF_RECORDING = {"speed_rad_s": "The largest speed of the output", "payload_kg_m2": "The payload"}
NUMBERS = {**OF_RECORDING, "size_rad": "The size of the fault"}
SAID = ("axis", "gearbox", "new_axis", "new_gearbox", *OF_RECORDING, *(f"{name}.unit" for name in OF_RECORDING))
"""What a form may say of a recording."""
LARGEST_NUMBER = 2**31 - 1
MOST_AT_ONCE = 1000
"""Cases of a label that one form has simulated."""
Known = TypeVar("Known", bound=RecordingMetadata)
Verified = Literal["", "opened", "measured", "heard", "unverified"]

Choices = list[tuple[str, list[tuple[str, str]]]]


class LabelQuestion(Exception):
    """A new label looks like one that is there: whoever gave it is asked which is meant."""

    def __init__(self, label: str, near: list[str]) -> None:
        super().__init__(f"the new label {label!r} looks like {' and '.join(near)}")
        self.label, self.near = label, near


def choices(library: Iterable[str]) -> Choices:
    """Return the labels to choose from, in groups of (label, words): those of the library first.

    >>> [words for group, labels in choices(["notch", "pitting"]) for _, words in labels][:3]
    ['no fault', 'tooth damage', 'pitting']
    """
    own = sorted({*library, *NAMES})
    groups: Choices = [("In the library", [(label, name_of(label)) for label in own])]
    return groups + [
        (group, [(label, name_of(label)) for label in labels if label not in own]) for group, labels in STANDARDS
    ]


def import_choices(service: Service, session: Session) -> dict[str, object]:
    """Return what a table of recordings offers: labels with their other words, axes, gearboxes, ways to verify."""
    labels = choices(one for one, _ in service.counts(session))
    return {
        "choices": labels,
        "other_words": {label: _other_words(label) for _, group in labels for label, _ in group},
        "axes": sorted(axis_names(session), key=natural),
        "gearboxes": sorted(gearbox_names(session), key=natural),
    }


def damage_of(label: str | None) -> str:
    """Return what ISO 10825-1 calls a label, or the damage that can make it; empty where it has no name for it.

    >>> damage_of("pitting"), damage_of("normal")
    ('surface fatigue: pitting', '')
    """
    name = LABELS.get(label or "", label) or ""
    return MECHANISMS[name].damage if name in MECHANISMS else GEAR_DAMAGE.get(name, "")


def chosen(label: str, another: str, sure: bool, library: Iterable[str]) -> str:
    """Return the label that a form says: one of the list, or a new one that looks like none of it or is meant.

    Raises:
        Unprocessable: if there is none, or it cannot be one.
        LabelQuestion: if it is new and looks like a known one.
    """
    text = (another if label == ANOTHER else label).strip()
    if not text:
        raise Unprocessable("Choose the right label from the list, or choose 'another label' and write it.")
    known = [each for _, labels in choices(library) for each, _ in labels]
    if text in known:
        return text
    new = re.sub(r"\s+", "_", text.lower())
    try:
        LABEL.validate_python(new)
    except ValidationError:
        raise Unprocessable(
            f"A label begins with a letter a to z and has letters, digits, '.', '_' and '-', such as tooth_wear; "
            f"got {text[:60]!r}."
        ) from None
    near = [] if sure or new in known else near_labels(new, known)
    if near:
        raise LabelQuestion(new, near)
    return new


async def the_fields(request: Request) -> dict[str, str]:
    """Dependency of a form: what its fields say, without files."""
    return {name: value.strip() for name, value in (await request.form()).multi_items() if isinstance(value, str)}


async def upload_of_our_page(request: Request, upload: TheUpload) -> Upload:
    """Dependency of a form with files: its token must belong to the cookie."""
    check_csrf(request, upload.fields.get("csrf", ""))
    return upload


OurUpload = Annotated[Upload, Depends(upload_of_our_page, scope="function")]
Fields = Annotated[dict[str, str], Depends(the_fields)]


def label_given(service: TheService, fields: Fields) -> Callable[[], str]:
    """Dependency of a form with a list of labels: returns the one that it says, as `chosen`, when it is wanted."""

    def wanted() -> str:
        with service.library.reading() as session:
            known = {one for one, _ in service.counts(session)}
        return chosen(fields.get("label", ""), fields.get("another", ""), bool(fields.get("sure")), known)

    return wanted


def label_of(service: Service, upload: Upload) -> str:
    """Return the label that the form of a recording says, which is not sent again with an answer."""
    try:
        return label_given(service, upload.fields)()
    except LabelQuestion as question:
        raise Unprocessable(f"{question}. Choose that one, or tick that it is a new label.") from None


LabelGiven = Annotated[Callable[[], str], Depends(label_given)]


def near_labels(new: str, known: Collection[str]) -> list[str]:
    """Return the known labels that a new one may be a misspelling or another word of, the likeliest first.

    >>> near_labels("notches", ["normal", "notch", "play"]), near_labels("backlash", ["normal", "notch", "play"])
    (['notch'], ['play'])
    >>> near_labels("loose_mounting", ["normal", "notch", "play"])
    []
    """
    meant = {_squeezed(word): label for label in known for word in (label, *_other_words(label))}
    return list(dict.fromkeys(meant[word] for word in get_close_matches(_squeezed(new), meant)))


def _other_words(label: str) -> list[str]:
    """Return the words of the workshop for a label: that of pages, and others."""
    return [name_of(label), *OTHER_WORDS.get(label, ())]


def _squeezed(word: str) -> str:
    return re.sub(r"[^a-z0-9]", "", word.lower())


def taken_in(
    service: Service, upload: Upload, fields: Mapping[str, object], model: type[Known]
) -> tuple[Intake, Known]:
    """Take the recording of a form in, with what the form says of it."""
    with service.library.reading() as session:
        check_place(session, {**upload.fields, **fields})
    metadata: Known = read_metadata(json.dumps(fields), model)
    file = upload.file("file")
    return take_in(service.library, file.path, file.name, file.media_type, metadata), metadata


def told(fields: dict[str, str], *names: str) -> dict[str, object]:
    """Return what the form says, without what was left empty; numbers may have a decimal comma."""
    given = {name: fields.get(name, "").strip() for name in ("axis", "gearbox", *OF_RECORDING, *names)}
    return {
        name: number(NUMBERS[name], text, name, fields.get(f"{name}.unit", "")) if name in NUMBERS else text
        for name, text in given.items()
        if text
    }


def number(label: str, text: str, key: str = "", unit: str = "") -> float:
    """Return a number of a form in SI, given in a unit that the key may have; raises Unprocessable."""
    try:
        return in_si(key, text, unit)
    except ParameterError as error:
        wrong = str(error).removeprefix(f"{key}: ")
        raise Unprocessable(f"{label}: {wrong} Leave it empty if it is not known.") from None


def may_keep(principal: Principal) -> None:
    """Raise Forbidden unless somebody may change the library."""
    if not principal.role.may(Role.ADMIN):
        raise Forbidden(f"Cases are kept by admins; you are signed in with the role {principal.role}.")


def said_how(verification: str | None) -> None:
    """Raise Unprocessable unless it was said how a label was verified."""
    if not verification:
        raise Unprocessable(
            "Say how it was verified before it is kept as a case: opened and seen, measured, by ear only, or not "
            "verified."
        )


def number_of(request: Request, name: str) -> int | None:
    """Return a number from the address of a page; None where there is none."""
    text = request.query_params.get(name, "")
    return min(int(text), LARGEST_NUMBER) if text.isascii() and text.isdigit() and len(text) < 12 else None
