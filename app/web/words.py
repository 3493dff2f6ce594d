"""A diagnosis in the words of whoever stands at the robot: what it is, how sure, what to do next."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from app.web.svg import sign_of
from app.web.templating import percent, quantity, sentence
from sim.discrepancy.report.comparison import Row
from sim.discrepancy.report.formatting import angle, likely, named
from sim.mechanisms.mechanism import SECURED

NAMES = {
    "normal": "no fault indicated",
    "notch": "tooth damage (notch)",
    "play": "backlash (play)",
}
CHECKS = {
    "normal": ("Nothing to do. Record again at the next inspection, in the same motion and with the same payload.",),
    "notch": (
        "Move the axis to where it is at the time in the cycle when the impact repeats. "
        f"{SECURED} look at the teeth of the output gear that mesh there.",
        "Take a grease sample and look for steel particles.",
        "Record again with the axis moving through another range: a damaged tooth stays where it is, so its time in "
        "the cycle changes.",
    ),
    "play": (
        f"{SECURED} lock the motor and move the load by hand: the free travel is the backlash.",
        "Check the preload and the fastening of the gear stage.",
        "Record again with another payload: backlash is heard where the torque reverses.",
    ),
}
SIZES = {"depth_rad": ("Depth of the damage", "deep"), "gap_rad": ("Width of the backlash", "wide")}
"""What the size of a fault is called beside the verdict, and in it."""
CALIBRATED_FROM = 2
"""How many gearboxes must be known before how sure a diagnosis is stands in per cent."""
REJECTED_AT = 0.05
TOO_POOR = "the recording is too poor"
VERDICTS = {
    "diagnosed": "Diagnosed",
    "ambiguous": "Undecided",
    "not_in_library": "Not in the library",
    "unusable": "Unusable",
}
"""The one word of the pages for each verdict of a document."""
NOT_COMPARED = (
    "no regular motion is heard",
    "the sound has another colour",
    "the nearest cases are of good gears",
    "the nearest cases are of sound gears",
)
"""Remarks that begin so say why there is no label, and stand first; the last one is of earlier versions."""
RECORD_AGAIN = (
    "Record again for 20 s or more and three cycles of the motion or more, with the microphone at the gearbox, and "
    "avoid what is marked poor above."
)
OTHER_CHECKS = ("Compare with the nearest cases below, then inspect the place that they name.",)
UNKNOWN_CHECKS = (
    "Record the axis again to rule out a disturbance.",
    "If the sound is the same, have the gearbox inspected, and add what was found as a case with its label.",
)


@dataclass(frozen=True)
class Verdict:
    """The first thing on the page."""

    headline: str
    summary: str
    label: str | None
    checks: tuple[str, ...]
    told: tuple[str, ...] = ()
    """Remarks of the document that the summary says."""

    @property
    def sign(self) -> str:
        """Whose shape and colour it has: those of the state that it means for a gearbox."""
        return sign_of(self.label)


def name_of(label: str | None) -> str:
    """Return a label as words.

    >>> name_of("notch")
    'tooth damage (notch)'
    """
    return NAMES.get(label or "", (label or "unknown").replace("_", " "))


def listed(label: str | None) -> str:
    """Return a label as a word among others.

    >>> listed("normal"), listed("play")
    ('no fault', 'backlash (play)')
    """
    return "no fault" if label == "normal" else name_of(label)


def is_calibrated(document: Mapping[str, Any]) -> bool:
    """Whether how sure a diagnosis is was calibrated on gearboxes, and may stand in per cent."""
    return bool(document["provenance"].get("gearboxes", 0) >= CALIBRATED_FROM)


def uncalibrated(value: float) -> str:
    """Write how sure one may be where that is not calibrated: from 0 to 1, never in per cent.

    >>> uncalibrated(0.941)
    '0.94 of 1'
    """
    return f"{value:.2f} of 1"


def certainty(document: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return how sure a diagnosis is, and what that rests on; None where it says nothing."""
    if document["probability"] is None:
        return None
    gearboxes = document["provenance"].get("gearboxes", 0)
    if is_calibrated(document):
        return percent(document["probability"]), f"calibrated on {gearboxes} gearboxes"
    known = "no measured gearbox" if gearboxes == 0 else "only one measured gearbox"
    return uncalibrated(document["probability"]), f"not calibrated: the library has {known}"


