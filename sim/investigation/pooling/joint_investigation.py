"""Several recordings of one axis together: each is investigated by itself, then they are held against each other.

Every recording has clock, sensors, noise and start of its own, so that they meet at the level of evidence. Mechanisms
of the machine exist in all of them or in none; what belongs to a recording alone (`is_own`) stays with it. What each
says of a name:

- one that names it: how sure it is that the effect exists, and by how much the name beats each rival;
- one that names a rival in its place: the same, the other way round;
- every one is asked: its model has to take the mechanism as the others found it, each number held to their interval.
  What that costs or gains it, in squares, is its log likelihood ratio (`pooling.silent`): nothing, where it could not
  have seen an effect of that size. One that names it says no more for it than that; one that does not, nothing for it;
  one whose unseen rows are predicted worse denies it.

Numbers come from models that have the same mechanisms in all recordings, refitted where one had others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

from sim.description.axis import Axis
from sim.errors import SimulationError
from sim.investigation.assessment.intervals import NO_SIZE
from sim.investigation.assessment.residual_structure import structure_of
from sim.investigation.assessment.verdict import is_beyond_new
from sim.investigation.data.pairing import distinct
from sim.investigation.data.validation import InvestigationError, examine
from sim.investigation.hypotheses.identifiability import ALONE
from sim.investigation.investigate import Progress, investigate, with_action
from sim.investigation.next_measurement.advice import in_words
from sim.investigation.pooling.pooled_estimates import (
    ANGLES,
    NamedRecording,
    Part,
    calibrated,
    denied,
    extension,
    pooled_sizes,
    sizes,
    under_one_model,
)
from sim.investigation.pooling.recording_evidence import (
    Name,
    Weighed,
    against,
    called,
    existence,
    finding_named,
    found_at,
    is_own,
    logistic,
    shows,
    the_same_together,
    weighed,
)
from sim.investigation.report.formatting import named as in_full
from sim.investigation.report.maintenance_actions import SURE
from sim.investigation.report.wording import explain, next_measurement
from sim.investigation.results import REPORTED, Estimate, Finding, Investigation, MeasurementUtility
from sim.investigation.unexplained import Unexplained

Done = TypeVar("Done")
AGAINST = -1.0  # log odds from which a recording is told to speak against a name
INVESTIGATING = 0.85  # of the whole time


@dataclass(frozen=True)
class Together:
    """What all recordings say: `combined` reads as the investigation of one, `shown` which of them show a finding."""

    combined: Investigation
    parts: tuple[Part, ...]
    shown: tuple[tuple[str, ...], ...]

    def document(self) -> dict[str, object]:
        """JSON of the contract, with `recordings`, and the recording beside each gain."""
        document = self.combined.document()
        whose = [part.recording.name for part in self.parts for _ in part.gain]
        gained: list[dict[str, object]] = document["gain"]  # type: ignore[assignment]
        found: list[dict[str, object]] = document["findings"]  # type: ignore[assignment]
        document["gain"] = [{**one, "recording": name} for one, name in zip(gained, whose, strict=True)]
        document["findings"] = [{**one, "shown_by": list(names)} for one, names in zip(found, self.shown, strict=True)]
        document["recordings"] = [
            {"name": part.recording.name, "sound": part.recording.sound_name, **_without_axis(part.result.document())}
            for part in self.parts
        ]
        return document


def _without_axis(document: Mapping[str, object]) -> dict[str, object]:
    return {key: value for key, value in document.items() if key != "extended_axis"}


def investigate_together(
    axis: Axis,
    recordings: Sequence[NamedRecording],
    progress: Progress = lambda stage, share: None,
    sound_offset_s: float = 0.0,
) -> Together:
    """Hold several recordings of one axis against its description.

    Raises
    ------
    InvestigationError
        for a recording that cannot be what it claims, or that is given twice; the text begins with its name.
    """
    names = distinct([taken.name for taken in recordings])
    recordings = [replace(taken, name=name) for taken, name in zip(recordings, names, strict=True)]
    _refuse_twice(recordings)
    for taken in recordings:  # before any of them takes its time
        _named(taken.name, partial(examine, axis, taken.telemetry))
    results = []
    for place, taken in enumerate(recordings):

        def told(stage: str, share: float, place: int = place) -> None:
            done = INVESTIGATING * (place + share) / len(recordings)
            progress(f"recording {place + 1} of {len(recordings)}: {stage}", done)

        work = partial(investigate, axis, taken.telemetry, taken.sound, told, sound_offset_s)
        results.append(_named(taken.name, work))
    progress("held against each other", INVESTIGATING)
    return _combined(axis, recordings, results, progress)


def _named(name: str, work: Callable[[], Done]) -> Done:
    """Do it; an error begins with the name of the recording."""
    try:
        return work()
    except SimulationError as error:
        raise InvestigationError(f"{name}: {error}") from error


def _refuse_twice(recordings: Sequence[NamedRecording]) -> None:
    """The same measured values twice are no second evidence."""
    for place, one in enumerate(recordings):
        for other in recordings[:place]:
            first, second = one.telemetry.channels, other.telemetry.channels
            if first.keys() == second.keys() and all(first[k].tobytes() == second[k].tobytes() for k in first):
                raise InvestigationError(
                    f"{one.name}: holds the same values as {other.name}; give every recording once, since the same "
                    "one twice says no more"
                )


def _combined(
    axis: Axis, recordings: Sequence[NamedRecording], results: Sequence[Investigation], progress: Progress
) -> Together:
    named = weighed(results)
    said, parts = _under_one_model(recordings, results, named, progress)
    if worse := denied(parts, said):
        named = weighed(results, worse)
        said, parts = _under_one_model(recordings, results, named, progress)
    own = _own(parts, named)
    named = {name: one for name, one in named.items() if not is_own(name)}
    said = [name for name in said if not is_own(name)]
    known = {name: sizes(parts, name, one.sayings) for name, one in named.items()}
    numbers = {name: pooled_sizes(name, by_recording) for name, by_recording in known.items()}
    told = [(name, with_action(axis, _finding(results, name, one, numbers[name]))) for name, one in named.items()]
    told = sorted([*told, *own.items()], key=lambda one: -one[1].probability)
    findings = tuple(finding for _, finding in told)
    real = any(existence(one.sayings) > 0.0 for one in named.values())
    verdict, rest = _verdict(parts, findings, real)
    calibration = calibrated(parts)
    everywhere = {name: f for name, f in own.items() if all(shows(part.result, name) for part in parts)}
    guided = any(part.problem.guided for part in parts)
    predicted = open_to(recordings, results, findings, named)
    combined = Investigation(
        axis, verdict, findings, rest[0] if rest else None, calibration, tuple(g for part in parts for g in part.gain),
        in_words(predicted) or next_measurement(axis, findings, rest, guided),
        extension(axis, parts, said, known, numbers, calibration, everywhere), _provenance(results),
        _rejected(results, named), _remarks(parts, named, known), predicted,
    )  # fmt: skip
    progress("done", 1.0)
    return Together(combined, tuple(parts), tuple(_showing(parts, name) for name, _ in told))


def _under_one_model(
    recordings: Sequence[NamedRecording],
    results: Sequence[Investigation],
    named: Mapping[Name, Weighed],
    progress: Progress,
) -> tuple[list[Name], list[Part]]:
    """Names of telemetry that are said, and each recording under them."""
    said = [name for name, one in named.items() if one.probability >= REPORTED and found_at(results, name) is not None]
    parts = []
    for place, (taken, result) in enumerate(zip(recordings, results, strict=True)):
        progress(f"recording {place + 1} of {len(results)}: numbers under one model", 0.9 + 0.07 * place / len(results))
        parts.append(under_one_model(taken, result, results, said))
    return said, parts


def open_to(
    recordings: Sequence[NamedRecording],
    results: Sequence[Investigation],
    findings: Sequence[Finding],
    named: Mapping[Name, Weighed],
) -> tuple[MeasurementUtility, ...]:
    """What measurements would tell of the said name that is least sure by all recordings; empty where none is open.

    As the recording predicts it, from its own motion, in whose place that tells most for its effort; of rivals that the
    recordings surely tell from it together, nothing.
    """
    settled = {
        (in_full(name.mechanism, name.location), in_full(rival.mechanism, rival.location))
        for name, one in named.items()
        for rival, odds in against(one.sayings).items()
        if logistic(odds) >= SURE
    }
    said = [f for f in findings if f.probability >= REPORTED] or findings
    for finding in sorted(said, key=lambda f: f.probability):
        if finding.probability >= SURE and not finding.indistinguishable_from:
            continue
        name = in_full(finding.mechanism, finding.location)
        alike = tuple(in_full(m, None) for m in finding.indistinguishable_from) or ("",)
        tables = [
            [
                replace(told, text=f"{told.text} (as in {taken.name})")
                for told in result.next_measurements
                if told.between[0] == name and told.between[1].startswith(alike) and told.between not in settled
            ]
            for taken, result in zip(recordings, results, strict=True)
        ]
        best = max(tables, key=lambda table: table[0].worth if table else 0.0)
        if best:
            return tuple(best)
    return ()


def _verdict(parts: Sequence[Part], findings: Sequence[Finding], real: bool) -> tuple[str, list[Unexplained]]:
    """As of one recording; what is left in any of them is left. `real`: some effect is there, whatever its name."""
    rest = [part.unexplained for part in parts if part.unexplained]
    named = any(finding.probability >= REPORTED for finding in findings)
    if real and not named and not rest:
        rest = [place for part in parts for place in structure_of(part.problem, part.fit)[:1]]
    rest.sort(key=lambda u: -u.score)
    return "named" if named else "unnamed" if rest else "nothing_missing", rest


def _showing(parts: Sequence[Part], name: Name) -> tuple[str, ...]:
    return tuple(part.recording.name for part in parts if shows(part.result, name))


def _own(parts: Sequence[Part], weighed: Iterable[Name]) -> dict[Name, Finding]:
    """What belongs to recordings and not to the axis, each once, as the surest of them says it."""
    kept = set(weighed)
    all_of = [f for part in parts for f in part.result.findings if is_own(called(f)) and called(f) in kept]
    surest = {called(f): f for f in sorted(all_of, key=lambda f: f.probability)}
    return {
        name: replace(f, explanation=f"In {', '.join(_showing(parts, name))}: {f.explanation}")
        for name, f in surest.items()
    }


def _finding(results: Sequence[Investigation], name: Name, one: Weighed, numbers: Sequence[Estimate]) -> Finding:
    """With the pooled numbers; of what was only heard in the words of the recording that is surest of it."""
    surest = max((f for r in results if (f := finding_named(r, name))), key=lambda f: f.probability)
    told = surest.explanation
    sure = one.probability
    if found_at(results, name) is not None:
        told = explain(name.mechanism, name.location, {e.name: e.value for e in numbers}, one.elsewhere)
        axis = results[0].axis
        open_in_each = one.indistinguishable_from and all(
            f.probability <= ALONE for r in results if (f := finding_named(r, name))
        )
        if (
            open_in_each
            or the_same_together(results, name)[1]
            or not is_beyond_new(axis, name.mechanism, name.location, numbers)
        ):
            sure = min(sure, ALONE)  # what none of them shows, all of them together do not
    return Finding(name.mechanism, name.location, sure, tuple(numbers), one.indistinguishable_from, told)


def _remarks(
    parts: Sequence[Part], named: Mapping[Name, Weighed], known: Mapping[Name, Mapping[str, Sequence[Estimate]]]
) -> tuple[str, ...]:
    out = []
    for name, one in named.items():
        showing = _showing(parts, name)
        who = zip(parts, one.sayings, strict=True)
        other = [
            part.recording.name
            for part, saying in who
            if saying.exists < AGAINST and part.recording.name not in showing
        ]
        line = f"{name}: {len(showing)} of {len(parts)} recordings show it"
        out.append(": ".join([line, ", ".join(showing)]) if showing else line)
        out[-1] += f"; against it: {', '.join(other)} (unless the axis has changed in between)." if other else "."
        out += changed(str(name), known[name])
    unnamed = [part.recording.name for part in parts if part.unexplained]
    if unnamed:
        out.append(
            f"Something that has no name is left in {len(unnamed)} of {len(parts)} recordings: {', '.join(unnamed)}."
        )
    common = dict.fromkeys(remark for part in parts for remark in part.result.remarks)
    for remark in common:
        whose = [part.recording.name for part in parts if remark in part.result.remarks]
        out.append(remark if len(whose) == len(parts) else type(remark)(f"{', '.join(whose)}: {remark}"))
    return tuple(out)


def changed(name: str, sizes: Mapping[str, Sequence[Estimate]]) -> list[str]:
    """Numbers whose 90 % intervals in the first and the last recording lie apart by over a tenth of their width."""
    if len(sizes) < 2:
        return []
    (first, before), (last, after) = (list(sizes.items())[k] for k in (0, -1))
    out = []
    for a, b in ((a, b) for a in before for b in after if a.name == b.name and a.name not in ("form", "flank")):
        turn = 2.0 * math.pi * round((b.value - a.value) / (2.0 * math.pi)) if a.name in ANGLES else 0.0
        apart = max(b.low - turn - a.high, a.low - (b.high - turn))
        if apart <= 0.1 * max(a.high - a.low, b.high - b.low):
            continue
        how = "differs" if a.name in NO_SIZE else "grew" if abs(b.value) > abs(a.value) else "fell"
        out.append(f"{name}: {a.name} {how} from {a.value:.3g} to {b.value:.3g} {a.unit} between {first} and {last}.")
    return out


def _rejected(results: Sequence[Investigation], named: Iterable[Name]) -> tuple[tuple[str, float], ...]:
    """Gains of what no recording named, added up."""
    total: dict[str, float] = {}
    for result in results:
        for key, gain in result.rejected:
            total[key] = total.get(key, 0.0) + gain
    keys = {f"{n.mechanism}@{n.location}" for n in named}
    return tuple(sorted(((k, g) for k, g in total.items() if k not in keys), key=lambda x: (-x[1], x[0])))[:6]


def _provenance(results: Sequence[Investigation]) -> dict[str, object]:
    all_of = [result.provenance for result in results]
    joined = {
        key: "+".join(str(p[key]) for p in all_of if p[key]) or None for key in ("telemetry_sha256", "sound_sha256")
    }
    rows = sum(int(str(p["rows"])) for p in all_of)
    rate = max(float(str(p["rate_hz"])) for p in all_of)
    return {**all_of[0], **joined, "rows": rows, "rate_hz": rate, "recordings": len(results)}
