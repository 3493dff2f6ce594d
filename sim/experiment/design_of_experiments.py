"""Space-filling plans of scenarios: what may differ between recordings of an axis, and how far.

Every quantity has a range; a plan of n recordings is the first n points of a scrambled Halton sequence over all
of them, so that a longer plan contains the shorter one of the same seed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, Mode
from sim.description.axis import Axis, MechanismEntry, Motion
from sim.errors import ParameterError, SimulationError, near_match
from sim.experiment.scenario import Scenario, travel_rad
from sim.experiment.specimen import Specimen
from sim.mechanisms import MECHANISMS, Backlash, BearingDefect, ElectricalHum, ToothDamage
from sim.mechanisms.catalogue import with_mechanism
from sim.mechanisms.mechanism import Measurement, Mechanism, Parameter

Array = NDArray[np.float64]
DURATION_S = 10.0


@dataclass(frozen=True)
class Range:
    """Where a quantity of a plan lies; `log` spreads orders of magnitude evenly."""

    name: str
    low: float
    high: float
    log: bool = False

    def at(self, fraction: float) -> float:
        """The value at a fraction in [0, 1)."""
        if self.log:
            return float(self.low * (self.high / self.low) ** fraction)
        return float(self.low + (self.high - self.low) * fraction)


OPERATION = (
    Range("payload_factor", 0.5, 1.3),  # of the load's inertia in the description
    Range("speed_factor", 0.75, 1.1),  # of the motion's speed
    Range("travel_rad", 1.2, 6.3, log=True),  # joints of robots reach +-180 degrees at most
    Range("acceleration_time_s", 0.15, 0.6, log=True),
    Range("dwell_s", 0.0, 0.4),
    Range("start_phase", 0.0, 1.0),
    Range("middle_rad", -0.5, 0.5),
    Range("speed_bandwidth_rad_s", 40.0, 160.0, log=True),
)
SPECIMEN = (
    Range("error_factor", 0.3, 1.5, log=True),  # of the transmission errors in the description
    Range("friction_factor", 0.7, 1.4, log=True),
    Range("damping_factor", 0.5, 2.0, log=True),
)
MICROPHONE = (
    Range("rubbing_n_m", 0.7, 15.0, log=True),
    Range("rubbing_exponent", 0.5, 1.5),
    Range("ambient_share", 0.02, 0.3, log=True),  # of the sound of rubbing, RMS
    Range("ambient_slope", 0.0, 1.5),
    Range("level", 0.02, 0.2, log=True),  # RMS over full scale
)
FAULT = (Range("size", 0.0, 1.0), Range("place", 0.0, 1.0), Range("flank", 0.0, 1.0))

GAP_RAD = Range("gap_rad", 2e-4, 3e-3, log=True)  # 0.7 to 10 minutes of arc: just worn to badly worn
DEPTH_RAD = Range("depth_rad", 1e-4, 2e-3, log=True)
VISITED = 0.4  # of the way at full speed to either side of its middle: braking, the other flank carries the torque

LABELS: Mapping[str, str | None] = {"normal": None, "play": Backlash.name, "notch": ToothDamage.name}
"""Which mechanism a label stands for; every other mechanism that is heard is its own label."""

FAULTS = frozenset({Backlash.name, ToothDamage.name, BearingDefect.name})
"""What a sound gearbox does not have. A description may say so of one gearbox; its kind is described without."""

USUAL = 4.0  # sizes of other mechanisms lie between their default over this and times this
DETAIL = 1.5  # the same for their other parameters


def labels() -> tuple[str, ...]:
    """All labels that can be generated: those of `LABELS`, then mechanisms by name."""
    others = (name for name, kind in MECHANISMS.items() if name not in LABELS.values() and not _is_silent(kind))
    return (*LABELS, *others)


def labels_of(axis: Axis) -> tuple[str, ...]:
    """Those of `labels` that an axis can have: its description has the part, with the numbers that are needed."""
    return tuple(label for label in labels() if obstacle(axis, label) is None)


def obstacle(axis: Axis, label: str) -> str | None:
    """Why no case of a label can be generated for an axis; None where it can."""
    name = LABELS.get(label, label)
    try:
        if name is not None:
            kind = MECHANISMS[name]
            axis = with_mechanism(axis, kind(None, {kind.size: _possible(kind, axis, kind().values[kind.size])}))
        _check(axis)
    except SimulationError as error:
        return str(error)
    return None


def _possible(kind: type[Mechanism], axis: Axis, size: float) -> float:
    """The size, or the largest that the axis can have; one that can have none of it is refused as it is simulated."""
    return min(size, kind.largest(axis) or size)


def _check(axis: Axis) -> None:
    """Raise SimulationError where no sound of an axis can be simulated."""
    specimen = Specimen(0)
    specimen.train(specimen.built(axis, axis.load.inertia_kg_m2))


def _is_silent(kind: type[Mechanism]) -> bool:
    """Whether it is of telemetry alone."""
    return issubclass(kind, Measurement) and kind.distort_sound is Measurement.distort_sound


@dataclass(frozen=True)
class Planned:
    """A scenario with its label, and the size of its fault in the contract's unit (None for normal)."""

    label: str
    scenario: Scenario
    size: float | None

    @property
    def mechanism(self) -> MechanismEntry | None:
        """The fault; None for normal."""
        return self.scenario.axis.mechanisms[-1] if self.size is not None else None


