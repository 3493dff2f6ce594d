"""The sound of a place, from normal recordings alone: housing modes, rubbing, ambient noise, loudness of the meshes.

A gear that moves at full speed is heard through the housing as white rubbing noise; its spectrum is that of the path.
What is left at standstill is ambient noise. The lines of tooth engagement, divided by the path, say how loud the
meshes are against the rubbing. A single microphone hears the product of transmission error and sensitivity only:
the error is taken from the axis's description, and the rubbing in N m follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize, signal

from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, Mode
from sim.description.axis import Axis
from sim.errors import ParameterError
from sim.experiment.design_of_experiments import OPERATION, SPECIMEN, detuned
from sim.experiment.scenario import Scenario, with_motion
from sim.experiment.specimen import Specimen
from sim.experiment.virtual_measurement import heard_forces

Array = NDArray[np.float64]
WINDOW = 1024  # 0.128 s: short against the time at full speed, 8 Hz wide
LOWEST_HZ, HIGHEST_HZ = 20.0, 3800.0
MOVING, STILL = 50.0, 3.0  # percentiles of loudness: at full speed more than half the time, still at each reversal
PROMINENCE_DB = 3.0
MOST_MODES = 8
START_DAMPING = (0.01, 0.03, 0.08)
SMOOTHING_BINS = 5  # a median over these removes lines of tooth engagement


@dataclass(frozen=True)
class NormalRecording:
    """A normal recording and how it was taken: speed at the output [rad/s], payload [kg m2], period of a cycle [s]."""

    samples: NDArray[np.float32]
    speed_rad_s: float
    payload_kg_m2: float
    period_s: float


@dataclass(frozen=True)
class FittedSound:
    """The path of one gearbox's microphone, and how well it explains the spectrum.

    Parameters
    ----------
    misfit_db
        RMS difference between measured and fitted spectrum at full speed, `LOWEST_HZ` to `HIGHEST_HZ`.
    line_over_noise
        Line of tooth engagement over rubbing, both as force and RMS, by mesh; None where no line stands out.
    """

    microphone: Microphone
    misfit_db: float
    line_over_noise: tuple[float | None, ...]


def fit_sound(axis: Axis, recordings: Sequence[NormalRecording]) -> FittedSound:
    """Fit the microphone of one gearbox to its normal recordings at 8 kHz.

    Raises ParameterError where a recording is shorter than two cycles of its motion.
    """
    for heard in recordings:
        if heard.samples.size < 2 * heard.period_s * SAMPLE_RATE_HZ:
            raise ParameterError(
                f"recording: {heard.samples.size / SAMPLE_RATE_HZ:.1f} s are less than two cycles of its motion, "
                f"{heard.period_s:.1f} s each"
            )
    spectra = [_spectra(heard.samples) for heard in recordings]
    frequency = spectra[0][0]
    moving = np.exp(np.mean([np.log(s[1]) for s in spectra], axis=0))
    still = np.exp(np.mean([np.log(s[2]) for s in spectra], axis=0))
    inside = (frequency >= LOWEST_HZ) & (frequency <= HIGHEST_HZ)
    level, slope = _ambient(frequency[inside], still[inside])
    ambient = level * frequency[1:] ** -slope
    modes, misfit = _modes(frequency[inside], moving[inside], level * frequency[inside] ** -slope)
    unit = Microphone(modes=modes, rubbing_n_m=1.0, rubbing_exponent=1.0)
    lines = [_lines(axis, unit, heard) for heard in recordings]
    measured = tuple(_together([line[mesh] for line in lines]) for mesh in range(len(axis.stages)))
    rubbing = _rubbing(axis, recordings, measured)
    noise = math.sqrt(float(ambient.sum() * (frequency[2] - frequency[1])))
    loudest = max(mode.amplitude for mode in modes)
    microphone = Microphone(
        modes=tuple(replace(mode, amplitude=mode.amplitude / loudest) for mode in modes),
        gain=loudest / rubbing,
        rubbing_n_m=rubbing,
        ambient_n_m=noise * rubbing / loudest,
        ambient_slope=slope,
    )
    return FittedSound(microphone, misfit, measured)


def scenario_like(axis: Axis, heard: NormalRecording, microphone: Microphone, seed: int) -> Scenario:
    """Another normal specimen, moved and loaded as in a recording, heard by a microphone of this kind."""
    random = np.random.default_rng(seed)
    spread = {r.name: r.at(random.random()) for r in (*OPERATION, *SPECIMEN)}
    moved = with_motion(
        axis,
        period_s=heard.period_s,
        load_speed_rad_s=heard.speed_rad_s,
        acceleration_time_s=min(spread["acceleration_time_s"], 0.2 * heard.period_s),
        dwell_s=min(spread["dwell_s"], 0.05 * heard.period_s),
    )
    return Scenario(
        axis=moved,
        payload_kg_m2=heard.payload_kg_m2,
        specimen=Specimen(
            int(random.integers(2**31)), spread["error_factor"], spread["friction_factor"], spread["damping_factor"]
        ),
        microphone=detuned(microphone, random),
        duration_s=heard.samples.size / SAMPLE_RATE_HZ,
        start_phase=spread["start_phase"],
        middle_rad=spread["middle_rad"],
        noise_seed=int(random.integers(2**31)),
    )


def _spectra(samples: NDArray[np.float32]) -> tuple[Array, Array, Array]:
    """Frequencies [Hz] and power spectral densities [1/Hz] at full speed and at standstill."""
    frequency, _, density = signal.spectrogram(
        samples.astype(np.float64), SAMPLE_RATE_HZ, nperseg=WINDOW, noverlap=WINDOW * 3 // 4
    )
    loud = density[(frequency > 250) & (frequency < 3500)].mean(axis=0)
    moving = density[:, loud >= np.percentile(loud, MOVING)].mean(axis=1)
    still = density[:, loud <= np.percentile(loud, STILL)].mean(axis=1)
    tiny = 1e-20
    return frequency, ndimage.median_filter(moving, SMOOTHING_BINS) + tiny, ndimage.median_filter(still, 9) + tiny


def _ambient(frequency: Array, density: Array) -> tuple[float, float]:
    """(level, slope) of level / frequency^slope; modes that still ring stand above it, so high values count less."""
    x, y = np.log(frequency), np.log(density)

    def misfit(p: Array) -> Array:
        difference = y - (p[0] - p[1] * x)
        return np.asarray(np.where(difference > 0, 0.3, 1.0) * difference)

    found = optimize.least_squares(
        misfit, [y.mean() + x.mean(), 1.0], bounds=([-60.0, 0.0], [30.0, 2.0]), loss="soft_l1"
    )
    return math.exp(found.x[0]), float(found.x[1])


def _modes(frequency: Array, density: Array, ambient: Array) -> tuple[tuple[Mode, ...], float]:
    """Modes whose path explains the spectrum, and the misfit [dB]."""
    measured = 10 * np.log10(density)
    peaks, shape = signal.find_peaks(ndimage.gaussian_filter1d(measured, 1.5), prominence=PROMINENCE_DB)
    peaks = peaks[np.argsort(shape["prominences"])[::-1][:MOST_MODES]]
    if peaks.size == 0:
        peaks = np.array([int(np.argmax(measured))])
    to_density = 2.0 / SAMPLE_RATE_HZ  # of white noise of RMS 1
    n = peaks.size

    def modes(p: Array) -> tuple[Mode, ...]:
        return tuple(Mode(*map(float, row)) for row in np.exp(p).reshape(3, n).T)

    def misfit(p: Array) -> Array:
        path = np.abs(Microphone(modes=modes(p)).path(frequency)) ** 2
        return np.asarray(10 * np.log10(path * to_density + ambient) - measured)

    best: optimize.OptimizeResult | None = None
    for damping in START_DAMPING:
        amplitude = np.sqrt(density[peaks] / to_density) * 2 * damping
        start = np.log(np.concatenate([frequency[peaks], np.full(n, damping), amplitude]))
        reach = np.concatenate([np.full(n, 0.1), np.full(n, 5.0), np.full(n, 5.0)])
        bounds = (
            start - reach,
            np.minimum(start + reach, np.where(np.arange(3 * n) // n == 1, math.log(0.4), math.inf)),
        )
        found = optimize.least_squares(misfit, start, bounds=bounds)
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    ordered = tuple(sorted(modes(best.x), key=lambda mode: mode.frequency_hz))
    return ordered, math.sqrt(float(np.mean(best.fun**2)))


def _lines(axis: Axis, unit: Microphone, heard: NormalRecording) -> tuple[float | None, ...]:
    """RMS force of the line of every mesh over that of rubbing."""
    frequency, _, density = signal.spectrogram(
        heard.samples.astype(np.float64), SAMPLE_RATE_HZ, nperseg=4096, noverlap=3072
    )
    loud = density[(frequency > 250) & (frequency < 3500)].mean(axis=0)
    average = density[:, loud >= np.percentile(loud, MOVING)].mean(axis=1)
    out: list[float | None] = []
    for at in _engagement_hz(axis, heard.speed_rad_s):
        near = np.abs(frequency - at) < 0.02 * at + 4
        around = (np.abs(frequency - at) < 0.08 * at + 20) & ~near
        floor = float(np.median(average[around])) if around.any() else math.inf
        power = float(np.clip(average[near] - floor, 0, None).sum() * frequency[1])
        visible = near.any() and float(average[near].max()) > 3 * floor
        path = float(np.abs(unit.path(np.array([at]))[0]))
        out.append(math.sqrt(power) / path if visible else None)
    return tuple(out)


def _engagement_hz(axis: Axis, speed_rad_s: float) -> list[float]:
    teeth = [stage.driven_teeth or 0 for stage in axis.stages]
    return [
        z * axis.ratio_from(stage.name) * speed_rad_s / (2 * math.pi)
        for z, stage in zip(teeth, axis.stages, strict=True)
    ]


def _together(lines: Sequence[float | None]) -> float | None:
    seen = [line for line in lines if line is not None]
    return float(np.exp(np.mean(np.log(seen)))) if seen else None


def _rubbing(axis: Axis, recordings: Sequence[NormalRecording], measured: tuple[float | None, ...]) -> float:
    """Rubbing [N m] for which simulated engagement of as-new wheels stands over it as measured."""
    heard = recordings[0]
    moved = with_motion(axis, period_s=heard.period_s, load_speed_rad_s=heard.speed_rad_s)
    scenario = Scenario(moved, heard.payload_kg_m2, Specimen(0), Microphone(), 2 * heard.period_s)
    forces, speed = heard_forces(scenario.simulate(), axis)
    ratios = []
    for mesh, at in enumerate(_engagement_hz(axis, heard.speed_rad_s)):
        cruising = np.abs(speed) > 0.95 * heard.speed_rad_s
        simulated = _tone(forces[cruising, mesh], at)
        line = measured[mesh]
        if line is not None:
            ratios.append(simulated / line)
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else UNSEEN_RUBBING_N_M


UNSEEN_RUBBING_N_M = 10.0  # where no engagement stands out: rubbing above it, the loud end of what is usual


def _tone(torque: Array, at_hz: float) -> float:
    frequency, density = signal.welch(torque, SAMPLE_RATE_HZ, nperseg=4096)
    near = np.abs(frequency - at_hz) < 0.02 * at_hz + 4
    return math.sqrt(float(density[near].sum() * frequency[1]))
