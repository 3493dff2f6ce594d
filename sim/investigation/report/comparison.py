"""Two investigations of one axis side by side: what came, what went, and what has another size."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sim.investigation.report.box import Size, is_number, is_shown, size_of
from sim.investigation.report.formatting import likely, named, words_of
from sim.investigation.results import REPORTED
from sim.mechanisms import MECHANISMS
from sim.mechanisms.catalogue import kind_or_any

Document = Mapping[str, Any]
Became = Literal["came", "went", "larger", "smaller", "as before", "not compared", "not examined"]


@dataclass(frozen=True)
class Side:
    """What one of the two says of a mechanism: how sure, and its sizes."""

    how_sure: str
    sizes: tuple[Size, ...]


@dataclass(frozen=True)
class Row:
    """A mechanism at a place, before and after; None where it was not found."""

    mechanism: str
    location: str | None
    became: Became
    before: Side | None
    after: Side | None

    @property
    def name(self) -> str:
        """In words."""
        return named(self.mechanism, self.location)


@dataclass(frozen=True)
class Value:
    """A number of the description, before and after; the interval of the difference leaves out 0 where it changed."""

    name: str
    became: Became
    before: Size
    after: Size


def findings_compared(before: Document, after: Document) -> list[Row]:
    """Every finding that is said by either, what came first."""
    left, right = _said(before), _said(after)
    rows = []
    for one in right:
        same = next((other for other in left if _is_same(one, other)), None)
        if same is None:
            rows.append(_row(one, None, one, "not examined" if _is_unseen(before, one) else "came"))
        else:
            left.remove(same)
            rows.append(_row(one, same, one, _became(same, one)))
    rows += [_row(one, one, None, "not examined" if _is_unseen(after, one) else "went") for one in left]
    order = {word: place for place, word in enumerate(("came", "larger", "went", "smaller"))}
    return sorted(rows, key=lambda row: order.get(row.became, len(order)))


def values_compared(before: Document, after: Document) -> list[Value]:
    """Numbers of the description that both have estimated, what changed first."""
    earlier = {one["name"]: one for one in before["parameters"]}
    rows = []
    for one in after["parameters"]:
        if (other := earlier.get(one["name"])) is not None:
            sizes = [size_of("", {**each, "value": each["estimate"]}) for each in (other, one)]
            became = _changed(*({**each, "value": each["estimate"]} for each in (other, one)))
            rows.append(Value(words_of(one["name"]), became, *sizes))
    return sorted(rows, key=lambda row: row.became not in ("larger", "smaller"))


def _said(document: Document) -> list[Document]:
    return [one for one in document["findings"] if one["probability"] >= REPORTED]


def _is_same(one: Document, other: Document) -> bool:
    """Of several at one place, the one whose number that tells them apart is the same within both intervals."""
    if (one["mechanism"], one["location"]) != (other["mechanism"], other["location"]):
        return False
    told = kind_or_any(one["mechanism"]).traits.identified_by
    first, second = (next((p for p in each["parameters"] if p["name"] == told), None) for each in (one, other))
    if first is None or second is None or f"{first['value']:.3g}" == f"{second['value']:.3g}":
        return True
    return _changed(first, second) == "as before"


def _is_unseen(document: Document, finding: Document) -> bool:
    return finding["mechanism"] in document.get("not_examined", {})


def _row(finding: Document, before: Document | None, after: Document | None, became: Became) -> Row:
    return Row(finding["mechanism"], finding["location"], became, _side(before), _side(after))


def _side(finding: Document | None) -> Side | None:
    if finding is None:
        return None
    shown = (p for p in finding["parameters"] if is_shown(finding["mechanism"], p["name"], p.get("low"), p.get("high")))
    sure = likely(finding["probability"], calibrated=finding.get("calibrated", True))
    return Side(sure, tuple(size_of(finding["mechanism"], p) for p in shown))


def _became(before: Document, after: Document) -> Became:
    """By the first number that says how large it is."""
    kind = MECHANISMS.get(before["mechanism"])
    for name in kind.sizes() if kind else [one["name"] for one in before["parameters"]]:
        pair = [next((p for p in each["parameters"] if p["name"] == name), None) for each in (before, after)]
        if pair[0] is not None and pair[1] is not None:
            return _changed(pair[0], pair[1])
    return "not compared"


def _changed(before: Document, after: Document) -> Became:
    """Whether the difference of two independent estimates leaves out 0, at 90 %; without intervals nothing is said."""
    widths = [_half(before), _half(after)]
    if widths[0] is None or widths[1] is None:
        return "not compared"
    difference = abs(after["value"]) - abs(before["value"])
    if abs(difference) <= math.hypot(*(width for width in widths if width is not None)):
        return "as before"
    return "larger" if difference > 0.0 else "smaller"


def _half(one: Document) -> float | None:
    """Half of a 90 % interval; those of a difference add up as squares."""
    low, high = one.get("low"), one.get("high")
    if not (is_number(one["value"]) and isinstance(low, int | float) and isinstance(high, int | float) and high > low):
        return None
    return 0.5 * (high - low)
