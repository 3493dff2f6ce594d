"""The rule by which answers are judged, and the tables of a bank.

Said is what has a probability of 0.5 or more. A finding is right where its joint is that of what is hidden and its
mechanism, or one that it cannot be told from (two at most), is the hidden one. Dry and viscous friction of joints
without an axis file are real and not described: right at every joint. Everything else that is said is invented.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

from scipy.stats import binomtest

SAID = 0.5
SURE = 0.9
PARAMETER_TOLERANCE = 0.2
OUTCOMES = ("right", "and more", "wrong name", "wrong joint", "missed", "unnamed", "invented", "failed")
JSON = Mapping[str, Any]


@dataclass(frozen=True)
class Size:
    """A true number against the one that was said: relative error (phases: rad), and whether the interval holds it."""

    name: str
    error: float
    covered: bool | None


@dataclass(frozen=True)
class Judgement:
    """What an answer was worth.

    outcome: `right`; `and more` (found, but something invented besides); `wrong name` at the right joint; `wrong
    joint`; `missed`; for nothing hidden right, `unnamed` or `invented`; `failed`. claims: probability of each finding
    and whether it was right. invented: what was said besides, as mechanism@joint. friction: of what is real and not
    described, by dry and viscous, the sizes said and None for each that was not. unexplained: whether something is said
    to be left. left: torque error on unseen data over the rms of the noise, joint by joint.
    """

    outcome: str
    claims: tuple[tuple[float, bool], ...] = ()
    invented: tuple[str, ...] = ()
    sizes: tuple[Size, ...] = ()
    friction: tuple[Size | None, ...] = ()
    unexplained: bool = False
    left: tuple[float, ...] = ()


def joint_of(finding: JSON) -> str | None:
    """Return the joint that a finding is about: what stands before the slash."""
    location = finding.get("location")
    return None if location is None else str(location).split("/")[0]


def _names(finding: JSON) -> tuple[str, ...]:
    listed = finding.get("indistinguishable_from") or []
    others = tuple(str(item["mechanism"] if isinstance(item, Mapping) else item) for item in listed)
    return (finding["mechanism"], *(others if len(others) <= 2 else ()))


def _is(finding: JSON, hidden: JSON) -> bool:
    if hidden["as_parameter"] or hidden["mechanism"] not in _names(finding):
        return False
    if hidden["mechanism"] == "payload":
        return bool(finding["mechanism"] == "payload")
    return joint_of(finding) == hidden["location"]


def _is_friction(answer: JSON, finding: JSON) -> bool:
    mechanism = finding["mechanism"] in ("coulomb_friction", "viscous_friction")
    return mechanism and joint_of(finding) in answer["friction"]


def judge(answer: JSON, document: JSON | None) -> Judgement:
    """Judge a document; None is a run that failed."""
    if document is None:
        return Judgement("failed")
    judged = _judge(answer, document)
    return replace(judged, unexplained=bool(document.get("unexplained")), left=_left(answer, document))


def _left(answer: JSON, document: JSON) -> tuple[float, ...]:
    errors = [g for g in document.get("gain") or [] if g["channel"] == "motor_torque_nm" and g.get("held_out")]
    return tuple(g["rms_after"] / answer["noise"][g["joint"]] for g in errors if g.get("joint") in answer["noise"])


def _judge(answer: JSON, document: JSON) -> Judgement:
    hidden = answer["hidden"][0] if answer["hidden"] else None
    findings = document["findings"]
    right = [bool(hidden and _is(f, hidden)) or _is_friction(answer, f) for f in findings]
    claims = tuple((float(f["probability"]), ok) for f, ok in zip(findings, right, strict=True))
    said = [(f, ok) for f, ok in zip(findings, right, strict=True) if f["probability"] >= SAID]
    invented = [f for f, ok in said if not ok]
    names = tuple(f"{f['mechanism']}@{f.get('location')}" for f in invented)
    friction = _friction_sizes(answer, [f for f, _ in said])
    if hidden is None:
        outcome = "invented" if invented else "unnamed" if document["verdict"] == "unnamed" else "right"
        return Judgement(outcome, claims, names, (), friction)
    sizes: tuple[Size, ...] = ()
    if hidden["as_parameter"]:
        sizes = _parameter_sizes(hidden, document)
        found = any(size.covered or size.error <= PARAMETER_TOLERANCE for size in sizes)
    else:
        fitting = [f for f, _ in said if _is(f, hidden)]
        found = bool(fitting)
        own = [f for f in fitting if f["mechanism"] == hidden["mechanism"]]
        sizes = _sizes(hidden["sizes"], own[0]["parameters"]) if own else ()
    if found:
        outcome = "and more" if invented else "right"
    elif any(joint_of(f) == hidden["location"] for f in invented):
        outcome = "wrong name"
    elif invented:
        outcome = "wrong joint"
    elif hidden["may_be_missed"]:
        outcome = "right"
    else:
        outcome = "unnamed" if document["verdict"] == "unnamed" else "missed"
    return Judgement(outcome, claims, names, sizes, friction)


def _sizes(true: Mapping[str, float], said: Iterable[JSON]) -> tuple[Size, ...]:
    """Compare what has the same name."""
    return tuple(_size(true[p["name"]], p) for p in said if p["name"] in true)


def _size(true: float, said: JSON) -> Size:
    name = str(said["name"])
    value = said["value"] if "value" in said else said["estimate"]
    low, high = said.get("low"), said.get("high")
    if name.startswith("phase"):
        error = abs((value - true + math.pi) % (2 * math.pi) - math.pi)
        inside = None if low is None else (true - low) % (2 * math.pi) <= high - low
        return Size(name, error, inside)
    # a place of some centimetres has an error in metres, all else relative to the truth
    error = abs(value - true) if name.startswith("center") else abs(value / true - 1)
    return Size(name, error, None if low is None else bool(low <= true <= high))


def _parameter_sizes(hidden: JSON, document: JSON) -> tuple[Size, ...]:
    """Compare the parameters `JOINT.(...)NAME` of what is described with another value."""
    found = []
    for one in document.get("parameters") or []:
        place, _, name = str(one["name"]).rpartition(".")
        if place.split(".")[0] == hidden["location"] and name in hidden["sizes"] and one.get("estimate") is not None:
            found.append(_size(hidden["sizes"][name], {**one, "name": name}))
    return tuple(size for size in found if not size.name.startswith("center"))


def _friction_sizes(answer: JSON, said: Sequence[JSON]) -> tuple[Size | None, ...]:
    parameter = {
        "coulomb_friction": ("dry", "torque_n_m"),
        "viscous_friction": ("viscous", "coefficient_n_m_s_per_rad"),
    }
    out: list[Size | None] = []
    for joint, true in answer["friction"].items():
        for mechanism, (kind, name) in parameter.items():
            found = [f for f in said if f["mechanism"] == mechanism and joint_of(f) == joint]
            sizes = _sizes({name: true[kind]}, found[0]["parameters"]) if found else ()
            out.append(sizes[0] if sizes else None)
    return tuple(out)


def wilson(right: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a share (E. B. Wilson, 1927)."""
    found = binomtest(right, max(total, 1)).proportion_ci(method="wilson") if total else (0.0, 1.0)
    return float(found[0]), float(found[1])