def around(axis: Axis) -> tuple[Range, ...]:
    """Ranges of the motion about what the description says of it, as wide as that of the speed; the period says the
    stroke."""
    spread = next(each for each in OPERATION if each.name == "speed_factor")
    said = {
        "travel_rad": ("period_s", travel_rad(axis.motion)),
        "acceleration_time_s": ("acceleration_time_s", axis.motion.acceleration_time_s),
        "dwell_s": ("dwell_s", axis.motion.dwell_s),
    }
    return tuple(
        Range(name, spread.low * value, spread.high * value)
        for name, (key, value) in said.items()
        if axis.describes_motion(key)
    )


def plan(
    axis: Axis,
    counts: Mapping[str, int],
    seed: int = 0,
    *,
    microphones: Sequence[Microphone] = (),
    duration_s: float = DURATION_S,
    operation: Sequence[Range] = (),
    only: range | None = None,
) -> list[Planned]:
    """Scenarios for each label, `counts[label]` of them.

    Parameters
    ----------
    axis
        Its faults, such as an investigation may have found, are left out; all else that it has stays.
    microphones
        Paths fitted to the place, one per gearbox heard; each case takes one of them, slightly detuned. Without any,
        every case has a housing of its own drawn from all that is usual.
    operation
        Ranges that stand for those of the same name in `OPERATION`.
    only
        Which of them, counted over all labels; all if None.

    Raises ParameterError for a label that stands for no mechanism, AxisError for an axis that makes no sound.
    """
    from scipy.stats import qmc  # slow to import

    axis = replace(axis, mechanisms=tuple(each for each in axis.mechanisms if each.name not in FAULTS))
    _check(axis)
    for label in counts:
        if label not in labels():
            raise ParameterError(f"label: {label!r} cannot be generated{near_match(label, labels())}")
    names = [r.name for r in (*OPERATION, *SPECIMEN, *MICROPHONE, *FAULT)]
    ranges = (*OPERATION, *SPECIMEN, *MICROPHONE, *operation)
    out, first = [], 0
    for number, (label, count) in enumerate(counts.items()):
        sequence = qmc.Halton(len(names), scramble=True, rng=np.random.default_rng([seed, number]))
        for index, point in enumerate(sequence.random(count)):
            if only is not None and first + index not in only:
                continue
            draw = dict(zip(names, map(float, point), strict=True))
            random = np.random.default_rng([seed, number, index])
            value = {r.name: r.at(draw[r.name]) for r in ranges}
            out.append(_planned(axis, label, draw, value, random, microphones, duration_s))
        first += count
    return out


def _planned(
    axis: Axis,
    label: str,
    draw: Mapping[str, float],
    value: Mapping[str, float],
    random: np.random.Generator,
    microphones: Sequence[Microphone],
    duration_s: float,
) -> Planned:
    speed = value["speed_factor"] * axis.motion.load_speed_rad_s
    cruise = value["travel_rad"] / speed
    ramp = min(value["acceleration_time_s"], 0.8 * cruise)
    motion = Motion(2 * (cruise + ramp + value["dwell_s"]), speed, ramp, value["dwell_s"])
    microphone = (
        detuned(microphones[int(random.integers(len(microphones)))], random) if microphones else _housing(value, random)
    )
    payload = value["payload_factor"] * axis.load.inertia_kg_m2
    specimen = Specimen(
        int(random.integers(2**31)), value["error_factor"], value["friction_factor"], value["damping_factor"]
    )
    entry = _fault(specimen.built(axis, payload), label, draw, value["middle_rad"], value["travel_rad"] - speed * ramp)
    moved = replace(
        axis,
        motion=motion,
        servo=replace(axis.servo, speed_bandwidth_rad_s=value["speed_bandwidth_rad_s"]),
        mechanisms=(*axis.mechanisms, *((entry,) if entry else ())),
    )
    scenario = Scenario(
        axis=moved,
        payload_kg_m2=payload,
        specimen=specimen,
        microphone=microphone,
        duration_s=duration_s,
        start_phase=value["start_phase"],
        middle_rad=value["middle_rad"],
        noise_seed=int(random.integers(2**31)),
    )
    size = None if entry is None else entry.parameters[MECHANISMS[entry.name].size]
    return Planned(label, scenario, size)


