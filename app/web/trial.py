"""A trial of an axis: its sound with parameters from sliders, simulated in the limited process.

A light wheel in a stiff mesh takes thousands of steps for each one of the sound, and who tries is not made to know.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from casebase.signals.limited_pool import GaveUpError, LimitedPool, RefusedError
from casebase.signals.limited_worker import Send
from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, Mode
from sim.description.axis import Axis, MechanismEntry
from sim.description.axis_document import read_axis
from sim.errors import RunError, SimulationError
from sim.experiment.scenario import Scenario, with_motion
from sim.experiment.specimen import Specimen
from sim.mechanisms import MECHANISMS, Backlash, ToothDamage
from sim.mechanisms.mechanism import Mechanism

SHOWN_S = 8.0
DEFAULT_MODES = (Mode(320.0, 0.04, 1.0), Mode(900.0, 0.03, 0.6), Mode(1700.0, 0.03, 0.4))
LIMITS: Mapping[str, float] = {"seconds": 40.0, "cpu_seconds": 15.0, "memory_bytes": 2 << 30}
"""A gearbox takes a fifth of a second; the first trial of a process also loads compiled code, which takes a few."""

TRIED = (Backlash.name, ToothDamage.name)
"""Mechanisms that sliders stand for, at the last mesh."""
TRIALS = LimitedPool(1, "app.web.trial")
KEPT = 8
"""Trials whose sounds are kept: who opens the page again, or moves a slider back, hears the same."""


@dataclass(frozen=True)
class Trial:
    """What is tried.

    Args:
        axis: its description.
        values: of the sliders.
        payload_kg_m2, speed_rad_s, period_s: of the recording that it is held against, where known.
    """

    axis: Axis
    values: Mapping[str, float]
    payload_kg_m2: float | None = None
    speed_rad_s: float | None = None
    period_s: float | None = None


def besides(axis: Axis) -> tuple[MechanismEntry, ...]:
    """Return the mechanisms of a revision that no slider stands for: all but play and notches of the last mesh."""
    return tuple(entry for entry in axis.mechanisms if not (entry.name in TRIED and _at_the_last(axis, entry)))


def starts(axis: Axis) -> Mapping[str, float]:
    """Return where the sliders of play and notch begin: at what the revision has at its last mesh [mrad].

    As play of a description counts the most that the gear has as new.
    """
    gaps = [built(entry)["gap_rad"] for entry in _those_of_the_last(axis, Backlash.name)]
    notch = _deepest(axis)
    return {
        "gap_mrad": 1e3 * max([axis.stages[-1].backlash_rad, *gaps]),
        "notch_mrad": 1e3 * notch["depth_rad"] if notch else 0.0,
    }


def built(entry: MechanismEntry) -> Mechanism:
    """Return the mechanism of a description, with its defaults."""
    return MECHANISMS[entry.name](entry.location, entry.parameters)


def _deepest(axis: Axis) -> Mechanism | None:
    notches = [built(entry) for entry in _those_of_the_last(axis, ToothDamage.name)]
    return max(notches, key=lambda notch: notch["depth_rad"], default=None)


def _those_of_the_last(axis: Axis, name: str) -> list[MechanismEntry]:
    return [entry for entry in axis.mechanisms if entry.name == name and _at_the_last(axis, entry)]


def _at_the_last(axis: Axis, entry: MechanismEntry) -> bool:
    return built(entry).placed(axis) == axis.stages[-1].name


def simulate(trial: Trial) -> NDArray[np.float32]:
    """Return the sound of a trial, at `SAMPLE_RATE_HZ`.

    Raises:
        SimulationError: if these parameters cannot be simulated, or not within the limits.
        DecoderUnavailableError: if the limited process cannot be started.
    """
    content = _performed(json.dumps({**asdict(trial), "axis": trial.axis.to_mapping()}, sort_keys=True))
    return np.frombuffer(content, dtype=np.float32)


@lru_cache(KEPT)
def _performed(asked: str) -> bytes:
    """Samples (float32) of what is asked, as JSON; the same trial sounds the same."""
    try:
        content, _ = TRIALS.perform(
            "app.web.trial:task", json.loads(asked), LIMITS, round(8 * SHOWN_S * SAMPLE_RATE_HZ)
        )
    except RefusedError as refused:
        raise SimulationError(str(refused)) from None
    except GaveUpError as error:
        raise RunError(
            f"the simulation was given up ({error}): a very light wheel in a stiff mesh, or very strong damping, needs "
            "steps too small to try here; bring the description's inertias, stiffness and friction nearer to those of "
            "a gearbox"
        ) from error
    return bytes(content)


def task(request: Mapping[str, Any], _: Mapping[str, float], send: Send) -> None:
    """Task: simulate a trial and send its samples (float32)."""
    try:
        samples = perform(Trial(**{**request, "axis": read_axis(request["axis"])}))
    except SimulationError as error:
        raise RefusedError("simulation", str(error)) from error
    send(np.ascontiguousarray(samples, dtype=np.float32).data)


def perform(trial: Trial) -> NDArray[np.float32]:
    """Return the sound of a trial, simulated here and now. Raises SimulationError."""
    axis, values = trial.axis, trial.values
    if trial.speed_rad_s:
        axis = with_motion(axis, load_speed_rad_s=trial.speed_rad_s)
    if trial.period_s:
        axis = with_motion(axis, period_s=trial.period_s)
    last = axis.stages[-1].name
    gap = MechanismEntry(Backlash.name, last, {"gap_rad": values["gap_mrad"] * 1e-3})
    known = _deepest(axis)
    place = known.values if known else {"angle_rad": 0.0, "flank": 1.0}
    notch = MechanismEntry(ToothDamage.name, last, {**place, "depth_rad": values["notch_mrad"] * 1e-3})
    entries = [*besides(axis), gap, notch]
    stiffness = axis.stiffness()[-1]
    stage = replace(axis.stages[-1], backlash_rad=0.0)  # the slider says what the play is
    if stiffness is not None:
        stage = replace(stage, stiffness_n_m_per_rad=stiffness * values["stiffness"])
    axis = replace(axis, stages=(*axis.stages[:-1], stage))
    scenario = Scenario(
        axis=replace(axis, mechanisms=tuple(entries)),
        payload_kg_m2=trial.payload_kg_m2 or axis.load.inertia_kg_m2,
        specimen=Specimen(seed=1, error=values["error"], damping=values["damping"]),
        microphone=Microphone(
            modes=DEFAULT_MODES,
            gain=1e-3,
            rubbing_n_m=10 ** (values["rubbing_db"] / 20),
            ambient_n_m=10 ** (values["ambient_db"] / 20),
        ),
        duration_s=SHOWN_S,
    )
    return scenario.perform()
