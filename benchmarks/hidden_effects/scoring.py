"""Judge what was said against what was hidden.

A run is solved when the mechanisms said with probability 0.5 or more are exactly the hidden ones (a hidden one may
also stand in a finding's `indistinguishable_from`, which lists two at most), at the right gear where one is given, and
the verdict agrees.  Nothing hidden: `nothing_missing` and no finding.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

from scipy.stats import binomtest

SAID = 0.5
SIZE_TOLERANCE = 0.15
ANGLE_TOLERANCE_RAD = math.radians(2.0)
OUTCOMES = ("right", "wrong place", "incomplete", "missed", "wrong", "false alarm", "failed")
STRENGTHS = (("at least the noise", 0.95), ("half", 0.42), ("third", 0.29), ("quarter", 0.0))
JSON = Mapping[str, Any]


@dataclass(frozen=True)
class SizeCheck:
    """One true number against the one found: relative error (angles: rad), within tolerance, within the interval."""

    name: str
    error: float
    within: bool
    covered: bool | None


@dataclass(frozen=True)
class Judgement:
    """What one run was worth.

    `outcome`: right, wrong place, incomplete, missed, wrong, failed; for nothing hidden right, false alarm, failed.
    `claims`: every finding's probability and whether it was right.
    """

    outcome: str
    solved: bool
    top: bool
    wrong_names: tuple[str, ...]
    claims: tuple[tuple[float, bool], ...]
    sizes: tuple[SizeCheck, ...] = field(default=())


def _alternatives(finding: JSON) -> tuple[str, ...]:
    listed = finding.get("indistinguishable_from") or []
    names = tuple(item["mechanism"] if isinstance(item, Mapping) else str(item) for item in listed)
    return names if len(names) <= 2 else ()


def _names(finding: JSON, hidden: JSON) -> bool:
    return hidden["mechanism"] in (finding["mechanism"], *_alternatives(finding))


def _agrees(finding: JSON, hidden: JSON) -> bool:
    """Return whether a finding names a hidden mechanism, at the right gear where one is given."""
    if finding["mechanism"] != hidden["mechanism"]:
        return _names(finding, hidden)
    return hidden["location"] is None or finding.get("location") == hidden["location"]


def names_rightly(answer: JSON, finding: JSON) -> bool:
    """Return whether a finding names something hidden, wherever that is."""
    return any(_names(finding, h) for h in answer["hidden"] if h["mechanism"] != "unnamed")


def complete(given: JSON) -> dict[str, Any]:
    """Return an answer as given in an answers.json (id, answer, size) with all that `judge` wants."""
    renamed = {"viscous_at_motor_n_m_s_per_rad": "coefficient_n_m_s_per_rad"}
    size = {renamed.get(name, name): value for name, value in given["size"].items()}
    hidden = [
        {"mechanism": mechanism, "location": place, "true_location": place, "size": size, "strength": math.inf}
        for mechanism, place in given["answer"]
    ]
    named = any(h["mechanism"] != "unnamed" for h in hidden)
    verdict = "named" if named else ("unnamed" if hidden else "nothing_missing")
    whole = {
        "hidden": hidden,
        "size": size,
        "verdict": verdict,
        "may_be_unnamed": False,
        "level": "-",
        "one_size": True,
    }
    return {"group": "mechanics" if hidden else "null", **whole, "id": given["id"]}


def judge(answer: JSON, document: JSON | None) -> Judgement:
    """Judge one document of `investigate` (None: the product failed) against a scenario's answer."""
    named = [h for h in answer["hidden"] if h["mechanism"] != "unnamed"]
    if document is None:
        return Judgement("failed", solved=False, top=False, wrong_names=(), claims=())
    findings = sorted(document["findings"], key=lambda f: -f["probability"])
    said = [f for f in findings if f["probability"] >= SAID]
    claims = tuple((float(f["probability"]), any(_agrees(f, h) for h in named)) for f in findings)
    wrong = tuple(f["mechanism"] for f in said if not names_rightly(answer, f))
    outcome = _outcome(answer, document, named, said, wrong)
    sizes = [check for h in named for f in said if _agrees(f, h) for check in check_sizes(h, f)]
    return Judgement(
        outcome,
        solved=outcome == "right",
        top=bool(findings) and any(_agrees(findings[0], h) for h in named) if named else outcome == "right",
        wrong_names=wrong,
        claims=claims,
        sizes=_nearest(sizes) if answer.get("one_size") else tuple(sizes),
    )