def _fault(
    axis: Axis, label: str, draw: Mapping[str, float], middle_rad: float, full_speed_rad: float
) -> MechanismEntry | None:
    name = LABELS.get(label, label)
    if name is None:
        return None
    kind = MECHANISMS[name]
    values = {each.name: _usual(each, draw["place"], each.name == kind.size, draw["size"]) for each in kind.parameters}
    values[kind.size] = _possible(kind, axis, values[kind.size])
    if kind is Backlash:
        values = {"gap_rad": GAP_RAD.at(draw["size"])}
    if kind is ToothDamage:
        angle = middle_rad + (2 * draw["place"] - 1) * VISITED * full_speed_rad
        flank = 1.0 if draw["flank"] < 0.5 else -1.0
        values = {"angle_rad": angle, "depth_rad": DEPTH_RAD.at(draw["size"]), "flank": flank}
    if kind is ElectricalHum:
        values["sound"] = 0.1 * draw["size"]
    return kind(kind(None).placed(axis) or None, values).entry()


def _usual(parameter: Parameter, place: float, is_size: bool, size: float) -> float:
    """A value of a mechanism without a range of its own here: about its default."""
    if parameter.periodic:
        return parameter.low + place * (parameter.high - parameter.low)
    if parameter.choices:
        return parameter.choices[int(place * len(parameter.choices))]
    spread = USUAL ** (2 * size - 1) if is_size else DETAIL ** (2 * place - 1)
    return float(np.clip(parameter.default * spread, parameter.low, parameter.high))


def moved(planned: Planned, motion: Motion, payload_kg_m2: float) -> Planned:
    """The same specimen, microphone and fault under another motion and payload; damage stays at the same share of the
    way at full speed."""
    scenario, entry = planned.scenario, planned.mechanism
    mechanisms = scenario.axis.mechanisms
    if entry is not None and entry.name == ToothDamage.name:
        share = (entry.parameters["angle_rad"] - scenario.middle_rad) / _full_speed_rad(scenario.axis.motion)
        angle = scenario.middle_rad + share * _full_speed_rad(motion)
        mechanisms = (*mechanisms[:-1], replace(entry, parameters={**entry.parameters, "angle_rad": angle}))
    axis = replace(scenario.axis, motion=motion, mechanisms=mechanisms)
    return replace(planned, scenario=replace(scenario, axis=axis, payload_kg_m2=payload_kg_m2))


def _full_speed_rad(motion: Motion) -> float:
    """Angle over which the output runs at full speed in one stroke."""
    return motion.load_speed_rad_s * (motion.period_s / 2 - motion.dwell_s - 2 * motion.acceleration_time_s)


def usual_microphone(random: np.random.Generator) -> Microphone:
    """A microphone at a housing drawn from all that is usual."""
    return _housing({r.name: r.at(random.random()) for r in MICROPHONE}, random)


MODES = (4, 6)
LOWEST_MODE_HZ, HIGHEST_MODE_HZ = (60.0, 130.0), 3500.0
MODE_DAMPING = Range("damping_ratio", 0.015, 0.08, log=True)
DETUNING = 0.05  # of the modes of a housing of the same kind
RUBBING_SPREAD = 0.3  # standard deviation of its logarithm


def _housing(value: Mapping[str, float], random: np.random.Generator) -> Microphone:
    """A housing drawn from what is usual: four to six modes from about 90 Hz up, evenly spread in the logarithm."""
    count = int(random.integers(MODES[0], MODES[1] + 1))
    lowest = random.uniform(*LOWEST_MODE_HZ)
    grid = lowest * (HIGHEST_MODE_HZ / lowest) ** (np.arange(count) / count)
    frequencies = grid * random.uniform(0.85, 1.15, count)
    modes = tuple(
        Mode(float(f), MODE_DAMPING.at(random.random()), float(np.exp(random.normal(0.0, 0.5)))) for f in frequencies
    )
    return scaled(
        Microphone(modes, rubbing_n_m=value["rubbing_n_m"], rubbing_exponent=value["rubbing_exponent"]),
        ambient_share=value["ambient_share"],
        ambient_slope=value["ambient_slope"],
        level=value["level"],
    )


def scaled(microphone: Microphone, *, ambient_share: float, ambient_slope: float, level: float) -> Microphone:
    """The microphone with ambient noise and gain relative to what it hears of rubbing at full speed."""
    heard = microphone.rubbing_n_m * path_rms(microphone)
    return replace(
        microphone, ambient_n_m=ambient_share * heard, ambient_slope=ambient_slope, gain=level / max(heard, 1e-12)
    )


def path_rms(microphone: Microphone) -> float:
    """RMS that white noise of RMS 1 at 8 kHz has after the path."""
    frequency = np.linspace(0, SAMPLE_RATE_HZ / 2, 8001)
    return math.sqrt(float(np.mean(np.abs(microphone.path(frequency)) ** 2)))


def detuned(microphone: Microphone, random: np.random.Generator) -> Microphone:
    """The microphone at another gearbox of the same kind: all modes higher or lower together, other rubbing."""
    together = math.exp(random.normal(0.0, DETUNING))
    modes = tuple(replace(mode, frequency_hz=mode.frequency_hz * together) for mode in microphone.modes)
    rubbing = microphone.rubbing_n_m * math.exp(random.normal(0.0, RUBBING_SPREAD))
    return replace(microphone, modes=modes, rubbing_n_m=rubbing)
