"""The tendency of faults: features over the size of a fault, over payload and over the frequency of the motion.

Olsson and Stolyarchuk ask for it ('tendency of faults development'). Everything but one quantity stays as it is:
same specimen, same microphone, same noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from casebase.signals.features import extract
from casebase.signals.recording import Recording
from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, Mode
from sim.description.axis import Axis, MechanismEntry
from sim.experiment.design_of_experiments import DEPTH_RAD, GAP_RAD
from sim.experiment.scenario import Scenario, with_motion
from sim.experiment.specimen import Specimen
from sim.mechanisms import Backlash, ToothDamage

FEATURES = ("crest_factor_low_pass_200_hz_whole_record", "notch_bump_12_200_hz", "play_bump_12_200_hz")
MICROPHONE = Microphone(
    modes=(Mode(100.0, 0.2, 0.6), Mode(320.0, 0.05, 1.0), Mode(760.0, 0.03, 0.3), Mode(1530.0, 0.024, 0.15)),
    gain=5e-3,
    rubbing_n_m=5.0,
    ambient_n_m=0.5,
)
DURATION_S = 20.0
MIDDLE_GAP_RAD, MIDDLE_DEPTH_RAD = 1e-3, 1e-3
SPECIMENS = (1, 2, 3)


@dataclass(frozen=True)
class Curve:
    """A feature over a quantity, for one label: mean and spread over the specimens, shape (points,) each."""

    label: str
    over: str
    unit: str
    feature: str
    at: tuple[float, ...]
    mean: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


def curves(axis: Axis, points: int, advance: Callable[[], None]) -> list[Curve]:
    """All curves: size, payload and frequency of the motion, for play and notch.

    `advance` is told of every recording simulated; there are 2 * 3 * points * specimens of them.
    """
    inertia, period = axis.load.inertia_kg_m2, axis.motion.period_s
    grids = {
        "payload": ("kg m2", np.linspace(0.5 * inertia, 1.3 * inertia, points)),
        "motion frequency": ("Hz", np.linspace(0.6 / period, 1.2 / period, points)),
    }
    out: list[Curve] = []
    for label, span in (("play", GAP_RAD), ("notch", DEPTH_RAD)):
        sizes = np.geomspace(span.low, span.high, points)
        for over, (unit, at) in {"size": ("rad", sizes), **grids}.items():
            values = np.array(
                [[_features(axis, label, over, float(x), seed, advance) for seed in SPECIMENS] for x in at]
            )
            out.extend(_curve(label, over, unit, at, values[:, :, i], name) for i, name in enumerate(FEATURES))
    return out


def _curve(
    label: str, over: str, unit: str, at: Sequence[float] | np.ndarray, values: np.ndarray, feature: str
) -> Curve:
    def row(numbers: np.ndarray) -> tuple[float, ...]:
        return tuple(float(each) for each in numbers)

    return Curve(
        label, over, unit, feature, row(np.asarray(at)), row(values.mean(1)), row(values.min(1)), row(values.max(1))
    )


def _features(axis: Axis, label: str, over: str, x: float, seed: int, advance: Callable[[], None]) -> list[float]:
    size = x if over == "size" else MIDDLE_GAP_RAD if label == "play" else MIDDLE_DEPTH_RAD
    moved = with_motion(axis, period_s=1 / x) if over == "motion frequency" else axis
    where = axis.stages[-1].name
    entry = (
        MechanismEntry(Backlash.name, where, {"gap_rad": size})
        if label == "play"
        else MechanismEntry(ToothDamage.name, where, {"angle_rad": 0.1, "depth_rad": size, "flank": 1.0})
    )
    scenario = Scenario(
        axis=replace(moved, mechanisms=(entry,)),
        payload_kg_m2=x if over == "payload" else axis.load.inertia_kg_m2,
        specimen=Specimen(seed),
        microphone=MICROPHONE,
        duration_s=DURATION_S,
        noise_seed=seed,
    )
    found = extract(Recording(scenario.perform(), SAMPLE_RATE_HZ)).features
    advance()
    return [found[name] for name in FEATURES]
