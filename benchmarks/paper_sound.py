"""Figures 5 to 9 of the paper from simulated sound: `python -m benchmarks.paper_sound docs/figures`.

5 to 7: a recording of a normal gear, of one with a notch and of one with play, below 200 Hz. 8: their spectra.
9: their crest factor in every cycle of the motion. The axis is the one of `sim.paper`; what the paper does not say
(microphone, rubbing, size of the faults) is stated here.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt, welch
from scipy.stats import norm

from casebase.signals.crest import crest_factor
from sim.axis import Axis
from sim.measurement import DEFAULT_MICROPHONE, built, sound_of
from sim.mechanism import Mechanism, with_mechanism
from sim.mechanisms import Backlash, ToothDamage
from sim.paper import PAPER_AXIS
from sim.solver import simulate
from sim.sound import SAMPLE_RATE_HZ

Signal = NDArray[np.float32]
CYCLES, BAND_HZ = 5, 200.0
DRAWS = 20  # of the noise: one draw differs from another by 0.3
TRANSMISSION_ERROR_RAD = 6e-6  # of the output mesh: audible, as the paper's spectra show its frequency
MICROPHONE = replace(DEFAULT_MICROPHONE, rubbing_n_m=5.0, rubbing_exponent=0.2, mesh_weights=(0.3, 1.0), gain=5e-4)
CASES: dict[str, tuple[Mechanism | None, float]] = {
    "normal": (None, 3.43),
    "notch": (ToothDamage("output", {"angle_rad": 2.0, "depth_rad": 1e-3}), 14.6),
    "play": (Backlash("output", {"gap_rad": 3e-3}), 9.35),
}
"""Label: mechanism, and the paper's mean crest factor."""


def paper_axis() -> Axis:
    """`PAPER_AXIS` with an audible output mesh and half a second from standstill to full speed."""
    motion = replace(PAPER_AXIS.motion, acceleration_time_s=0.5)
    output = replace(PAPER_AXIS.stages[1], transmission_error_rad=TRANSMISSION_ERROR_RAD)
    return replace(PAPER_AXIS, motion=motion, stages=(PAPER_AXIS.stages[0], output))


def recordings() -> dict[str, list[Signal]]:
    """What the microphone hears below 200 Hz, per label, `DRAWS` times with other noise, each of shape (n,)."""
    band = butter(4, BAND_HZ, fs=SAMPLE_RATE_HZ, output="sos")
    heard = {}
    for label, (mechanism, _) in CASES.items():
        axis = with_mechanism(paper_axis(), mechanism) if mechanism else paper_axis()
        trajectory = simulate(built(axis), CYCLES * axis.motion.period_s, SAMPLE_RATE_HZ)
        sounds = (sound_of(trajectory, axis, MICROPHONE, seed) for seed in range(DRAWS))
        heard[label] = [np.asarray(sosfiltfilt(band, sound), dtype=np.float32) for sound in sounds]
    return heard


def crest_factors(sound: Signal) -> NDArray[np.float64]:
    """Crest factor of every cycle of the motion, shape (cycles,)."""
    each = round(paper_axis().motion.period_s * SAMPLE_RATE_HZ)
    return np.array([crest_factor(sound[i * each : (i + 1) * each]) for i in range(CYCLES)])


def noise_floor(seconds: float) -> float:
    """Median crest factor of steady Gaussian noise below `BAND_HZ`: 2 B T independent values (sampling theorem)."""
    return float(norm.isf(0.5 * (1 - 0.5 ** (1 / (2 * BAND_HZ * seconds)))))


def draw(heard: dict[str, Signal], out: Path) -> list[Path]:
    """Write paper_5_to_7.png and paper_8_and_9.png."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    out.mkdir(parents=True, exist_ok=True)
    signals, spectra = Figure(figsize=(9, 7), layout="constrained"), Figure(figsize=(9, 7), layout="constrained")
    for figure in (signals, spectra):
        FigureCanvasAgg(figure)
    rows = signals.subplots(3, 1, sharex=True)
    upper, lower = spectra.subplots(2, 1)
    for number, (row, (label, sound), style) in enumerate(zip(rows, heard.items(), "-:.", strict=True), 5):
        time = np.arange(sound.size) / SAMPLE_RATE_HZ
        row.plot(time, sound, lw=0.4)
        row.set_title(f"{number}: {label} (simulated), mean crest factor {crest_factors(sound).mean():.2f}", fontsize=9)
        row.set_ylabel("sound [1]")
        frequency, density = welch(sound, SAMPLE_RATE_HZ, nperseg=8192)
        shown = (frequency > 5) & (frequency < 250)
        upper.semilogy(frequency[shown], np.sqrt(density[shown]), style if style != "." else "--", label=label)
        lower.plot(range(1, CYCLES + 1), crest_factors(sound), "os^"[number - 5] + "-", label=label)
        lower.axhline(CASES[label][1], color="0.6", lw=0.8)
        lower.annotate(f"the paper's {label}: {CASES[label][1]}", (1, CASES[label][1]), fontsize=8, va="bottom")
    rows[-1].set_xlabel("time [s]")
    upper.set(title="8: spectra", xlabel="frequency [Hz]", ylabel="amplitude density [1/sqrt(Hz)]")
    lower.set(
        title="9: crest factor of each cycle below 200 Hz", xlabel="cycle of the motion", ylabel="crest factor [1]"
    )
    for each in (upper, lower):
        each.legend()
        each.grid(alpha=0.3)
    files = [out / "paper_5_to_7.png", out / "paper_8_and_9.png"]
    for figure, path in zip((signals, spectra), files, strict=True):
        figure.savefig(path, dpi=80)
    return files


def main(out: Path) -> None:
    """Draw, and print the crest factors beside the paper's."""
    heard = recordings()
    for label, sounds in heard.items():
        means = np.array([crest_factors(sound).mean() for sound in sounds])
        whole = float(np.mean([crest_factor(sound) for sound in sounds]))
        print(
            f"{label:7s} mean over cycles {means.mean():5.2f} ({means.min():.2f} to {means.max():.2f} over {DRAWS} "
            f"draws of noise), whole record {whole:5.2f}, the paper's {CASES[label][1]}"
        )
    seconds = paper_axis().motion.period_s
    print(
        f"noise alone below {BAND_HZ:g} Hz has {noise_floor(seconds):.2f} in the median over a cycle of {seconds:g} s"
    )
    for path in draw({label: sounds[0] for label, sounds in heard.items()}, out):
        print(path)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/figures"))