def how_sure(document: Mapping[str, Any]) -> str:
    """Say how sure a diagnosis is, in a cell of a table; of one that is undecided also of what.

    >>> how_sure({"verdict": "diagnosed", "probability": 0.941, "provenance": {"gearboxes": 1}})
    '0.94 of 1'
    """
    sure = certainty(document)
    if sure is None:
        return "–"
    of = f" {listed(document['hypotheses'][0]['label'])}" if document["verdict"] == "ambiguous" else ""
    return f"{sure[0]}{of}"


def _milliradians(value_rad: float) -> Markup:
    """Write a small angle in mrad, and in minutes of arc as data sheets have it."""
    return Markup("{} ({})").format(quantity(1e3 * value_rad, "mrad", 2), angle(value_rad, 0.3 * value_rad))


def size_of(document: Mapping[str, Any]) -> tuple[str, Markup, Markup, int] | None:
    """Return name, value, interval [mrad] and number of cases behind the size of a fault; None where it has none."""
    severity = document["severity"]
    if severity is None:
        return None
    low, high = (1e3 * severity[name] for name in ("low", "high"))
    interval = Markup("{} to {}").format(quantity(low, digits=2), quantity(high, "mrad", 2))
    return SIZES[severity["parameter"]][0], _milliradians(severity["value"]), interval, severity["cases"]


def rejected(document: Mapping[str, Any]) -> list[str]:
    """Return the labels that the recording speaks against, at a p-value of at most 0.05."""
    return [h["label"] for h in document["hypotheses"] if h["p_value"] <= REJECTED_AT]


def remarks_beside(document: Mapping[str, Any]) -> list[str]:
    """Return the remarks that the words of the verdict do not say already."""
    told = verdict_of(document).told
    return [remark for remark in document.get("remarks", ()) if remark not in told]


