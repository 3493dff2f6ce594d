"""A bank as a picture: what became of effects of each size, and how often a name is right that is said with p."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.hidden_effects.scoring import Scored, calibration, size_class, wilson

SIZES = ("at least the noise", "half", "third", "quarter", "nothing hidden")
OUTCOMES = {  # colour and hatch
    "right": ("#0a6480", ""),
    "wrong place": ("#7fb3c4", "//"),
    "incomplete": ("#b8ccd2", ".."),
    "missed": ("#eeeeee", ""),
    "wrong": ("#a8174b", "xx"),
    "false alarm": ("#a8174b", "xx"),
    "failed": ("#000000", ""),
}


def draw(scored: Sequence[Scored], path: Path) -> None:
    """Write the picture; the ending of `path` says in which format."""
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    _outcomes(left, scored)
    _calibration(right, scored)
    figure.savefig(path, dpi=80)


def _outcomes(axes: Axes, scored: Sequence[Scored]) -> None:
    sizes = [size_class(answer) if answer["hidden"] else "nothing hidden" for answer, _ in scored]
    counts = {size: Counter(j.outcome for s, (_, j) in zip(sizes, scored, strict=True) if s == size) for size in SIZES}
    shown = [size for size in SIZES if counts[size]]
    start = [0.0] * len(shown)
    for outcome, (colour, hatch) in OUTCOMES.items():
        widths = [counts[size][outcome] / counts[size].total() for size in shown]
        if any(widths):
            axes.barh(shown, widths, left=start, color=colour, hatch=hatch, edgecolor="#444444", label=outcome)
            start = [a + b for a, b in zip(start, widths, strict=True)]
    for place, size in enumerate(shown):
        axes.text(1.01, place, f"of {counts[size].total()}", va="center")
    axes.invert_yaxis()
    axes.set(xlim=(0.0, 1.12), xlabel="share of recordings", title="By amplitude of what is hidden, over the noise")
    handles, labels = axes.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    if {"wrong", "false alarm"} <= named.keys():
        named = {"wrong or false alarm" if k == "wrong" else k: v for k, v in named.items() if k != "false alarm"}
    axes.legend(named.values(), named.keys(), fontsize=8, ncols=5, loc="upper left", bbox_to_anchor=(-0.3, -0.14))


def _calibration(axes: Axes, scored: Sequence[Scored]) -> None:
    curve, error = calibration(claim for _, judgement in scored for claim in judgement.claims)
    axes.plot((0.0, 1.0), (0.0, 1.0), "--", color="#888888", label="as said")
    for said, share, count in curve:
        low, high = wilson(round(share * count), count)
        axes.errorbar(said, share, [[max(share - low, 0.0)], [max(high - share, 0.0)]], fmt="o", color="#0a6480")
        axes.annotate(str(count), (said, share), (5, -11), textcoords="offset points", fontsize=8)
    axes.set(xlim=(0.0, 1.02), ylim=(0.0, 1.05), xlabel="probability that is said", ylabel="share that is right")
    axes.set_title(f"Names; expected calibration error {error:.3f}")
    axes.legend(fontsize=8)
