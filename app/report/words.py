"""A diagnosis in the words of whoever stands at the robot: what it is, how sure, what to do next."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from markupsafe import Markup

from app.report.formatting import WORDS, name_of, percent, person, quantity, sentence
from app.report.svg import sign_of
from casebase.gearboxes import is_too_poor
from casebase.labels import BASELINES
from casebase.reasoning.diagnosis import DIAGNOSED_FROM, EXCLUDED_BELOW
from casebase.store.models import StoredDiagnosis
from sim.investigation.report.comparison import Row
from sim.investigation.report.formatting import angle, likely, named
from sim.mechanisms.mechanism import SECURED

PLACE = "when the impact comes"
"""Stands in a check for the time in the cycle of the motion, where that is known."""
CHECKS = {
    "normal": ("Nothing to do. Record again at the next inspection, in the same motion and with the same payload.",),
    "notch": (
        f"Run the recorded motion with nobody near it, and stop it {PLACE}. {SECURED} look at the teeth "
        "of the output gear that mesh there.",
        "Take a grease sample and look for steel particles.",
        "Record again with the axis moving through another range: a damaged tooth stays where it is, so its time in "
        "the cycle changes.",
    ),
    "play": (
        f"{SECURED} keep the motor locked by its brake and move the load by hand: the free travel is the backlash.",
        "Check the preload and the fastening of the gear stage.",
        "Record again with another payload: backlash is heard where the torque reverses.",
    ),
}
SIZES = {"depth_rad": ("Depth of the damage", "deep"), "gap_rad": ("Width of the backlash", "wide")}
"""What the size of a fault is called beside the verdict, and in it."""
CALIBRATED_FROM = 2
"""How many gearboxes must be known before how sure a diagnosis is stands in per cent."""
LONG_ENOUGH_S = 20.0
TOO_POOR = "the recording is too poor"
TOO_SHORT = ("too_short", "the recording covers less than")
"""A quality flag or a remark that begins so says that the recording is too short."""
EMPTY = "the library has no case to compare with"
ONE_LABEL, TOO_FEW, SUREST = "the library knows one label alone", "too few gearboxes of", "more labelled recordings"
VERDICTS = WORDS["verdicts"]
"""The one word of the pages for each verdict of a document."""
NOT_COMPARED = "no regular motion is found"
"""A remark that begins so says why there is no label, and stands first."""
UNLIKE = "the nearest cases are "
NOT_COVERED = "no fault does not cover"
RECORD_AGAIN = (
    "Record it again for 20 s or more and three cycles of the motion or more, with the microphone at the gearbox."
)
REPAIR = "Plan its repair or exchange, and note it on the page of the gearbox when it is done."
ALIKE = "with the same motion, payload and place of the microphone"
SOON = f"Record it again soon, {ALIKE}."
OTHER_CHECKS = ("Have the gearbox inspected at its next stop.", SOON)
UNKNOWN_CHECKS = (
    f"Record it again, {ALIKE}, to rule out a disturbance.",
    "If the sound is the same, have the gearbox inspected, and add what was found as a case with its label.",
)
GO_ON = "If it is found, plan its repair or exchange, if not, an inspection: how long it can still run is not measured."
EMPTY_CHECKS = ("Add recordings of which it is known what they are, or have cases simulated; then diagnose it again.",)


@dataclass(frozen=True)
class Verdict:
    """The first thing on the page."""

    headline: str
    sure: str
    """How sure it is, with the border that it missed, or why there is no answer."""
    label: str | None
    checks: tuple[str, ...]
    told: tuple[str, ...] = ()
    """Remarks of the document, and reasons of its quality flags, that this says."""
    why: str = ""
    rest: str = ""
    """What cannot be excluded, and how many cases support it."""
    open: tuple[str, ...] = ()
    """The labels between which it is undecided, the most probable first."""
    again: bool = False
    """Whether the recording does not allow an answer, so that another one is needed first."""

    @property
    def summary(self) -> str:
        """All that is said below the headline."""
        return " ".join(filter(None, (self.sure, self.why, self.rest)))

    @property
    def sign(self) -> str:
        """Whose shape and colour it has: those of the state that it means for a gearbox."""
        return sign_of(self.label)


def one_of(left: Sequence[str]) -> str:
    """Name a fault of which it is open which, by the labels that are left.

    >>> one_of(["notch", "play"])
    'a fault, tooth damage or backlash'
    """
    return f"a fault, {' or '.join(map(name_of, left))}"


def is_calibrated(document: Mapping[str, Any]) -> bool:
    """Whether how sure a diagnosis is was calibrated on gearboxes; else that stands beside it."""
    return bool(document["provenance"].get("gearboxes", 0) >= CALIBRATED_FROM)


def certainty(document: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return how sure a diagnosis is, and what that rests on; None where it says nothing."""
    if document["probability"] is None or _knows_one_label(document):
        return None
    gearboxes = document["provenance"].get("gearboxes", 0)
    sure = _written(document["probability"])
    known = "only one measured gearbox" if gearboxes else "no measured gearbox"
    calibrated = f"calibrated on {gearboxes} gearboxes"
    return sure, calibrated if is_calibrated(document) else f"not calibrated: the library has {known}"


