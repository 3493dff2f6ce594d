"""Real drives with what is known of them: each log as it was recorded, the map that reads it, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from benchmarks.shared_data import SHARED
from signals.telemetry import Telemetry, read_telemetry
from sim.description.axis import Axis
from sim.description.axis_document import read_axis

EPOS = """
[time_s]
column = 1
unit = "ms"
[motor_speed_rad_s]
column = "Velocity actual value averaged"
unit = "rpm"
[motor_torque_nm]
column = "Torque actual value averaged"
unit = "%"
factor = 9.84e-5
"""
ODRIVE = """
[time_s]
column = "time"
[motor_position_rad]
column = "ODrive 2 Position"
unit = "rev"
[motor_speed_rad_s]
column = "ODrive 2 Velocity"
unit = "rev/s"
[motor_torque_nm]
column = "ODrive 2 Current"
unit = "A"
factor = 0.055133
"""
SERVO = """
[time_s]
column = "timestamp"
unit = "iso8601"
[motor_position_rad]
column = "target pos (5)"
unit = "count"
counts_per_rev = 4096
[load_position_rad]
column = "pos (5)"
unit = "count"
counts_per_rev = 4096
"""
ROBOT_GAINS = {1: 10.0, 3: 8.4566, 5: 9.48}


def robot(joint: int) -> str:
    """The map of one joint of the robot's 31 columns."""
    return f"""
[time_s]
column = 1
[motor_position_rad]
column = {1 + joint}
[motor_speed_rad_s]
column = {7 + joint}
[motor_torque_nm]
column = {13 + joint}
unit = "A"
factor = {ROBOT_GAINS[joint]}
"""


@dataclass(frozen=True)
class Truth:
    """What is there, what may be said besides, and sizes that were published, to the share they may be off by.

    `wanted`: mechanisms that have to be named; `allowed`: those that are no error; `sizes`: mechanism, parameter and
    value; `silent`: nothing may be said with more than a half, since the record cannot tell;
    `ripple_orders`: from which to which a ripple is there, times per turn of the motor.
    """

    wanted: frozenset[str] = frozenset()
    allowed: frozenset[str] = frozenset()
    sizes: tuple[tuple[str, str, float], ...] = ()
    silent: bool = False
    loosest_gap_rad: float | None = None
    ripple_orders: tuple[float, float] | None = None


@dataclass(frozen=True)
class Drive:
    """One log of one drive."""

    name: str
    log: str
    axis: str
    truth: Truth
    channels: str | None = None
    part: str = field(default="whole")

    def telemetry(self) -> Telemetry:
        whole = read_telemetry(SHARED / "data" / self.log, channels=self.channels)
        return PARTS[self.part](whole)

    def description(self) -> Axis:
        return read_axis(SHARED / "data" / self.axis)


def _rows(t: Telemetry, first: int, end: int, step: int = 1) -> Telemetry:
    rows = slice(first, end, step)
    return replace(
        t,
        time_s=t.time_s[rows] - t.time_s[rows][0],
        channels={name: values[rows] for name, values in t.channels.items()},
        lost={name: values[rows] for name, values in t.lost.items()},
    )


