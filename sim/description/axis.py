"""An axis as its maker describes it: motor, gear stages, load; read from and written to TOML or JSON.

SI units stand in the keys. A stage bears the name of its driven gear; its inertia is that of the driven shaft, its
stiffness, damping, backlash and transmission error are felt at the driven gear. Angles of all shafts count alike
(a pair of gears turns back in truth; its sign is left out). A linear axis has N, m, kg where this says N m, rad, kg m2.
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields

from sim.errors import AxisError, ParameterError, near_match, number, shown

_UNITS = {
    "_kg_m2": "kg m2",
    "_n_m_s_per_rad": "N m s/rad",
    "_n_m_per_rad": "N m/rad",
    "_n_m": "N m",
    "_rad_s": "rad/s",
    "_per_s": "1/s",
    "_rad": "rad",
    "_s": "s",
}

_MOST = {
    "kg m2": 1e9,
    "N m s/rad": 1e12,
    "N m/rad": 1e15,
    "N m": 1e9,
    "rad/s": 1e6,
    "1/s": 1e6,
    "rad": 1.0,
    "s": 1e5,
    "1": 1e6,
}
"""Far above any axis that is built; beyond them lies a slip of the pen, and then an overflow."""


def check_quantities(table: object, positive: tuple[str, ...] = ()) -> None:
    """Validate every number of a description by the unit in its name; store it as float."""
    for item in fields(table):  # type: ignore[arg-type]
        value = getattr(table, item.name)
        if item.name == "name" or (value is None and item.default is None):
            continue
        if item.name.endswith("_teeth"):
            if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= 100_000:
                raise ParameterError(f"{item.name}: must be a whole number from 1 to 100000, got {shown(value)}")
        elif not (item.name.endswith("_limit_n_m") or item.name.endswith("_limit_rad_s")) or value != math.inf:
            object.__setattr__(table, item.name, _number(item.name, value, item.name in positive))


def _number(name: str, value: object, positive: bool) -> float:
    unit = next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix)), "1")
    most = 1.0 if name == "mesh_efficiency" else _MOST[unit]
    if positive or name == "mesh_efficiency" or name.endswith(("_limit_n_m", "_limit_rad_s")):
        return number(name, value, unit, above=0, at_most=most)
    return number(name, value, unit, at_least=0, at_most=most)


SCHEMA = "gearcase-axis/1"
MOST_TABLES = 100
"""Gear stages, or mechanisms, of one axis."""


@dataclass(frozen=True)
class Motor:
    """The motor shaft: rotor and everything that turns with it.

    An inertia of 0 is one that nobody knows: an investigation finds it, a simulation needs it. Friction is what the
    data sheet says for the motor's own bearings [N m], [N m s/rad]; the limits are those of the servo amplifier,
    infinite when not given.
    """

    inertia_kg_m2: float = 0.0
    coulomb_friction_n_m: float = 0.0
    viscous_friction_n_m_s_per_rad: float = 0.0
    torque_limit_n_m: float = math.inf
    speed_limit_rad_s: float = math.inf

    def __post_init__(self) -> None:
        check_quantities(self, positive=("inertia_kg_m2",) if self.inertia_kg_m2 != 0 else ())


@dataclass(frozen=True)
class Stage:
    """One gear stage: `ratio` is the driver's speed over the driven gear's.

    Either both tooth numbers or `ratio` must be given; where both are, they must agree. `stiffness_n_m_per_rad` None
    means that it is not known here: rigid, or its share of what `Transmission` says of the whole.
    """

    name: str
    ratio: float = 0.0
    driver_teeth: int | None = None
    driven_teeth: int | None = None
    inertia_kg_m2: float = 0.0
    stiffness_n_m_per_rad: float | None = None
    damping_n_m_s_per_rad: float | None = None
    mesh_efficiency: float = 1.0
    backlash_rad: float = 0.0
    transmission_error_rad: float = 0.0

    def __post_init__(self) -> None:
        check_quantities(self, positive=("stiffness_n_m_per_rad",))
        if (self.driver_teeth is None) != (self.driven_teeth is None):
            missing = "driver_teeth" if self.driver_teeth is None else "driven_teeth"
            raise ParameterError(f"{missing}: missing; give both tooth numbers, or `ratio` alone")
        if self.driver_teeth is not None and self.driven_teeth is not None:
            ratio = self.driven_teeth / self.driver_teeth
            if self.ratio and not math.isclose(self.ratio, ratio, rel_tol=1e-3):
                raise ParameterError(f"ratio: {self.ratio} is not {self.driven_teeth}/{self.driver_teeth}")
            object.__setattr__(self, "ratio", ratio)
        if self.ratio <= 0:
            raise ParameterError("ratio: must be > 0 (speed of driver over driven gear), or give tooth numbers")


@dataclass(frozen=True)
class Load:
    """What the last gear moves: arm and payload, with the friction of the joint's bearing at the load's own speed."""

    inertia_kg_m2: float
    coulomb_friction_n_m: float = 0.0
    viscous_friction_n_m_s_per_rad: float = 0.0

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True)
class Transmission:
    """All stages as one, felt at the output with the motor locked; None where only the stages are described."""

    stiffness_n_m_per_rad: float | None = None
    damping_n_m_s_per_rad: float | None = None

    def __post_init__(self) -> None:
        check_quantities(self, positive=("stiffness_n_m_per_rad",))


@dataclass(frozen=True)
class LoadEncoder:
    """Encoder at the load: amplitude of its error once per revolution, as new at most [rad]."""

    error_rad: float = 0.0

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True)
class Motion:
    """Back and forth as a robot moves: period and largest speed at the load, time to reach it, rest at each end."""

    period_s: float = 2.1
    load_speed_rad_s: float = 2.7
    acceleration_time_s: float = 0.2
    dwell_s: float = 0.0

    def __post_init__(self) -> None:
        check_quantities(self, positive=("period_s", "load_speed_rad_s", "acceleration_time_s"))
        if 4 * self.acceleration_time_s + 2 * self.dwell_s > self.period_s * (1 + 1e-9):
            raise ParameterError("period_s: must be at least 4 acceleration_time_s + 2 dwell_s")


@dataclass(frozen=True)
class Servo:
    """Cascaded control: position -> speed -> torque. None: chosen from the inertias by who simulates it."""

    position_gain_per_s: float | None = None
    speed_bandwidth_rad_s: float | None = None
    integral_time_s: float | None = None

    def __post_init__(self) -> None:
        check_quantities(self, positive=("position_gain_per_s", "speed_bandwidth_rad_s", "integral_time_s"))


@dataclass(frozen=True)
class MechanismEntry:
    """An effect that the plain axis lacks: a mechanism's name, where it acts, its parameters in SI units."""

    name: str
    location: str | None
    parameters: Mapping[str, float]

    def __post_init__(self) -> None:
        for key, value in self.parameters.items():
            number(key, value, "SI")