def _share(title: str, right: int, total: int, wanted: str = "") -> str:
    low, high = wilson(right, total)
    share = f"{right / total:6.3f}" if total else "     -"
    return f"{title:54s} {share}  {right:4d} of {total:4d}  [{low:.3f}, {high:.3f}]  {wanted}"


def tables(scored: Sequence[tuple[JSON, Judgement]], seconds: Sequence[float], peak_mib: float) -> str:
    """Return all tables of a bank as text."""
    hidden = [(a, j) for a, j in scored if a["hidden"]]
    nulls = [j for a, j in scored if not a["hidden"]]
    found = [j for _, j in hidden if j.outcome in ("right", "and more")]
    sure = [ok for _, j in scored for p, ok in j.claims if p >= SURE]
    lines = [
        _share("something hidden: right joint and mechanism", len(found), len(hidden), ">= 0.90"),
        _share("  and nothing invented", sum(j.outcome == "right" for j in found), len(hidden), ">= 0.90"),
        _share("something hidden: something invented", sum(bool(j.invented) for _, j in hidden), len(hidden), "0"),
        _share("nothing hidden: something invented", sum(bool(j.invented) for j in nulls), len(nulls), "0"),
        _share("nothing hidden: something unexplained", sum(j.unexplained for j in nulls), len(nulls)),
        _share("said with 0.9 or more: right", sum(sure), len(sure), ">= 0.90"),
        _share("failed", sum(j.outcome == "failed" for _, j in scored), len(scored), "0"),
        "",
        *_outcome_lines(scored),
        "",
        *_calibration_lines(scored),
        "",
        *_size_lines(scored),
    ]
    left = sorted(x for _, j in scored for x in j.left)
    if left:
        high = left[int(0.95 * (len(left) - 1))]
        lines.append(f"torque error on unseen data over the noise: median {median(left):.2f}, 95 % below {high:.2f}")
    if seconds:
        lines += ["", f"seconds per run: median {median(seconds):.1f}, longest {max(seconds):.1f}; {peak_mib:.0f} MiB"]
    return "\n".join(lines)