PARTS: Mapping[str, Callable[[Telemetry], Telemetry]] = {
    "whole": lambda t: t,
    "first half": lambda t: _rows(t, 0, t.rows // 2),
    "second half": lambda t: _rows(t, t.rows // 2, t.rows),
    "every second row": lambda t: _rows(t, 0, t.rows, 2),
}

FRICTION = frozenset({"coulomb_friction", "viscous_friction"})
BESIDE = frozenset({"torque_offset", "stribeck_friction"})


def _friction(viscous: float, coulomb: float) -> tuple[tuple[str, str, float], ...]:
    return (
        ("viscous_friction", "coefficient_n_m_s_per_rad", viscous),
        ("coulomb_friction", "torque_n_m", coulomb),
    )


GRAVITY = ("gravity_imbalance", "torque_n_m", 37.0)
# Twice per turn of the wave generator, ratio 101, all three joints have a ripple: what least squares with friction,
# inertia and weight leave of the torque has its largest line at 200 to 202 per turn, in the whole log and either half,
# 7 to 25 times the median of orders 60 to 420.
WAVES = (198.0, 204.0)
ROBOT = {
    1: Truth(FRICTION, BESIDE, _friction(21.26, 12.55), ripple_orders=WAVES),
    3: Truth(FRICTION | {"gravity_imbalance"}, BESIDE, (*_friction(10.38, 4.99), GRAVITY), ripple_orders=WAVES),
    5: Truth(FRICTION, BESIDE, _friction(2.49, 2.69), ripple_orders=WAVES),
}
GEARED = Truth(FRICTION, BESIDE | {"kinematic_error"}, _friction(21.26 / 101**2, 12.55 / 101), ripple_orders=(1.9, 2.1))
SCREWS = {
    1: Truth(
        frozenset({"coulomb_friction"}), FRICTION | BESIDE | {"friction_asymmetry"}, (_friction(3.2e-5, 3e-3)[1],)
    ),
    2: Truth(
        frozenset({"coulomb_friction"}), FRICTION | BESIDE | {"friction_asymmetry"}, (_friction(3e-5, 4.9e-3)[1],)
    ),
}
ONE_WAY = Truth(silent=True, allowed=frozenset({"torque_ripple"}))
ARM = {
    1: Truth(
        FRICTION, BESIDE | {"eccentricity", "mesh_error", "encoder_error"}, _friction(2.57e-4, 0.0449),
        loosest_gap_rad=0.74e-3,
    ),
    2: Truth(FRICTION, BESIDE, _friction(5.4e-4, 0.0280), loosest_gap_rad=3.35e-3),
}  # fmt: skip
ARM_RAW = {
    joint: replace(truth, allowed=truth.allowed | {"gravity_imbalance"}, sizes=()) for joint, truth in ARM.items()
}
COGGING = Truth(
    frozenset({"torque_ripple"}), frozenset({"lost_samples"}), sizes=(("torque_ripple", "torque_n_m", 4.0e-3),)
)
WINCH = Truth(
    frozenset({"torque_offset", "coulomb_friction"}),
    FRICTION | BESIDE | {"lost_samples"},
    (("coulomb_friction", "torque_n_m", 0.047),),
)
ENCODERS = Truth(
    frozenset({"backlash"}), frozenset({"eccentricity", "encoder_error", "mesh_error"}),
    (("backlash", "gap_rad", 10.2e-3),),
)  # fmt: skip
PULLED = Truth(frozenset({"backlash"}), frozenset(), (("backlash", "gap_rad", 22.7e-3),))
SCREW = Truth(FRICTION, BESIDE | {"friction_asymmetry"}, _friction(203.5, 20.39))
SCREW_TURNS = Truth(frozenset({"friction_asymmetry"}), BESIDE)


def drives() -> Iterator[Drive]:
    """Every log, first as it was recorded."""
    for joint, truth in ROBOT.items():
        folder = "drives/ur10e"
        axis = f"{folder}/axis{joint}.toml"
        yield Drive(f"ur10e J{joint} as logged", f"{folder}/joint{joint}_as_logged.csv", axis, truth, robot(joint))
        yield Drive(f"ur10e J{joint}", f"{folder}/joint{joint}.csv", axis, truth)
    yield Drive("ur10e J1 geared", "drives/ur10e/joint1_geared.csv", "drives/ur10e/axis1_geared.toml", GEARED)
    for screw, truth in SCREWS.items():
        folder = f"drives/tro/drive{screw}"
        axis = f"{folder}/axis.toml"
        for name in ("50", "200"):
            yield Drive(f"screw {screw} {name} as logged", f"{folder}/as_logged/{name}.csv", axis, truth, EPOS)
            yield Drive(f"screw {screw} {name}", f"{folder}/start_stop_{name}.csv", axis, truth)
        for name in ("100", "n100"):
            yield Drive(
                f"screw {screw} steady {name} as logged", f"{folder}/as_logged/steady_{name}.csv", axis, ONE_WAY, EPOS
            )
        for name in ("10", "40", "100", "180", "n10", "n40", "n100", "n180"):
            yield Drive(f"screw {screw} steady {name}", f"{folder}/steady_{name}.csv", axis, ONE_WAY)
    for joint in (1, 2):
        folder = f"drives/tum/axis{joint}"
        for axis in ("axis", "axis_rigid"):
            yield Drive(f"arm {joint} {axis}", f"{folder}/telemetry_known.csv", f"{folder}/{axis}.toml", ARM[joint])
            yield Drive(
                f"arm {joint} {axis} raw", f"{folder}/telemetry_raw.csv", f"{folder}/{axis}.toml", ARM_RAW[joint]
            )
            yield Drive(
                f"arm {joint} {axis} no load", f"{folder}/telemetry_raw_noload.csv", f"{folder}/{axis}.toml",
                ARM_RAW[joint],
            )  # fmt: skip
    for name in ("steady_8s", "uneven_15s"):
        yield Drive(f"cogging {name}", f"drives/laas_cogging/{name}.csv", "drives/laas_cogging/axis.toml", COGGING)
    yield Drive("winch", "drives/odrive_winch/up1_1kg_as_logged.csv", "drives/odrive_winch/axis.toml", WINCH, ODRIVE)
    folder = "drives/servoproject"
    yield Drive("servo encoders", f"{folder}/dev_encoders_only.csv", f"{folder}/axis_soft.toml", ENCODERS)
    folder = "drives/robonine"
    yield Drive("servo pulled", f"{folder}/motor_telemetry_single.csv", f"{folder}/axis.toml", PULLED, SERVO)
    yield Drive("screw axis", "emps/telemetry.csv", "emps/axis_inertia_only.toml", SCREW)
    yield Drive("screw axis, friction known", "emps/telemetry.csv", "emps/axis_symmetric_friction.toml", SCREW_TURNS)


def cut(drive: Drive) -> Iterator[Drive]:
    """Records cut out of a log."""
    for part in ("whole", "first half", "second half", "every second row"):
        yield replace(drive, part=part)