@dataclass(frozen=True)
class Axis:
    """An axis from motor to load; immutable: change it with `dataclasses.replace`.

    `motion_keys`: what the description says of the motion; the rest of it is defaults.
    """

    name: str
    motor: Motor
    load: Load
    stages: tuple[Stage, ...] = ()
    transmission: Transmission = Transmission()
    load_encoder: LoadEncoder = LoadEncoder()
    motion: Motion = Motion()
    servo: Servo = Servo()
    mechanisms: tuple[MechanismEntry, ...] = ()
    motion_keys: tuple[str, ...] = field(default=(), compare=False, repr=False)

    def __post_init__(self) -> None:
        names = [stage.name for stage in self.stages]
        for i, stage in enumerate(self.stages):
            if stage.name in ("", "motor", "load") or names.index(stage.name) != i:
                raise AxisError(f"stages[{i}].name: must be unique and neither 'motor' nor 'load', got {stage.name!r}")
            if i + 1 < len(self.stages) and stage.inertia_kg_m2 <= 0:
                raise AxisError(
                    f"stages[{i}].inertia_kg_m2: must be > 0 kg m2 for a shaft between two gears, "
                    f"got {stage.inertia_kg_m2:g}"
                )
        if self.stages and self.load.inertia_kg_m2 + self.stages[-1].inertia_kg_m2 <= 0:
            raise AxisError("load.inertia_kg_m2: must be > 0 kg m2 behind a gear, got 0")
        for i, entry in enumerate(self.mechanisms):
            if entry.location is not None and entry.location not in self.locations:
                raise AxisError(
                    f"mechanisms[{i}].location: {entry.location!r} is no shaft of this axis"
                    f"{near_match(entry.location, self.locations)}"
                )

    @property
    def locations(self) -> tuple[str, ...]:
        """Where an effect can act: the motor shaft, the driven gear of each stage, the load."""
        return ("motor", *(stage.name for stage in self.stages), "load")

    @property
    def ratio(self) -> float:
        """Motor speed over load speed."""
        return math.prod(stage.ratio for stage in self.stages)

    def describes_motion(self, key: str) -> bool:
        """Whether a number of the motion was given, and be it the default.

        >>> read_axis({"motor": {"inertia_kg_m2": 1}, "load": {"inertia_kg_m2": 1},
        ...            "motion": {"period_s": 2.1}}).describes_motion("period_s")
        True
        """
        return key in self.motion_keys or getattr(self.motion, key) != getattr(Motion(), key)

    def ratio_from(self, location: str) -> float:
        """Return the speed of the shaft at `location` over the load's speed.

        >>> read_axis({"motor": {"inertia_kg_m2": 1}, "load": {"inertia_kg_m2": 1},
        ...            "stages": [{"name": "output", "ratio": 8}]}).ratio_from("motor")
        8.0
        """
        names = [stage.name for stage in self.stages]
        after = 0 if location == "motor" else len(names) if location == "load" else names.index(location) + 1
        return math.prod(stage.ratio for stage in self.stages[after:])

    def stiffness(self) -> tuple[float | None, ...]:
        """Stiffness of every stage at its driven gear [N m/rad]; None is rigid.

        What `transmission` says of the whole and the stages leave open is shared alike: each open stage takes an
        equal part of the remaining compliance, felt at the output. A direct drive has one entry, its coupling.
        """
        return _shares(self, "stiffness_n_m_per_rad")

    def damping(self) -> tuple[float | None, ...]:
        """Damping of every stage at its driven gear [N m s/rad], shared as the stiffness is; None is not given."""
        return _shares(self, "damping_n_m_s_per_rad")

    def to_mapping(self) -> dict[str, object]:
        """Return the description as nested dicts and lists (JSON, TOML) that `read_axis` takes."""
        out: dict[str, object] = {"schema": SCHEMA, "name": self.name, "motor": _table(self.motor)}
        for key in ("transmission", "load", "load_encoder", "motion", "servo"):
            table = _table(getattr(self, key))
            if key == "motion":
                table |= {one: getattr(self.motion, one) for one in self.motion_keys}
            if table or key == "load":
                out[key] = table
        if self.stages:
            out["stages"] = [_stage_table(stage) for stage in self.stages]
        if self.mechanisms:
            out["mechanisms"] = [_entry_table(entry) for entry in self.mechanisms]
        return out


