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

from sim.rotational.components import Gearbox, Inertia, Sine, Torque
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate

Values = NDArray[np.float64]
SECONDS, RATE_HZ, BAND_HZ = 30.0, 8000.0, 200.0
DAMPING = 200.0
LOADS = {20.0: "10 kg", 40.0: "125 kg", 50.0: "200 kg"}
"""Load inertia [kg m2] and the payload it stands for."""
PAPER = {20.0: (1.15, 1.18), 40.0: (1.13, 1.15), 50.0: (1.13, 1.17)}
"""Mean crest factors of table 1, smallest and largest."""
MEASURED = {"normal": 3.43, "play": 9.35, "notch": 14.6}
FREQUENCIES_HZ = (0.4, 0.5)
WINDOW_S = 0.05
WINDOWS_S = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 30.0)


def drive_train(load: float, frequency_hz: float, damping: float = DAMPING) -> DriveTrain:
    """The paper's model."""
    return DriveTrain.series(
        torque=Torque(Sine(amplitude=12, f=frequency_hz)),
        motor=Inertia(J=0.6),
        gear=Gearbox(ratio=100, lossTable=[0, 0.9, 0.9, 0.9, 0.9], c=1e5, d=damping),
        load=Inertia(J=load),
    )


def shaft_torques(load: float, frequency_hz: float, damping: float = DAMPING) -> tuple[Values, Values]:
    """Torque at the input and at the driven shaft [N m], each of shape (n,)."""
    result = simulate(drive_train(load, frequency_hz, damping), SECONDS, RATE_HZ)
    return result["torque.tau"][:-1], result["load.flange_a.tau"][:-1]


def mean_crest_factor(torque: Values, window_s: float) -> float:
    """Mean over windows side by side of peak over effective value; windows in which nothing acts are left out."""
    size = round(window_s * RATE_HZ)
    windows = torque[: len(torque) // size * size].reshape(-1, size)
    effective = np.sqrt((windows**2).mean(axis=1))
    acting = effective > 1e-9 * np.abs(torque).max()
    return float((np.abs(windows).max(axis=1)[acting] / effective[acting]).mean())


def largest_crest_factor(window_s: float, band_hz: float = BAND_HZ) -> float:
    """Bound of a crest factor: the root of the number of independent values, 2 B T (sampling theorem)."""
    return math.sqrt(max(1.0, 2 * band_hz * window_s))


def table_1(window_s: float = WINDOW_S) -> str:
    """Table 1 as Markdown: damped, undamped, and what the paper says."""
    head = "".join(f"| {f:g} Hz " for f in FREQUENCIES_HZ)
    lines = [
        f"| load inertia (payload) {head}{head.replace(' Hz', ' Hz, no damping')}| paper |",
        "| --- " * (2 + 2 * len(FREQUENCIES_HZ)) + "|",
    ]
    for load, payload in LOADS.items():
        cells = [
            f"{mean_crest_factor(shaft_torques(load, f, damping)[1], window_s):.3f}"
            for damping in (DAMPING, 0.0)
            for f in FREQUENCIES_HZ
        ]
        low, high = PAPER[load]
        lines.append(f"| {load:g} kg m2 ({payload}) | {' | '.join(cells)} | {low} to {high} |")
    return "\n".join(lines)


def windows_table() -> str:
    """Mean crest factor by window, with the bound of any signal below 200 Hz, as Markdown."""
    motor, damped = shaft_torques(40.0, 0.5)
    free = shaft_torques(40.0, 0.5, 0.0)[1]
    lines = ["| window [s] | input shaft | driven shaft | no damping | bound below 200 Hz |", "| --- " * 5 + "|"]
    for window in WINDOWS_S:
        values = [mean_crest_factor(torque, window) for torque in (motor, damped, free)]
        lines.append(f"| {window:g} | {' | '.join(f'{x:.3f}' for x in values)} | {largest_crest_factor(window):.2f} |")
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
    for damping, width in ((0.0, 0.4), (DAMPING, 1.0)):
        axes.plot(time, shaft_torques(30.0, 0.5, damping)[1], lw=width, label=f"damping {damping:g} N m s/rad")
    axes.set(title="4: torque at the driven shaft, 30 kg m2, 0.5 Hz", xlabel="time [s]", ylabel="torque [N m]")
    axes.legend()
    axes.grid(alpha=0.3)
    axes = windows.subplots()
    span = np.geomspace(0.01, 3.0, 25)
    for load, style in zip(LOADS, ("o-", "s--", "^:"), strict=True):
        values = shaft_torques(load, 0.5)[1]
        axes.plot(
            span, [mean_crest_factor(values, w) for w in span], style, ms=3, label=f"driven shaft, {load:g} kg m2"
        )
    axes.plot(span, [largest_crest_factor(w) for w in span], "k-", lw=1, label="bound of any signal below 200 Hz")
    for label, value in MEASURED.items():
        axes.axhline(value, color="0.6", lw=0.8)
        axes.annotate(f"measured, {label}: {value}", (0.011, value), fontsize=8, va="bottom")
    axes.axhspan(1.13, 1.18, color="0.85", label="table 1: 1.13 to 1.18")
    axes.set(
        xscale="log", yscale="log", xlabel="window [s]", ylabel="mean crest factor [1]", title="Crest factor by window"
    )
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    files = [out / "paper_4.png", out / "paper_windows.png"]
    for figure, path in zip((torque, windows), files, strict=True):
        figure.savefig(path, dpi=80)
    return files


def main(out: Path) -> None:
    """Draw and print both tables."""
    print(f"mean crest factor of the torque at the driven shaft, windows of {WINDOW_S:g} s\n\n{table_1()}\n")
    print(f"by window, 40 kg m2 at 0.5 Hz\n\n{windows_table()}\n")
    for label, value in MEASURED.items():
        print(
            f"a crest factor of {value} ({label}) below {BAND_HZ:g} Hz needs {value**2 / (2 * BAND_HZ):.3f} s or more"
        )
    for path in draw(out):
        print(path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