def _nearest(checks: Sequence[SizeCheck]) -> tuple[SizeCheck, ...]:
    """Of each name the check that is least off: it is not said to which of two effects a number belongs."""
    best: dict[str, SizeCheck] = {}
    for check in sorted(checks, key=lambda c: abs(c.error)):
        best.setdefault(check.name, check)
    return tuple(best.values())


def _outcome(answer: JSON, document: JSON, named: Sequence[JSON], said: Sequence[JSON], wrong: tuple[str, ...]) -> str:
    verdict = document["verdict"]
    if answer["verdict"] == "nothing_missing":
        return "right" if verdict == "nothing_missing" and not said else "false alarm"
    if wrong:
        return "wrong"
    if verdict == "unnamed" and not said and (answer["verdict"] == "unnamed" or answer["may_be_unnamed"]):
        return "right" if _right_frequency(answer, document) else "wrong place"
    if answer["verdict"] == "unnamed":
        return "missed"
    found = [h for h in named if any(_names(f, h) for f in said)]
    placed = [h for h in named if any(_agrees(f, h) for f in said)]
    if len(placed) == len(named) == len(said) and verdict == "named":
        return "right"
    if len(found) == len(named):
        return "wrong place"
    return "incomplete" if found else "missed"


def _right_frequency(answer: JSON, document: JSON) -> bool:
    wanted = answer["size"].get("frequency_hz") if answer["verdict"] == "unnamed" else None
    if wanted is None:
        return True
    said = (document.get("unexplained") or {}).get("frequency_hz")
    return said is not None and abs(said / wanted - 1) <= SIZE_TOLERANCE


def check_sizes(hidden: JSON, finding: JSON) -> list[SizeCheck]:
    """Compare the numbers of a finding with the true ones; none where mechanism or place differ."""
    if finding["mechanism"] != hidden["mechanism"]:
        return []
    if finding.get("location") not in (None, hidden["true_location"]) and hidden["true_location"] is not None:
        return []
    said = {p["name"]: p for p in finding["parameters"]}
    return [_check(name, true, said[name]) for name, true in hidden["size"].items() if name in said]


def _check(name: str, true: float, said: JSON) -> SizeCheck:
    value, low, high = said["value"], said.get("low"), said.get("high")
    if name == "flank":
        return SizeCheck(name, abs(value - true), value == true, None)
    if name.startswith(("angle", "phase")):
        error = abs((value - true + math.pi) % (2 * math.pi) - math.pi)
        covered = None if low is None else _inside_angle(true, low, high)
        return SizeCheck(name, error, error <= ANGLE_TOLERANCE_RAD, covered)
    error = abs(value / true - 1)
    return SizeCheck(name, error, error <= SIZE_TOLERANCE, None if low is None else low <= true <= high)


def _inside_angle(true: float, low: float, high: float) -> bool:
    return (true - low) % (2 * math.pi) <= high - low


def calibration(claims: Iterable[tuple[float, bool]], bins: int = 10) -> tuple[list[tuple[float, float, int]], float]:
    """Return (mean probability, share right, count) per bin and the expected calibration error."""
    members: defaultdict[int, list[tuple[float, bool]]] = defaultdict(list)
    for probability, right in claims:
        members[min(int(probability * bins), bins - 1)].append((probability, right))
    curve, error, total = [], 0.0, sum(len(m) for m in members.values())
    for _, held in sorted(members.items()):
        mean = sum(p for p, _ in held) / len(held)
        share = sum(right for _, right in held) / len(held)
        curve.append((mean, share, len(held)))
        error += len(held) / total * abs(mean - share)
    return curve, error if total else math.nan


def strength_of(answer: JSON) -> float:
    """Return the strength of the weakest hidden effect; infinite where nothing is hidden."""
    return min((h["strength"] for h in answer["hidden"]), default=math.inf)


def size_class(answer: JSON) -> str:
    """Return the name of the strength of the weakest hidden effect."""
    strength = strength_of(answer)
    return next(name for name, low in STRENGTHS if strength >= low)