def _shares(axis: Axis, key: str) -> tuple[float | None, ...]:
    whole = getattr(axis.transmission, key)
    if not axis.stages:
        return (whole,)
    own = [getattr(stage, key) for stage in axis.stages]
    open_stages = own.count(None)
    if whole is None or open_stages == 0:
        return tuple(own)
    squared = [axis.ratio_from(stage.name) ** 2 for stage in axis.stages]
    known = sum(1 / (value * r2) for value, r2 in zip(own, squared, strict=True) if value)
    left = 1 / whole - known if whole else 0.0
    if whole and left <= 0:
        raise AxisError(
            f"transmission.{key}: {whole:g} for the whole is not below what the stages alone give, {1 / known:g}"
        )
    share = open_stages / left if whole else 0.0
    return tuple(share / r2 if value is None else value for value, r2 in zip(own, squared, strict=True))


def _table(part: object) -> dict[str, object]:
    """Return what differs from the default, and what has none."""
    out = {}
    for one in fields(part):  # type: ignore[arg-type]
        value = getattr(part, one.name)
        if one.default is MISSING or value != one.default:
            out[one.name] = value
    return out


def _stage_table(stage: Stage) -> dict[str, object]:
    table = _table(stage)
    if stage.driver_teeth is not None:
        del table["ratio"]
    return table


def _entry_table(entry: MechanismEntry) -> dict[str, object]:
    place = {} if entry.location is None else {"location": entry.location}
    return {"name": entry.name, **place, **entry.parameters}
