"""A trial of an axis: its sound with parameters from sliders, simulated in the limited process.

A light wheel in a stiff mesh takes thousands of steps for each one of the sound, and who tries is not made to know.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from casebase.signals.limited_pool import GaveUpError, LimitedPool, RefusedError
from casebase.signals.limited_worker import Send
from sim.axis import Axis, MechanismEntry, read_axis
from sim.errors import RunError, SimulationError
from sim.scenario import Scenario, with_motion
from sim.sound import SAMPLE_RATE_HZ, Microphone, Mode
from sim.specimen import Specimen

SHOWN_S = 8.0
DEFAULT_MODES = (Mode(320.0, 0.04, 1.0), Mode(900.0, 0.03, 0.6), Mode(1700.0, 0.03, 0.4))
LIMITS: Mapping[str, float] = {"seconds": 40.0, "cpu_seconds": 15.0, "memory_bytes": 2 << 30}
"""A gearbox takes a fifth of a second; the first trial of a process also loads compiled code, which takes a few."""

TRIALS = LimitedPool(1, "app.web.trial")


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


def simulate(trial: Trial) -> NDArray[np.float32]:
    """Return the sound of a trial, at `SAMPLE_RATE_HZ`.

    Raises:
        SimulationError: if these parameters cannot be simulated, or not within the limits.
        DecoderUnavailableError: if the limited process cannot be started.
    """
    asked = {**asdict(trial), "axis": trial.axis.to_mapping()}
    try:
        content, _ = TRIALS.perform("app.web.trial:task", asked, LIMITS, round(8 * SHOWN_S * SAMPLE_RATE_HZ))
    except RefusedError as refused:
        raise SimulationError(str(refused)) from None
    except GaveUpError as error:
        raise RunError(
            f"the simulation was given up ({error}): a very light wheel in a stiff mesh, or very strong damping, needs "
            "steps too small to try here; bring the description's inertias, stiffness and friction nearer to those of "
            "a gearbox"
        ) from error
    return np.frombuffer(content, dtype=np.float32)


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
    entries = list(axis.mechanisms)
    if values["gap_mrad"] > 0:
        entries.append(MechanismEntry("backlash", last, {"gap_rad": values["gap_mrad"] * 1e-3}))
    if values["notch_mrad"] > 0:
        parameters = {"depth_rad": values["notch_mrad"] * 1e-3, "angle_rad": 0.0, "flank": 1.0}
        entries.append(MechanismEntry("tooth_damage", last, parameters))
    stiffness = axis.stiffness()[-1]
    if stiffness is not None:
        stage = replace(axis.stages[-1], stiffness_n_m_per_rad=stiffness * values["stiffness"])
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