def wilson(right: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (E. B. Wilson, 1927)."""
    found = binomtest(right, max(total, 1)).proportion_ci(method="wilson") if total else (0.0, 1.0)
    return float(found[0]), float(found[1])


Scored = tuple[JSON, Judgement]


def _share(title: str, scored: Sequence[Scored], right: Callable[[Scored], bool], wanted: str = "") -> str:
    count = sum(map(right, scored))
    low, high = wilson(count, len(scored))
    share = f"{count / len(scored):6.3f}" if scored else "     -"
    return f"{title:58s} {share}  {count:4d} of {len(scored):4d}  [{low:.3f}, {high:.3f}]  {wanted}"


def tables(scored: Sequence[Scored], seconds: Sequence[float]) -> str:
    """Return all tables of a bank as text."""
    hidden = [s for s in scored if s[0]["hidden"]]
    nulls = [s for s in scored if not s[0]["hidden"]]
    single = [s for s in hidden if s[0]["group"] in ("mechanics", "sensor")]
    unnamed = [s for s in hidden if s[0]["group"] == "unnamed"]
    loud = [s for s in single if size_class(s[0]) == "at least the noise"]
    third = [s for s in single if size_class(s[0]) == "third"]
    lines = [
        _share("top-1 right, effect at least as strong as the noise", loud, lambda s: s[1].top, ">= 0.95"),
        _share("top-1 right, a third of that", third, lambda s: s[1].top, ">= 0.85"),
        _share("wrong name with p >= 0.5", hidden, lambda s: bool(s[1].wrong_names), "<= 0.03"),
        _share("false alarms on nulls", nulls, lambda s: s[1].outcome == "false alarm", "<= 0.02"),
        _share("out of vocabulary, yet named with p >= 0.5", unnamed, lambda s: bool(s[1].wrong_names), "0"),
        _share("solved by the rule, all", scored, lambda s: s[1].solved),
        _share("the product failed", scored, lambda s: s[1].outcome == "failed", "0"),
        "",
    ]
    lines += _size_lines(scored) + _calibration_lines(scored) + _outcome_lines(scored)
    if seconds:
        lines += ["", f"seconds per run: median {median(seconds):.1f}, longest {max(seconds):.1f}"]
    return "\n".join(lines)


def _size_lines(scored: Sequence[Scored]) -> list[str]:
    checks = [check for _, judgement in scored for check in judgement.sizes]
    covered = [check for check in checks if check.covered is not None]
    return [
        f"sizes within tolerance {_ratio(sum(c.within for c in checks), len(checks))}",
        f"90 % intervals cover   {_ratio(sum(bool(c.covered) for c in covered), len(covered))}  wanted 0.80 to 0.97",
    ]


def _ratio(part: int, whole: int) -> str:
    return f"{part / whole:.3f} ({part} of {whole})" if whole else "- (0 of 0)"


def _calibration_lines(scored: Sequence[Scored]) -> list[str]:
    curve, error = calibration(claim for _, judgement in scored for claim in judgement.claims)
    lines = ["", f"expected calibration error {error:.3f}  wanted <= 0.08", "  said   right  count"]
    return lines + [f"  {mean:.3f}  {share:.3f}  {count:4d}" for mean, share, count in curve]


def _outcome_lines(scored: Sequence[Scored]) -> list[str]:
    table: defaultdict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    said: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for answer, judgement in scored:
        what = "+".join(h["mechanism"] for h in answer["hidden"]) or answer["group"]
        size = size_class(answer) if answer["hidden"] else "-"
        for row in ((what, size), (f"all {answer['group']}", size)):
            table[row][judgement.outcome] += 1
        said[what].update(judgement.wrong_names)
    lines = ["", f"{'hidden':40s} {'size':18s} " + " ".join(f"{name:>11s}" for name in OUTCOMES)]
    order = {name: place for place, (name, _) in enumerate(STRENGTHS)}
    for (what, size), counts in sorted(table.items(), key=lambda item: (item[0][0], order.get(item[0][1], 9))):
        lines.append(f"{what:40s} {size:18s} " + _counted(counts))
    confusions = [f"  {what}: {dict(counts)}" for what, counts in sorted(said.items()) if counts]
    return [*lines, "", "wrong names", *confusions] if confusions else lines


def _counted(counts: Counter[str]) -> str:
    return " ".join(f"{counts[name] or '':>11}" for name in OUTCOMES)


def several_table(alone: Sequence[Scored], together: Sequence[Scored]) -> str:
    """Return outcomes of scenarios with several recordings: by the first one alone, and by all of them."""
    lines = [f"{'several recordings':40s} {'':18s} " + " ".join(f"{name:>11s}" for name in OUTCOMES)]
    for group in sorted({answer["group"] for answer, _ in together}):
        for title, scored in (("first alone", alone), ("both together", together)):
            counts = Counter(judgement.outcome for answer, judgement in scored if answer["group"] == group)
            lines.append(f"{group:40s} {title:18s} " + _counted(counts))
    return "\n".join(lines)
