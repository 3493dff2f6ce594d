"""Figure 4 and table 1 of the paper from the simulated torque: `python -m benchmarks.paper_torque docs/figures`.

The drive train is the paper's: 12 N m sine, motor inertia 0.6 kg m2, gear of ratio 100 with mesh efficiency 0.9 and
bearing friction 0.9, c = 1e5 N m/rad, no backlash, 30 s from rest. The paper gives no damping (Gear2's default is 0);
both none and a damping ratio of a few percent are shown.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signals.crest import WINDOW_S, CrestTrace, crest_trace
from signals.spectra import PAPER_CUTOFF_HZ
from sim import simulate
from sim.rotational.components import ElastoBacklash, Gearbox, Inertia, Sine, Torque
from sim.rotational.drive_train import DriveTrain

Values = NDArray[np.float64]
SECONDS, RATE_HZ = 30.0, 8000.0
STIFFNESS, DAMPING = 1e5, 200.0
TRAIN = DriveTrain.series(
    torque=Torque(Sine(amplitude=12, f=0.5)),
    motor=Inertia(J=0.6),
    gear=Gearbox(ratio=100, lossTable=[0, 0.9, 0.9, 0.9, 0.9], c=STIFFNESS, d=DAMPING),
    load=Inertia(J=30),
)
"""The paper's model: figure 2 tells its speeds, figure 3 shows it, figure 4 runs it, table 1 varies it."""

LOADS = {20.0: "10 kg", 40.0: "125 kg", 50.0: "200 kg"}
"""Load inertia [kg m2] and the payload it stands for."""
PAPER = {20.0: (1.15, 1.18), 40.0: (1.13, 1.15), 50.0: (1.13, 1.17)}
"""Mean crest factors of table 1, smallest and largest."""
MEASURED = {"normal": 3.43, "play": 9.35, "notch": 14.6}
FREQUENCIES_HZ = (0.4, 0.5)
TABLE_WINDOW_S = 0.2
WINDOWS_S = (0.05, WINDOW_S, 0.15, TABLE_WINDOW_S, 0.3, 0.5, 1.0, SECONDS)


def varied(load: float, frequency_hz: float, damping: float = DAMPING) -> DriveTrain:
    """The model with another inertia of the load [kg m2], frequency of the torque, and damping [N m s/rad]."""
    train = TRAIN.replace("load", Inertia(J=load)).replace("torque", Torque(Sine(amplitude=12, f=frequency_hz)))
    return train.replace("gear.elastoBacklash", ElastoBacklash(c=STIFFNESS, d=damping))


def shaft_torques(train: DriveTrain) -> tuple[Values, Values]:
    """Torque at the input and at the driven shaft [N m], each of shape (n,)."""
    result = simulate(train, SECONDS, RATE_HZ)
    return result["torque.tau"][:-1], result["load.flange_a.tau"][:-1]


def trace(torque: Values, window_s: float) -> CrestTrace:
    """The crest factor over time, by the definition for sound."""
    return crest_trace(torque, RATE_HZ, window_s)


def bound(window_s: float) -> float:
    """What the mean of a trace cannot exceed: the root of the independent values, 2 B T (sampling theorem)."""
    return math.sqrt(2 * PAPER_CUTOFF_HZ * window_s)


def table_1(window_s: float = TABLE_WINDOW_S) -> str:
    """Table 1 as Markdown, mean and largest: damped, undamped, and what the paper says."""
    head = "".join(f"| {f:g} Hz{words} " for words in ("", ", no damping") for f in FREQUENCIES_HZ)
    lines = [f"| load inertia (payload) {head}| paper, mean |", "| --- " * (2 + 2 * len(FREQUENCIES_HZ)) + "|"]
    for load, payload in LOADS.items():
        traces = [
            trace(shaft_torques(varied(load, f, damping))[1], window_s)
            for damping in (DAMPING, 0.0)
            for f in FREQUENCIES_HZ
        ]
        cells = " | ".join(f"{each.mean:.2f}, {each.largest:.2f}" for each in traces)
        low, high = PAPER[load]
        lines.append(f"| {load:g} kg m2 ({payload}) | {cells} | {low} to {high} |")
    return "\n".join(lines)


def windows_table() -> str:
    """Mean of the trace by window, with the bound of any signal below 200 Hz, as Markdown."""
    motor, damped = shaft_torques(varied(40.0, 0.5))
    free = shaft_torques(varied(40.0, 0.5, 0.0))[1]
    lines = ["| window [s] | input shaft | driven shaft | no damping | bound below 200 Hz |", "| --- " * 5 + "|"]
    for window in WINDOWS_S:
        values = [trace(torque, window).mean for torque in (motor, damped, free)]
        lines.append(f"| {window:g} | {' | '.join(f'{x:.2f}' for x in values)} | {bound(window):.1f} |")
    return "\n".join(lines)


def draw(out: Path) -> list[Path]:
    """Write paper_4.png and paper_windows.png."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    out.mkdir(parents=True, exist_ok=True)
    torque, windows = Figure(figsize=(9, 3.5), layout="constrained"), Figure(figsize=(9, 4), layout="constrained")
    for figure in (torque, windows):
        FigureCanvasAgg(figure)
    axes = torque.subplots()
    time = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    for damping, train, width in ((0.0, varied(30.0, 0.5, 0.0), 0.4), (DAMPING, TRAIN, 1.0)):
        axes.plot(time, shaft_torques(train)[1], lw=width, label=f"damping {damping:g} N m s/rad")
    axes.set(title="4: torque at the driven shaft, 30 kg m2, 0.5 Hz", xlabel="time [s]", ylabel="torque [N m]")
    axes.legend()
    axes.grid(alpha=0.3)
    axes = windows.subplots()
    span = np.geomspace(0.01, 3.0, 25)
    for load, style in zip(LOADS, ("o-", "s--", "^:"), strict=True):
        values = shaft_torques(varied(load, 0.5))[1]
        axes.plot(span, [trace(values, w).mean for w in span], style, ms=3, label=f"driven shaft, {load:g} kg m2")
    axes.plot(span, [bound(w) for w in span], "k-", lw=1, label="bound of any signal below 200 Hz")
    for label, value in MEASURED.items():
        axes.axhline(value, color="0.6", lw=0.8)
        axes.annotate(f"measured, {label}: {value}", (0.011, value), fontsize=8, va="bottom")
    axes.axhspan(1.13, 1.18, color="0.85", label="table 1: 1.13 to 1.18")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="window [s]",
        ylabel="mean of the trace [1]",
        title="Mean crest factor by window",
    )
    axes.legend(fontsize=8, loc="center right")
    axes.grid(alpha=0.3)
    files = [out / "paper_4.png", out / "paper_windows.png"]
    for figure, path in zip((torque, windows), files, strict=True):
        figure.savefig(path, dpi=80)
    return files


def main(out: Path) -> None:
    """Draw and print both tables."""
    print(f"table 1, mean and largest of the trace in windows of {TABLE_WINDOW_S:g} s\n\n{table_1()}\n")
    print(f"mean by window, 40 kg m2 at 0.5 Hz\n\n{windows_table()}\n")
    for label, value in MEASURED.items():
        print(f"a mean of {value} ({label}) needs windows of {value**2 / (2 * PAPER_CUTOFF_HZ):.3f} s or more")
    for path in draw(out):
        print(path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
