"""Figures 1 and 5 to 9 of the paper and its measured rows from simulated sound, with what the open numbers change.

`python -m benchmarks.paper_sound docs/figures` draws and prints the tables of docs/paper.md, in some ten minutes. The
configuration and the one definition of crest factor are those of `benchmarks.paper_recordings`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram
from scipy.stats import norm

from benchmarks.paper_recordings import (
    DRAWS,
    NOTCH_S,
    PAPER,
    RECORD_S,
    REVERSAL_S,
    REVOLUTION_S,
    SPEED_RAD_S,
    STROKE_S,
    USUAL,
    Sound,
    behind_the_play,
    scenario,
    trace_of,
    usual_traces,
)
from benchmarks.paper_torque import shaft_torques, trace, varied
from signals.crest import WINDOW_S, CrestTrace, crest_trace
from signals.spectra import PAPER_CUTOFF_HZ, long_spectrum, low_pass
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.scenario import SETTLING_S, Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
PAPER_OVER_MEAN = {"normal": "", "play": "more than four", "notch": "about seven"}


def noise_floor(seconds: float) -> float:
    """Median crest factor of steady Gaussian noise below 200 Hz: 2 B T independent values (sampling theorem)."""
    return float(norm.isf(0.5 * (1 - 0.5 ** (1 / (2 * PAPER_CUTOFF_HZ * seconds)))))


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def rows_of(traces_of: Mapping[str, Sequence[CrestTrace]]) -> str:
    """The paper's measured rows, and figures 8 and 9: largest and mean of the trace."""
    rows = []
    for label, traces in traces_of.items():
        largest, mean = np.array([[each.largest, each.mean] for each in traces]).T
        rows.append(
            [
                label,
                f"{largest.mean():.2f}",
                f"{largest.min():.2f} to {largest.max():.2f}",
                f"{PAPER[label]:g}",
                f"{largest.mean() / PAPER[label] - 1:+.0%}",
                f"{mean.mean():.2f}",
                f"{(largest / mean).mean():.1f}",
                PAPER_OVER_MEAN[label],
                f"{np.mean([begins(each) for each in traces]):.0%}",
            ]
        )
    head = ["", "largest", f"of {DRAWS} draws", "the paper", "off by", "mean", "largest over mean", "the paper"]
    return markdown([*head, "largest where a stroke begins"], rows)


def begins(each: CrestTrace) -> bool:
    """Whether the largest value of a trace lies within a window of the beginning of a stroke."""
    at = each.middle_s[each.values.argmax()]
    return abs((at - REVERSAL_S + STROKE_S / 2) % STROKE_S - STROKE_S / 2) < WINDOW_S


def measured_rows() -> str:
    """The one configuration, over all draws."""
    return rows_of({label: usual_traces(label) for label in PAPER})


def moved_rows() -> str:
    """The same with the paper's bearing friction behind the play."""
    return rows_of(
        {label: [trace_of(behind_the_play(scenario(label, seed))) for seed in range(DRAWS)] for label in PAPER}
    )


def items() -> str:
    """What each item adds to the paper's model, over all draws."""
    drawn = [scenario("normal", seed) for seed in range(DRAWS)]
    smooth = [replace(each, specimen=replace(each.specimen, error=0.0)) for each in drawn]
    silent = [replace(each, microphone=replace(each.microphone, rubbing_n_m=0.0, ambient_n_m=0.0)) for each in drawn]
    lines: list[tuple[str, str, Sequence[CrestTrace]]] = [
        (
            "the paper's model",
            "torque at the output under a sine of torque",
            [trace(shaft_torques(varied(40.0, 0.45))[1], WINDOW_S)],
        ),
        ("+ servo, transfer gear", "the axis goes back and forth as a robot does", [_torque(each) for each in smooth]),
        ("+ errors of the teeth", "every tooth engagement is felt", [_torque(each) for each in drawn]),
        ("+ housing and microphone", "sound, not torque: no swing, resonances", [trace_of(each) for each in silent]),
        ("+ rubbing and ambient noise: normal", "sliding teeth and bearings", usual_traces("normal")),
        ("+ play", "impacts where the torque reverses", usual_traces("play")),
        ("+ notch instead", "an impact at one angle, on one flank", usual_traces("notch")),
    ]
    rows, means = [], [float(np.mean([each.largest for each in traces])) for *_, traces in lines]
    for number, ((item, why, _), mean) in enumerate(zip(lines, means, strict=True)):
        gain = f"{mean - means[min(number - 1, 4)]:+.2f}" if number else ""
        rows.append([item, why, f"{mean:.2f}", gain, _paper_of(item)])
    return markdown(["simulation", "what it adds", "crest factor", "gain", "the paper"], rows)