def _outcome_lines(scored: Sequence[tuple[JSON, Judgement]]) -> list[str]:
    lines = []
    for title, key in (
        ("kind", "kind"),
        ("drives", "drives"),
        ("motion", "motion"),
        ("build", "build"),
        ("level", "level"),
    ):
        table: defaultdict[str, Counter[str]] = defaultdict(Counter)
        for answer, judgement in scored:
            table[str(answer[key])][judgement.outcome] += 1
        lines.append(f"{title:22s} " + " ".join(f"{name:>11s}" for name in OUTCOMES))
        for what, counts in sorted(table.items()):
            lines.append(f"{what:22s} " + " ".join(f"{counts[name] or '':>11}" for name in OUTCOMES))
        lines.append("")
    said = Counter(f"{a['kind']}: {name.split('@')[0]}" for a, j in scored for name in j.invented)
    if said:
        lines += ["invented", *(f"  {name}: {count}" for name, count in said.most_common())]
    return lines


def _calibration_lines(scored: Sequence[tuple[JSON, Judgement]]) -> list[str]:
    """Return by probability said how much of it was right."""
    members: defaultdict[int, list[tuple[float, bool]]] = defaultdict(list)
    for _, judgement in scored:
        for claim in judgement.claims:
            members[min(int(claim[0] * 10), 9)].append(claim)
    lines = ["  said   right  count"]
    for _, held in sorted(members.items()):
        mean, right = sum(p for p, _ in held) / len(held), sum(ok for _, ok in held) / len(held)
        lines.append(f"  {mean:.3f}  {right:.3f}  {len(held):4d}")
    return lines


def _size_lines(scored: Sequence[tuple[JSON, Judgement]]) -> list[str]:
    """Return of each size its median and largest error and how often the interval held the truth."""
    groups: defaultdict[str, list[Size]] = defaultdict(list)
    friction: list[Size | None] = []
    for answer, judgement in scored:
        friction += judgement.friction
        for size in judgement.sizes:
            groups[f"{answer['kind']} {size.name}"].append(size)
    for size in friction:
        if size is not None:
            groups[f"friction not described {size.name}"].append(size)
    lines = [f"{'size':54s} {'median error':>12s} {'largest':>8s}   interval holds it"]
    for name, sizes in sorted(groups.items()):
        errors = [size.error for size in sizes]
        covered = [size.covered for size in sizes if size.covered is not None]
        held = f"{sum(covered)} of {len(covered)}"
        lines.append(f"{name:54s} {median(errors):12.3f} {max(errors):8.3f}   {held}")
    every = [size.covered for sizes in groups.values() for size in sizes if size.covered is not None]
    lines.append(_share("90 % intervals that hold the truth", sum(every), len(every), "0.80 to 0.97"))
    if friction:
        lines.append(_share("friction not described: named", sum(s is not None for s in friction), len(friction)))
    return lines