def names_fault(document: Mapping[str, Any]) -> bool:
    """Whether a fault is found: one that has its name, or one of which only the name is undecided."""
    if document["verdict"] == "diagnosed":
        return document["label"] not in BASELINES
    return bool(document["fault"]["present"])


def fault_words(document: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return how probable it is that there is a fault, and what that decides; None where it is not known."""
    fault = document["fault"]
    if fault["probability"] is None:
        return None
    between = f"undecided between {percent(1 - DIAGNOSED_FROM)} and {percent(DIAGNOSED_FROM)}"
    decided = {True: "a fault is likely", False: "no fault is indicated", None: between}
    return _written(fault["probability"]), f"{decided[fault['present']]}{_doubt(document)}"


def verdict_word(document: Mapping[str, Any]) -> str:
    """Return the few words for a verdict that names nothing."""
    found = document["verdict"] == "ambiguous" and names_fault(document)
    return "Fault, undecided which" if found else VERDICTS[document["verdict"]]


def in_short(document: Mapping[str, Any]) -> str:
    """Say in a row of a table what a diagnosis is and how sure."""
    verdict = verdict_of(document)
    more = _border(document)[0] if document["verdict"] == "ambiguous" else sure_words(document)
    return f"{verdict.headline}. {verdict.sure if verdict.again else more}".strip()


def how_sure(document: Mapping[str, Any]) -> str:
    """Say how sure a diagnosis is, in a cell of a table; of one that is undecided also of what.

    >>> how_sure({"verdict": "diagnosed", "probability": 0.941, "hypotheses": [], "provenance": {"gearboxes": 1}})
    '94\\xa0%, not calibrated'
    """
    sure = certainty(document)
    if sure is None or (document["verdict"] != "diagnosed" and _limit(document)[0] and not names_fault(document)):
        return "–"
    if document["verdict"] == "diagnosed":
        return f"{sure[0]}{_doubt(document)}"
    if names_fault(document):
        return f"{_written(document['fault']['probability'])} a fault{_doubt(document)}"
    return f"{sure[0]} {name_of(document['hypotheses'][0]['label'])}{_doubt(document)}"


def sure_of(document: Mapping[str, Any]) -> str:
    """Say how sure a diagnosis is: first that there is a fault, then which; empty where it says nothing.

    >>> fault = {"present": True, "probability": 0.97}
    >>> sure_of(
    ...     {"verdict": "diagnosed", "label": "notch", "probability": 0.93, "fault": fault, "hypotheses": [],
    ...      "provenance": {}}
    ... )
    'a fault 97\\xa0%, tooth damage 93\\xa0%, not calibrated'
    """
    sure, fault = certainty(document), document["fault"]["probability"]
    if sure is None:
        return ""
    label = document["label"]
    if document["verdict"] == "diagnosed" and (fault is None or label in BASELINES):
        return f"{sure[0]}{_doubt(document)}"
    more = fault is not None and label not in BASELINES and fault > document["probability"]
    first = [f"a fault {_written(fault)}"] if more else []
    return ", ".join((*first, f"{name_of(label)} {sure[0]}{_doubt(document)}"))


def not_excluded(document: Mapping[str, Any]) -> str:
    """Say which labels are left, as words among others, each with its probability; empty where that is not known."""
    if document["label"] is None or _knows_one_label(document):
        return ""
    of = {each["label"]: each["probability"] for each in document["hypotheses"]}
    left = [f"{name_of(label)} {_written(of[label])}" for label in document["labels"]]
    return ", ".join(left) or "none of the labels"


def unlikeness(document: Mapping[str, Any]) -> str:
    """Say how seldom a recording of the nearest label is as unlike its cases; empty where that is not known."""
    novelty, hypotheses = document["novelty"], document["hypotheses"]
    if novelty["distance"] is None or not hypotheses:
        return ""
    return (
        f"Of recordings of {name_of(hypotheses[0]['label'])}, {_once_in(novelty['distance'])} is as unlike their "
        f"cases; what is rarer than {_once_in(novelty['threshold'])} counts as none of them."
    )


def _once_in(distance: float) -> str:
    """Write a p-value, given as -log10 of it.

    >>> _once_in(1.699), _once_in(12.0)
    ('one in 50', 'not one in a million')
    """
    return "not one in a million" if distance > 6 else f"one in {float(f'{10**distance:.2g}'):,.0f}"


def _written(probability: float) -> str:
    """Write a probability in per cent; what falls short of the border never reaches it."""
    short = probability if probability >= DIAGNOSED_FROM else min(probability, DIAGNOSED_FROM - 0.01)
    return percent(short)


def _doubt(document: Mapping[str, Any]) -> str:
    return "" if is_calibrated(document) else ", not calibrated"


def _knows_one_label(document: Mapping[str, Any]) -> bool:
    return document["verdict"] != "diagnosed" and len(document["hypotheses"]) == 1


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


def remarks_beside(document: Mapping[str, Any]) -> list[str]:
    """Return the remarks that the words of the verdict do not say already."""
    told = verdict_of(document).told
    return [remark for remark in document["remarks"] if remark not in told]


def not_compared(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the remarks that say why a recording is none of the library's, whatever its distance."""
    return _remarks(document, NOT_COMPARED)


def _remarks(document: Mapping[str, Any], beginning: str | tuple[str, ...]) -> tuple[str, ...]:
    return tuple(remark for remark in document["remarks"] if remark.startswith(beginning))


def is_poor(document: Mapping[str, Any]) -> bool:
    """Whether a quality flag forbids to rely on a label."""
    return any(flag["severity"] == "poor" for flag in document["quality"])


def too_short(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return why a recording is too short for its answer to be relied on; nothing where it is not.

    What is unlike all that is known may be so for a shortness that is only noted, too.
    """
    brief = document.get("recording", {}).get("duration_s", LONG_ENOUGH_S) < LONG_ENOUGH_S
    noted = brief and document["verdict"] == "not_in_library"
    flags = [flag for flag in document["quality"] if flag["name"].startswith(TOO_SHORT)]
    found = [flag["reason"] for flag in flags if noted or flag["severity"] != "note"]
    return (*found, *_remarks(document, TOO_SHORT))


def verdict_of(document: Mapping[str, Any]) -> Verdict:
    """Put a diagnosis document into words: whether there is a fault, how sure, which, and what cannot be excluded."""
    match document["verdict"]:
        case "unusable":
            return _unusable(document)
        case "not_in_library":
            return _not_in_library(document)
        case "ambiguous":
            return _undecided(document)
    label, good = document["label"], document["label"] in BASELINES
    present = " and ".join(name_of(fault["label"]) for fault in document["faults"]) or name_of(label)
    headline = "No fault indicated" if good else f"Fault likely: {present}"
    short = tuple(flag["reason"] for flag in document["quality"] if flag["name"].startswith(TOO_SHORT))
    noted = (*short, *_remarks(document, SUREST), *(_remarks(document, NOT_COVERED) if good else ()))
    sure = f"{sure_words(document)}{limits_of(document) if good else _size(document)}".strip()
    sure += "".join(f" {_reason(reason)}" for reason in noted)
    rest = f"{_left(document)}{_support(document)}"
    return Verdict(headline, sure, label, checks_of(document, label), noted, why(document, [label]), rest)


def _reason(text: str) -> str:
    """Write a reason as a sentence, without its advice, which stands among what to do."""
    return sentence(text.partition("; record ")[0])


def judged(verdict: Verdict, row: StoredDiagnosis) -> Verdict:
    """Put a person's verdict first, once there is one."""
    if row.state == "open":
        return verdict
    label, by = None if row.state == "rejected" else row.revised_label or row.label, person(row.revised_by or "")
    name = "" if label is None else f"{name_of(label)}, "
    checks = UNKNOWN_CHECKS if label is None else checks_of(row.document, label)
    headline = f"{name}{row.state} by {by}"
    checks = checks if label in (None, *BASELINES) else (REPAIR, *checks)
    sure = f"The library: {verdict.headline}. {verdict.sure}"
    return replace(verdict, headline=f"{headline[:1].upper()}{headline[1:]}", sure=sure, label=label, checks=checks)


def why(document: Mapping[str, Any], labels: Sequence[str]) -> str:
    """Say in one sentence what speaks most for these labels of a diagnosis."""
    if time_in_cycle(document, document["label"]):
        where = "in one direction alone" if document["label"] == "notch" else "around its reversals"
        return f"An impact comes in each recorded cycle, {where}."
    if not labels:
        return ""
    return f"Of all known cases it sounds most like those of {' and of '.join(map(name_of, labels))}."


def sides_of(item: Mapping[str, Any]) -> Iterator[tuple[str, Markup]]:
    """Yield in words what the library holds beside a feature of a recording, and its value."""
    for side in filter(None, (item["same"], item["other"])):
        name, unit = name_of(side["label"]), item["unit"]
        if "low" in side:
            span = Markup("{} to {}").format(quantity(side["low"]), quantity(side["high"], unit))
            yield f"usual of {name}", span
        else:
            yield f"in the nearest case of {name} ({side['origin']})", quantity(side["value"], unit)


def value_of(document: Mapping[str, Any], name: str) -> float | None:
    """Return the value of a quantity of the evidence; None where it is not there, as in lists, which do without it."""
    return next((item["value"] for item in document.get("evidence", ()) if item["quantity"] == name), None)


def time_in_cycle(document: Mapping[str, Any], label: str | None) -> str:
    """Say when in the cycle of the motion the impact of a label comes; empty where that is not known."""
    phase_deg, period_s = value_of(document, f"{label}_phase"), value_of(document, "motion_period")
    if phase_deg is None or period_s is None:
        return ""
    at_s = phase_deg / 360.0 * period_s
    cycle = f"where it first turns round in the recording; one cycle is {quantity(period_s, 's')}"
    return f"{quantity(at_s, 's')} after the first reversal ({cycle})"


def checks_of(document: Mapping[str, Any] | None, label: str) -> tuple[str, ...]:
    """Return what a label asks for, with the time at which its impact comes where a diagnosis found that."""
    if label in BASELINES:
        return CHECKS["normal"]
    place = time_in_cycle(document, label) if document else ""
    return (*(check.replace(PLACE, place or PLACE) for check in CHECKS.get(label, OTHER_CHECKS)), GO_ON)


def _again(document: Mapping[str, Any]) -> tuple[str, ...]:
    poor = [WORDS["remedies"].get(flag["name"]) for flag in document["quality"] if flag["severity"] == "poor"]
    return (RECORD_AGAIN, *dict.fromkeys(filter(None, poor)))


def _unusable(document: Mapping[str, Any]) -> Verdict:
    remarks = tuple(document["remarks"])
    reason = "; ".join(remarks or ["no reason was given"])
    headline = "Unusable: too short" if too_short(document) else "Unusable: the recording cannot be compared"
    checks = _again(document) if is_poor(document) or too_short(document) else (f"Record it again, {ALIKE}.",)
    return Verdict(headline, sentence(reason), None, checks, remarks, again=True)


def _not_in_library(document: Mapping[str, Any]) -> Verdict:
    why, (limit, reasons) = not_compared(document), _limit(document)
    if _remarks(document, EMPTY):
        remarks = tuple(document["remarks"])
        summary = " ".join(map(sentence, (*too_short(document), *remarks)))
        return Verdict(f"No answer: {EMPTY}", summary, None, EMPTY_CHECKS, remarks)
    told = (*reasons, *(why or _remarks(document, UNLIKE)))
    summary = " ".join(map(_reason, (*reasons, "this says nothing of the gearbox") if limit else told))
    kinds = (
        f"the one kind it knows, {name_of(document['hypotheses'][0]['label'])}" if _knows_one_label(document) else ""
    )
    headline = f"Not in the library: unlike {kinds or 'every known kind'}"
    if limit:
        headline = f"Cannot say: the recording is {limit}"
    elif why:
        headline = f"Not in the library: {why[0].partition(',')[0]}"
    checks = _again(document) if limit or why else UNKNOWN_CHECKS
    return Verdict(headline, summary, None, checks, told, again=bool(limit))


def _undecided(document: Mapping[str, Any]) -> Verdict:
    (limit, reasons), (border, told) = _limit(document), _border(document)
    labels = [hypothesis["label"] for hypothesis in document["hypotheses"]]
    found = names_fault(document)
    likely_fault = found and not is_too_poor(document["quality"], document["fault"])
    likely = [label for label in labels if not (found and label in BASELINES)][:2]
    names = " or ".join(map(name_of, likely))
    left = "" if _knows_one_label(document) else _left(document)
    unsaid = limit or not (found or set(likely) & set(BASELINES))
    sure = " ".join(map(_reason, reasons)) if limit else border.strip()
    why_open = f"The recording is {limit}. " if limit and likely_fault else ""
    sure = f"{_is_there(document, names)}{why_open}{sure}" if unsaid else sure
    # what tells two faults apart is what each asks for first; that nothing is to be done cannot be said yet
    faults = [checks_of(document, label) for label in likely if label not in BASELINES]
    asked = [check for checks in faults for check in (checks[:-1] if len(faults) == 1 else checks[:1])]
    asked += [GO_ON] if found else []
    headline = f"Undecided: {names}"
    if likely_fault:
        headline = f"Fault likely, undecided which: {names}"
    elif limit:
        headline = f"Undecided: the recording is {limit}{f' to say which fault, {names}' if found else ''}"
    elif _knows_one_label(document):
        headline = f"Undecided: the library knows one label alone, {names}"
    checks = _again(document) if limit else tuple(dict.fromkeys((UNKNOWN_CHECKS[0], *asked)))
    label, rest = likely[0] if likely_fault else None, f"{border if limit else ''}{left}{_support(document)}"
    sounds = "" if limit else why(document, likely)
    return Verdict(headline, sure, label, checks, (*reasons, *told), sounds, rest, tuple(likely), again=bool(limit))


def _is_there(document: Mapping[str, Any], names: str) -> str:
    """Say whether there is a fault at all, with a space behind it; empty where that is not known."""
    probability, present = document["fault"]["probability"], document["fault"]["present"]
    if probability is None or _knows_one_label(document):
        return ""
    sure = f"{_written(probability)}{_doubt(document)}"
    if present:
        return f"A fault is likely ({sure}); whether it is {names} is open. "
    return f"It may {'' if present is False else 'also '}be good: a fault has {sure}. "


def is_compared(document: Mapping[str, Any]) -> bool:
    """Whether a recording that is not in the library was compared: it is good enough, and there are cases."""
    return not (_limit(document)[0] or not_compared(document) or _remarks(document, EMPTY))


def _limit(document: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """Return in two words why no answer to a recording can be relied on, and the reasons; empty where it can."""
    short, poor = too_short(document), _remarks(document, TOO_POOR)
    return "too short" if short else "too poor" if poor or is_poor(document) else "", short or poor


def _border(document: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """Say which border an undecided answer missed, and return the remarks that this says."""
    told = _remarks(document, (ONE_LABEL, TOO_FEW, SUREST))
    why = "".join(f"{sentence(remark)} " for remark in told)
    sure = sure_of(document)
    if sure and document["probability"] < DIAGNOSED_FROM:
        return f"How sure: {sure}; {_written(DIAGNOSED_FROM)} is asked for. {why}", told
    return f"{sure_words(document)}{why}", told


def sure_words(document: Mapping[str, Any] | None) -> str:
    """Say how sure a diagnosis is, as a sentence with a space behind it; empty where it says nothing."""
    sure = sure_of(document) if document else ""
    return f"How sure: {sure}. " if sure else ""


def _left(document: Mapping[str, Any]) -> str:
    left = not_excluded(document)
    return f"Cannot be excluded at {percent(EXCLUDED_BELOW)}: {left}. " if left else ""


def limits_of(document: Mapping[str, Any]) -> str:
    """Say which faults "no fault" cannot exclude.

    >>> limits_of({"detection_limit": {"notch": {"depth_rad": 0.0008}}})
    'Tooth damage below 0.8\\xa0mrad (2.8\\xa0arc min) would not be heard here.'
    >>> limits_of({"detection_limit": {"play": None}})
    'How small backlash would be heard is not known.'
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


def _size(document: Mapping[str, Any]) -> str:
    found = size_of(document)
    return f"About {found[1]} {SIZES[document['severity']['parameter']][1]}. " if found else ""


def _support(document: Mapping[str, Any]) -> str:
    support = document["hypotheses"][0]["support"] if document["hypotheses"] else {"measured": 0, "simulated": 0}
    return f"Among the nearest cases, {support['measured']} measured and {support['simulated']} simulated support it."


def investigation_headline(document: Mapping[str, Any]) -> str:
    """Say in one line what an investigation found."""
    return str(document["story"]["headline"]).removesuffix(".")


def likely_words(finding: Mapping[str, Any]) -> str:
    """Say how sure a finding is.

    >>> print(likely_words({"probability": 0.95, "calibrated": False}))
    very likely (95\xa0%, not calibrated)
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
    'Came: backlash at output'
    >>> comparison_headline([])
    'Nothing changed beyond what the data leave open'
    """
    told = [
        f"{word}: {', '.join(row.name for row in rows if row.became == word.lower())}"
        for word in ("Came", "Larger", "Went", "Smaller")
        if any(row.became == word.lower() for row in rows)
    ]
    return ". ".join(told) or "Nothing changed beyond what the data leave open"
