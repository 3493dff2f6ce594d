"""What the answers are worth: counts per kind, totals, calibration."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.field_bank.bank import Question
from benchmarks.field_bank.product import Answer


@dataclass(frozen=True)
class Asked:
    """A question without its sound, the answer, and the answer to the undisturbed recording where there is one."""

    group: str
    kind: str
    truth: str
    gearbox: str
    size_rad: float
    strength: float
    answer: Answer
    clean: Answer | None

    @property
    def said(self) -> bool:
        """Return whether a label was said with confidence."""
        return self.answer.verdict == "diagnosed"

    @property
    def right(self) -> bool:
        """Return whether the label is the true one."""
        return self.answer.label == self.truth and self.truth != ""


def asked(questions: Sequence[Question], answers: Sequence[Answer]) -> list[Asked]:
    """Join questions and answers, in the same order."""
    clean = {q.base: a for q, a in zip(questions, answers, strict=True) if q.group == "undisturbed"}
    return [
        Asked(q.group, q.kind, q.truth, q.gearbox, q.size_rad, q.strength, a, clean.get(q.base))
        for q, a in zip(questions, answers, strict=True)
    ]


def counts(rows: Iterable[Asked]) -> dict[str, int]:
    """Return the counts of a kind.

    `kept` of `clean`: the undisturbed recording was diagnosed, and this one is with the same label. `said` is
    diagnosed, `wrong` is diagnosed with a label that is not true. `refused` counts as unusable.
    """
    rows = list(rows)
    clean = [r for r in rows if r.clean is not None and r.clean.verdict == "diagnosed"]
    return {
        "n": len(rows),
        "clean": len(clean),
        "kept": sum(r.said and r.clean is not None and r.answer.label == r.clean.label for r in clean),
        "said": sum(r.said for r in rows),
        "right": sum(r.said and r.right for r in rows),
        "wrong": sum(r.said and not r.right for r in rows),
        "ambiguous": sum(r.answer.verdict == "ambiguous" for r in rows),
        "not_in_library": sum(r.answer.verdict == "not_in_library" for r in rows),
        "unusable": sum(r.answer.verdict in ("unusable", "refused") for r in rows),
    }


@dataclass(frozen=True)
class Reliability:
    """Ten equal bins of the probability: count, mean probability, share that was right; `error` is the ECE."""

    bins: tuple[tuple[float, int, float, float], ...]
    count: int
    error: float


def reliability(rows: Iterable[Asked]) -> Reliability:
    """Return the calibration over all answers with a probability and a label: diagnosed and ambiguous."""
    said = [
        (r.answer.probability, r.right)
        for r in rows
        if r.answer.verdict in ("diagnosed", "ambiguous") and r.answer.probability is not None and r.answer.label
    ]
    p = np.array([x for x, _ in said])
    right = np.array([y for _, y in said], dtype=float)
    place = np.minimum((p * 10).astype(int), 9)
    bins, error = [], 0.0
    for i in range(10):
        here = place == i
        if np.any(here):
            mean, share = float(p[here].mean()), float(right[here].mean())
            bins.append((i / 10, int(here.sum()), mean, share))
            error += float(here.mean()) * abs(mean - share)
    return Reliability(tuple(bins), len(said), error)


def share(part: int, whole: int) -> str:
    """Return a part of a whole in words: 97.0 % (97/100)."""
    return f"{100 * part / whole:.1f} % ({part}/{whole})" if whole else "none"


def totals(rows: Sequence[Asked]) -> dict[str, tuple[int, int]]:
    """Return the figures that are aimed at, each a part and a whole."""
    by = {g: counts(r for r in rows if r.group == g) for g in GROUPS}
    clean = by["undisturbed"]
    unseen = [r for r in rows if r.group == "unseen"]
    wrong = [r for r in rows if r.group == "disturbed" and r.said and not r.right]
    return {
        "undisturbed: right": (clean["right"], clean["n"]),
        "undisturbed: right among labelled": (clean["right"], clean["said"]),
        "undisturbed: wrong label said": (clean["wrong"], clean["n"]),
        "harmless edges: label kept": (by["harmless"]["kept"], by["harmless"]["clean"]),
        "harmless edges: wrong label said": (by["harmless"]["wrong"], by["harmless"]["n"]),
        "disturbed: wrong label said": (by["disturbed"]["wrong"], by["disturbed"]["n"]),
        "disturbed: a fault called normal": (sum(r.answer.label == "normal" for r in wrong), by["disturbed"]["n"]),
        "disturbed: normal called a fault": (sum(r.truth == "normal" for r in wrong), by["disturbed"]["n"]),
        "disturbed: right label said": (by["disturbed"]["right"], by["disturbed"]["n"]),
        "foreign: a label said": (by["foreign"]["said"], by["foreign"]["n"]),
        "unseen fault: called normal": (sum(r.said and r.answer.label == "normal" for r in unseen), len(unseen)),
        "unseen fault: a label said": (by["unseen"]["said"], len(unseen)),
    }


GROUPS = ("undisturbed", "unseen", "harmless", "disturbed", "foreign")


def report(rows: Sequence[Asked]) -> str:
    """Return the table per kind, the totals and the calibration as text."""
    lines = []
    columns = ("n", "kept", "said", "right", "wrong", "ambiguous", "not_in_library", "unusable")
    lines.append(f"{'kind':<22}" + "".join(f"{c:>15}" if c == "not_in_library" else f"{c:>10}" for c in columns))
    for group in GROUPS:
        kinds = dict.fromkeys(r.kind for r in rows if r.group == group)
        for kind in [*kinds, *([f"all {group}"] if len(kinds) > 1 else [])]:
            c = counts(r for r in rows if r.group == group and (r.kind == kind or kind.startswith("all ")))
            cells = [str(c[x]) if x != "kept" else f"{c['kept']}/{c['clean']}" for x in columns]
            if group in ("undisturbed", "unseen", "foreign"):
                cells[1] = ""
            lines.append(f"{kind:<22}" + "".join(f"{x:>{15 if i == 6 else 10}}" for i, x in enumerate(cells)))
    lines.append("")
    lines += [f"{name:<40} {share(*value)}" for name, value in totals(rows).items()]
    faulty = [r for r in rows if r.group == "undisturbed" and r.size_rad > 0]
    for low, high in ((0.3e-3, 0.65e-3), (0.65e-3, 1.4e-3), (1.4e-3, 3.1e-3)):
        sized = [r for r in faulty if low <= r.size_rad < high]
        if sized:
            right = sum(r.said and r.right for r in sized)
            lines.append(
                f"{f'undisturbed: right, {low * 1e3:.2f} to {high * 1e3:.2f} mrad':<40} {share(right, len(sized))}"
            )
    every = reliability(rows)
    machines = reliability(r for r in rows if r.group != "foreign")
    lines.append(f"{'calibration error over all':<40} {every.error:.3f} ({every.count} answers)")
    lines.append(f"{'calibration error without foreign':<40} {machines.error:.3f} ({machines.count} answers)")
    lines.append("")
    lines.append("probability from    count     mean    right")
    lines += [f"{low:>16.1f}{count:>9}{mean:>9.3f}{right:>9.3f}" for low, count, mean, right in every.bins]
    return "\n".join(lines)
