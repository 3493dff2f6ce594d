"""What a message says, a sentence for people, a document for programs; and why it was not taken."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

from app.report.formatting import name_of
from app.report.words import SOON, VERDICTS, one_of
from casebase.errors import InvalidRequestError
from casebase.store.models import Delivery

SCHEMA = "gearcase-alarm/1"
DISCLAIMER = "This is an aid for people who maintain gearboxes, not a safety function."


class DeliveryError(InvalidRequestError):
    """A receiver did not take a message, or cannot take any; the text says why and holds no secret."""


class RefusedError(DeliveryError):
    """The receiver will not take it however often it is sent."""


@dataclass(frozen=True)
class Message:
    """One message as it goes out.

    Args:
        id: the same at every attempt, by which a receiver knows one that comes twice.
        at: when it was put into the outbox.
        subject: one sentence.
        lines: what else there is to say, a sentence each.
        facts: the same for programs, JSON.
    """

    id: str
    at: datetime
    subject: str
    lines: tuple[str, ...]
    facts: Mapping[str, Any]

    @property
    def document(self) -> dict[str, object]:
        """The message for programs."""
        return {
            "schema": SCHEMA,
            "id": self.id,
            "at": self.at.isoformat(),
            "sentence": self.subject,
            **self.facts,
        }

    @property
    def json(self) -> bytes:
        """The document as it is sent, and signed."""
        return json.dumps(self.document, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()

    @property
    def text(self) -> str:
        """The message for people."""
        return "\n\n".join((self.subject, *self.lines, DISCLAIMER)) + f"\n\nMessage {self.id}\n"


def message_of(delivery: Delivery, zone: str, public_url: str | None) -> Message:
    """Return the message of a delivery.

    Args:
        zone: of the site, in which times are written.
        public_url: where the pages are; there is no link where None.
    """
    facts: dict[str, Any] = dict(delivery.message)
    try:
        subject, lines = _WORDS[facts["kind"]](facts, zone)
    except (KeyError, TypeError, ValueError):  # of another version: an alarm without a sentence is still an alarm
        subject, lines = "A message that this version cannot put into words", (json.dumps(facts),)
    if public_url and facts.get("diagnosis_id"):
        facts["link"] = f"{public_url.rstrip('/')}/diagnoses/{facts['diagnosis_id']}"
        lines = (*lines, f"Open {facts['link']}")
    return Message(delivery.id, delivery.created_at, subject, lines, facts)


def subject_of(facts: Mapping[str, Any]) -> str:
    """Name the gearbox that is meant.

    >>> subject_of({"axis": "bench", "gearbox": "g1"}), subject_of({"axis": "bench", "gearbox": None})
    ('Gearbox g1 of axis bench', 'Axis bench')
    """
    axis, gearbox = facts["axis"], facts["gearbox"]
    if gearbox is None:
        return f"Axis {axis}"
    return f"Gearbox {gearbox}" if axis is None else f"Gearbox {gearbox} of axis {axis}"


def _of_state(facts: Mapping[str, Any], zone: str) -> tuple[str, tuple[str, ...]]:
    label, left = facts.get("label"), facts.get("labels")
    if label is None and not left:
        said = VERDICTS[facts["verdict"]].lower()
    else:
        said = name_of(label) if label else one_of(left or ())
        if facts["probability"] is not None:
            doubt = "" if facts["calibrated"] else " (not calibrated)"
            said += f", how sure: {100 * facts['probability']:.0f} %{doubt}"
        if facts["size_rad"] is not None:
            said += f", size {1000 * facts['size_rad']:.2g} mrad"
    heard = f"It was recorded on {_local(facts['heard_at'], zone)}."
    return f"{subject_of(facts)}: {said}", (heard, _rule(facts), "This is sent once, until this has been over.")


def _of_silence(facts: Mapping[str, Any], zone: str) -> tuple[str, tuple[str, ...]]:
    days = facts["silent_days"]
    return (
        f"{subject_of(facts)}: no recording for {days:g} {'day' if days == 1 else 'days'}",
        (
            f"The last one is of {_local(facts['heard_at'], zone)}.",
            "Look whether the recorder runs. If the gearbox was exchanged, note it on its page. If it stands still, "
            "there is nothing to do.",
            _rule(facts),
            "This is sent once, until it is heard again.",
        ),
    )


def _of_change(facts: Mapping[str, Any], zone: str) -> tuple[str, tuple[str, ...]]:
    return (
        f"{subject_of(facts)}: it sounds otherwise than it did",
        (
            f"The change began about {_local(facts['began_at'], zone)}. The page of the gearbox shows what changed.",
            SOON,
            _rule(facts),
            "This is sent once, until this has been over.",
        ),
    )


def _of_test(facts: Mapping[str, Any], _zone: str) -> tuple[str, tuple[str, ...]]:
    return "This is a test of Gearcase", (f"It was asked for by {facts['asked_by']}. No gearbox is meant.",)


def _rule(facts: Mapping[str, Any]) -> str:
    return f"The rule is {facts['rule']!r}."


def _local(moment: str, zone: str) -> str:
    local = datetime.fromisoformat(moment).astimezone(ZoneInfo(zone))
    return f"{local:%Y-%m-%d %H:%M} {local.tzname()}"


_WORDS = {"state": _of_state, "change": _of_change, "silence": _of_silence, "test": _of_test}