def _paper_of(item: str) -> str:
    return next((f"{value:g}" for label, value in PAPER.items() if label in item), "")


def _torque(each: Scenario) -> CrestTrace:
    force = -each.simulate()[f"{each.axis.stages[-1].name}.tau"][round(SETTLING_S * SAMPLE_RATE_HZ) :]
    return crest_trace(force, SAMPLE_RATE_HZ)


def _low(sound: Sound) -> Sound:
    return low_pass(long_spectrum(sound, SAMPLE_RATE_HZ))


def typical(label: str) -> Scenario:
    """The draw whose crest factor is the median of all."""
    order = np.argsort([each.largest for each in usual_traces(label)])
    return scenario(label, int(order[DRAWS // 2]))


def cruise_spectrum() -> tuple[Floats, Floats]:
    """Frequencies [Hz] and amplitude of the normal sound at full speed, mean power of all draws."""
    ramp = USUAL["acceleration_time_s"]
    at_speed = slice(*(round(t * SAMPLE_RATE_HZ) for t in (REVERSAL_S + ramp, REVERSAL_S + STROKE_S - ramp)))
    sounds = [scenario("normal", seed).perform()[at_speed] for seed in range(DRAWS)]
    spectra = [periodogram(sound, SAMPLE_RATE_HZ, "hann", scaling="spectrum") for sound in sounds]
    return spectra[0][0], np.sqrt(2 * np.mean([power for _, power in spectra], axis=0))


def draw(out: Path) -> list[Path]:
    """Write paper_1.png, paper_5_to_7.png and paper_8_and_9.png."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    out.mkdir(parents=True, exist_ok=True)
    figures = [Figure(figsize=(9, height), layout="constrained") for height in (8, 9, 5)]
    for figure in figures:
        FigureCanvasAgg(figure)
    _draw_spectrum(figures[0])
    typical_draws = {label: typical(label) for label in PAPER}
    moved = behind_the_play(typical_draws["play"])
    sounds = {label: each.perform() for label, each in typical_draws.items()}
    time = np.arange(sounds["normal"].size) / SAMPLE_RATE_HZ
    shown = (
        ("5: normal, unfiltered", sounds["normal"]),
        ("6: notch, below 200 Hz", _low(sounds["notch"])),
        ("7: play, below 200 Hz", _low(sounds["play"])),
        ("7 with the paper's friction behind the play", _low(moved.perform())),
    )
    rows = figures[1].subplots(len(shown), 1, sharex=True)
    for row, (words, sound) in zip(rows, shown, strict=True):
        row.plot(time, sound, lw=0.4)
        row.set_title(words, fontsize=9)
        row.set_ylabel("sound [1]")
        _mark_motion(row)
    rows[-1].set_xlabel("time [s]")
    rows = figures[2].subplots(2, 1, sharex=True)
    traces = {label: crest_trace(sound, SAMPLE_RATE_HZ) for label, sound in sounds.items()}
    for number, (row, label) in enumerate(zip(rows, ("notch", "play"), strict=True), 8):
        each = traces[label]
        begin = np.arange(each.values.size) * WINDOW_S
        over_mean = f"largest over mean {each.largest / each.mean:.1f}, the paper: {PAPER_OVER_MEAN[label]}"
        row.step(begin, traces["normal"].values, where="post", lw=0.8, color="0.6", label="normal")
        row.step(begin, each.values, where="post", label=label)
        row.axhline(each.mean, ls="--", lw=0.8, color="C1", label="mean")
        row.set(
            title=f"{number}: crest factor, {label}, windows of {WINDOW_S:g} s; {over_mean}", ylabel="crest factor [1]"
        )
        row.legend(fontsize=8, loc="upper right")
        _mark_motion(row)
    rows[-1].set_xlabel("time [s]")
    files = [out / name for name in ("paper_1.png", "paper_5_to_7.png", "paper_8_and_9.png")]
    for figure, path in zip(figures, files, strict=True):
        figure.savefig(path, dpi=80)
    return files


def _draw_spectrum(figure: Figure) -> None:
    """The whole FFT, then both meshes from near."""
    frequency, amplitude = cruise_spectrum()
    turns = SPEED_RAD_S / math.tau
    shaft, motor = turns * PAPER_AXIS.ratio_from("transfer"), turns * PAPER_AXIS.ratio
    meshes = [(each.driven_teeth or 0) * turns * PAPER_AXIS.ratio_from(each.name) for each in PAPER_AXIS.stages]
    transfer, output = meshes
    shown = (
        ("the whole sound", 0.0, SAMPLE_RATE_HZ / 2),
        ("mesh of the output gear", 0.5 * output, 3.3 * output),
        ("mesh of the transfer gear", 0.93 * transfer, 1.07 * transfer),
    )
    for row, (words, low, high) in zip(figure.subplots(3, 1), shown, strict=True):
        inside = (frequency >= low) & (frequency <= high)
        row.semilogy(frequency[inside], np.maximum(amplitude[inside], amplitude[1:].min()), lw=0.6)
        for name, each, colour in (("output", output, "C1"), ("transfer", transfer, "C2")):
            multiples = [k * each for k in range(1, 4) if low < k * each < high]
            for number, at in enumerate(multiples):
                label = None if number else f"{name} gear, multiples of {each:.1f} Hz"
                row.axvline(at, color=colour, lw=0.8, ls=":", label=label)
        if low < motor < high < SAMPLE_RATE_HZ / 2:
            row.axvline(motor, color="0.5", lw=0.8, ls=":", label=f"turns of the motor, {motor:.1f} Hz")
        for side in (-1, 1) if words.endswith("transfer gear") else ():
            words_beside = f"beside it by the transfer shaft, {shaft:.2f} Hz" if side == 1 else None
            row.axvline(transfer + side * shaft, color="C3", ls="--", lw=0.8, label=words_beside)
        row.set(title=f"1: FFT at full speed, {words}", ylabel="amplitude [1]")
        row.legend(fontsize=8)
    row.set_xlabel("frequency [Hz]")


def _mark_motion(row: Axes) -> None:
    """Shade the strokes that meet the notch on the other flank, and mark when the notch is met."""
    row.axvspan(0, REVERSAL_S, color="0.93")
    row.axvspan(REVERSAL_S + STROKE_S, RECORD_S, color="0.93")
    for turn in range(2):
        row.axvline(NOTCH_S + turn * REVOLUTION_S, color="C3", lw=0.6, ls=":")


def main(out: Path) -> None:
    """Print the tables and draw."""
    for words, made in (
        (f"measured rows, {DRAWS} draws", measured_rows),
        (f"the same with the paper's friction behind the play, {DRAWS} draws", moved_rows),
        (f"what each item adds, {DRAWS} draws", items),
    ):
        print(f"{words}\n\n{made()}\n", flush=True)
    print(f"noise alone below 200 Hz has {noise_floor(RECORD_S):.2f} in the median over {RECORD_S:.2f} s")
    for path in draw(out):
        print(path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