def not_compared(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the remarks that say why a recording is none of the library's, whatever its distance."""
    return tuple(remark for remark in document.get("remarks", ()) if remark.startswith(NOT_COMPARED))


def is_poor(document: Mapping[str, Any]) -> bool:
    """Whether a quality flag forbids to rely on a label."""
    return any(flag["severity"] == "poor" for flag in document.get("quality", ()))


def verdict_of(document: Mapping[str, Any]) -> Verdict:
    """Put a diagnosis document into words."""
    label, kind = document["label"], document["verdict"]
    hypotheses, remarks = document["hypotheses"], tuple(document.get("remarks", ()))
    again = (RECORD_AGAIN,) if is_poor(document) else ()
    if kind == "unusable":
        reason = "; ".join(remarks or ["no reason was given"])
        return Verdict(
            "Unusable: the recording cannot be compared", sentence(reason), None, again or ("Record again.",), remarks
        )
    poor = tuple(remark for remark in remarks if remark.startswith(TOO_POOR))
    if kind == "not_in_library":
        summary, told = _novelty(document, poor)
        return Verdict(
            "Not in the library: unlike every known kind", summary, None, (*again, *UNKNOWN_CHECKS[len(again) :]), told
        )
    out = rejected(document)
    written = percent if is_calibrated(document) else uncalibrated
    others = [f"{listed(h['label'])} {written(h['probability'])}" for h in hypotheses[1:] if h["label"] not in out]
    also = f" Also possible: {', '.join(others[:2])}." if others else ""
    if out:
        unlike = ("a good gearbox" if one == "normal" else name_of(one) for one in out)
        also += f" It does not sound like {' or '.join(unlike)}."
    if kind == "ambiguous":
        names = " or ".join(listed(h["label"]) for h in hypotheses[:2])
        because = " ".join(map(sentence, poor)) or "It is not sure enough of any label."
        summary = f"{because} {_support(document)}{also}"
        checks = again or _between(h["label"] for h in hypotheses[:2])
        return Verdict(f"Undecided: {names}", summary, None, checks, poor)
    if label == "normal":
        summary = f"{_support(document)}{also} {limits_of(document)}"
        return Verdict("No fault indicated", summary, label, CHECKS[label])
    present = " and ".join(name_of(fault["label"]) for fault in document.get("faults", ())) or name_of(label)
    summary = f"{_size(document)}{_support(document)}{also}"
    return Verdict(f"Fault likely: {present}", summary, label, CHECKS.get(label, OTHER_CHECKS))


def limits_of(document: Mapping[str, Any]) -> str:
    """Say which faults "no fault" cannot exclude.

    >>> limits_of({"detection_limit": {"notch": {"depth_rad": 0.0008}}})
    'Tooth damage (notch) below 0.8\\xa0mrad (2.8\\xa0arc min) would not be heard here.'
    >>> limits_of({"detection_limit": {"play": None}})
    'How small backlash (play) would be heard is not known.'
    """
    limits = document.get("detection_limit") or {}
    known = {label: next(iter(limit.values())) for label, limit in limits.items() if limit}
    unknown = [label for label, limit in limits.items() if not limit]
    said = []
    if known:
        sizes = " and ".join(f"{name_of(label)} below {_milliradians(size)}" for label, size in known.items())
        said.append(f"{sizes[0].upper()}{sizes[1:]} would not be heard here.")
    if unknown:
        said.append(f"How small {' or '.join(map(name_of, unknown))} would be heard is not known.")
    return " ".join(said)


def _between(labels: Iterable[str]) -> tuple[str, ...]:
    """What tells two faults apart is what each of them asks for; that nothing is to be done cannot be said yet."""
    checks = [check for label in labels if label != "normal" for check in CHECKS.get(label, OTHER_CHECKS)]
    return tuple(dict.fromkeys((UNKNOWN_CHECKS[0], *checks)))


def _size(document: Mapping[str, Any]) -> str:
    found = size_of(document)
    if found is None:
        return ""
    how = SIZES[document["severity"]["parameter"]][1]
    return f"About {found[1]} {how} (90 % interval {found[2]}). "


def _support(document: Mapping[str, Any]) -> str:
    sure = certainty(document)
    support = document["hypotheses"][0]["support"] if document["hypotheses"] else {"measured": 0, "simulated": 0}
    beginning = f"How sure: {sure[0]}. " if sure else ""
    return (
        f"{beginning}Among the nearest cases, {support['measured']} measured and "
        f"{support['simulated']} simulated support it."
    )


def _novelty(document: Mapping[str, Any], poor: tuple[str, ...]) -> tuple[str, tuple[str, ...]]:
    """Return why a recording is none of the library's, and the remarks that this says."""
    novelty, remarks, why = document["novelty"], tuple(document.get("remarks", ())), not_compared(document)
    if why:
        unforced = "So it gets none of the known labels."
        return " ".join((*map(sentence, why), unforced, *map(sentence, poor))), (*why, *poor)
    if novelty["distance"] is None or novelty["threshold"] is None:
        nothing = "The library has nothing to compare this recording with."
        return " ".join((nothing, *map(sentence, remarks))), remarks
    far = (
        f"It lies outside the known kinds by {novelty['distance']:.2f} times the spread of normal recordings; "
        f"recordings of known kinds stay below {novelty['threshold']:.2f}. So it gets none of the known labels."
    )
    return " ".join((far, *map(sentence, poor))), poor


def investigation_headline(document: Mapping[str, Any]) -> str:
    """Say in one line what an investigation found.

    >>> investigation_headline({"verdict": "nothing_missing", "findings": []})
    'Nothing was found that these data could show'
    """
    told = document.get("story", {}).get("headline")
    if told:
        return str(told).removesuffix(".")
    if document["verdict"] == "nothing_missing":
        return "Nothing was found that these data could show"
    if document["verdict"] == "unnamed":
        return "Something is there that no known mechanism explains"
    names = [place_words(finding) for finding in document["findings"]]
    return f"Found: {', '.join(names)}"


def place_words(finding: Mapping[str, Any]) -> str:
    """Name a mechanism and where it sits."""
    return named(str(finding["mechanism"]), finding.get("location"))


def likely_words(finding: Mapping[str, Any]) -> str:
    """Say how sure a finding is.

    >>> print(likely_words({"probability": 0.95, "calibrated": False}))
    very likely (0.95 of 1, not calibrated)
    """
    return likely(float(finding["probability"]), calibrated=finding.get("calibrated", True))


def finding_words(finding: Mapping[str, Any]) -> str:
    """Say how sure a finding is, and what else it could be, as a sentence without its full stop."""
    others = [named(str(name)) for name in finding.get("indistinguishable_from", ())]
    rest = f"; in these data it looks the same as {' or '.join(others)}" if others else ""
    return f"{likely_words(finding).capitalize()}{rest}"


def comparison_headline(rows: Sequence[Row]) -> str:
    """Say in one line what became of what was found.

    >>> came = Row("backlash", "output", "came", None, None)
    >>> comparison_headline([came])
    'Came: backlash (play) at output'
    >>> comparison_headline([])
    'Nothing changed beyond what the data leave open'
    """
    told = [
        f"{word}: {', '.join(row.name for row in rows if row.became == word.lower())}"
        for word in ("Came", "Larger", "Went", "Smaller")
        if any(row.became == word.lower() for row in rows)
    ]
    return ". ".join(told) or "Nothing changed beyond what the data leave open"
