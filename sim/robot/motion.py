"""One log of a robot made ready: all joints over one even clock, smoothed alike, with speeds and accelerations."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from signals.columns.joint_maps import read_joint_maps
from signals.errors import TelemetryError
from signals.telemetry import Telemetry, read_telemetry
from sim.investigation.data.data_fault import InvestigationError
from sim.investigation.data.preprocessing import LEAST_ROWS, MOTION_CUT_HZ, gaussian_kernel, smooth
from sim.investigation.data.validation import check_clock
from sim.robot.robot import Robot, logged_joints

Array = NDArray[np.float64]

ROWS_PER_CUT = 4.0  # rows per period of the cut-off frequency: what is faster is below 1 %
HELD_RAD, HELD_M = 1e-3, 1e-5  # less is the twist of a gear that friction holds: the joint does not slide
OUTSIDE = 1.05  # of a joint's range in the URDF: soft limits and zeros are set by hand


@dataclass(frozen=True)
class Motion:
    """Positions, speeds, accelerations and torques of the logged joints, each of shape (rows, joints), in the joints'
    own coordinates [rad], [rad/s], [rad/s2], [N m]; `time_s` on the log's clock, shape (rows,).

    `counts`: rows that rest on measured values of all joints alone, shape (rows,): what one joint asks for depends on
    how all of them move. `moves`: joints that do, shape (joints,). `cut_hz`: all is smoothed up to that frequency.
    `unmeasured`: places of joints whose torque says nothing, and is 0.
    """

    time_s: Array
    rate_hz: float
    position: Array
    speed: Array
    acceleration: Array
    torque: Array
    counts: NDArray[np.bool_]
    moves: NDArray[np.bool_]
    cut_hz: float = math.inf
    unmeasured: frozenset[int] = frozenset()

    @staticmethod
    def of(robot: Robot, log: Sequence[Telemetry]) -> Motion:
        """`log`: of each joint, over one clock.

        Raises
        ------
        InvestigationError
            for a log without any torque, a joint without position, positions far outside the joint's range, a robot
            that stands still, and too little that counts.
        """
        clock = log[0]
        rate = check_clock(clock)
        if not any("motor_torque_nm" in telemetry for telemetry in log):
            raise InvestigationError("needs motor_torque_nm; a robot is investigated by the torques of its joints")
        grid = clock.time_s[0] + np.arange(int(clock.duration_s * rate) + 1) / rate
        cut = min(MOTION_CUT_HZ, 0.1 * rate)
        stride = max(1, int(rate / (ROWS_PER_CUT * cut)))
        out: list[list[Array]] = []
        for joint, telemetry in zip(robot.joints, log, strict=True):
            position = _position(joint.name, telemetry, joint.axis.ratio)
            torque = telemetry.channels.get("motor_torque_nm", np.zeros(telemetry.rows))
            _check_range(robot, joint.name, position)
            even = np.interp(grid, telemetry.time_s, position)
            ways = [smoothed(even, cut, rate, order)[::stride] for order in range(3)]
            felt = smoothed(np.interp(grid, telemetry.time_s, torque * joint.axis.ratio), cut, rate, 0)[::stride]
            out.append([*ways, felt])
        position, speed, acceleration, torque = (np.stack(each, axis=1) for each in zip(*out, strict=True))
        counts = _measured(log, grid, stride / rate, gaussian_kernel(cut, rate, 0).size)[::stride]
        if counts.sum() < LEAST_ROWS:
            least = LEAST_ROWS * stride / rate + gaussian_kernel(cut, rate, 0).size / rate
            raise InvestigationError(
                f"telemetry: {counts.sum() * stride / rate:.2g} s count, away from its ends and from lost rows; at "
                f"{rate:.4g} rows per second {least:.2g} s are needed in which all joints are measured"
            )
        held = [HELD_M if joint.name in robot.urdf.prismatic else HELD_RAD for joint in robot.joints]
        moves = np.ptp(position[counts], axis=0) > np.array(held)
        if not moves.any():
            raise InvestigationError("motor_position_rad: no joint moves; a log of the robot in motion is needed")
        dead = [k for k, one in enumerate(log) if not np.ptp(one.channels.get("motor_torque_nm", np.zeros(1)))]
        motion = Motion(grid[::stride], rate / stride, position, speed, acceleration, torque, counts, moves, cut)
        return motion.without_torque(frozenset(dead))

    def at(self, rows: NDArray[np.int64]) -> Motion:
        """These rows alone."""
        names = ("time_s", "position", "speed", "acceleration", "torque", "counts")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def with_earlier_torque(self, joint: int, by_s: float) -> Motion:
        """The same with the torque of one joint so much earlier."""
        torque = self.torque.copy()
        torque[:, joint] = np.interp(self.time_s + by_s, self.time_s, torque[:, joint])
        return replace(self, torque=torque)

    def without_torque(self, joints: frozenset[int]) -> Motion:
        """The same where the torques of these joints say nothing, either."""
        torque = self.torque.copy()
        torque[:, list(joints)] = 0.0
        return replace(self, torque=torque, unmeasured=self.unmeasured | joints)

    def on(self, values: Array, time_s: Array) -> Array:
        """`values` along the rows, at other times, by cubic splines; shape (len(time_s), ...)."""
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(self.time_s, values)(np.clip(time_s, self.time_s[0], self.time_s[-1])))


def _measured(log: Sequence[Telemetry], grid: Array, short_s: float, kernel: int) -> NDArray[np.bool_]:
    """Rows of the grid whose kernel of so many rows meets neither an end of the log nor a gap longer than `short_s`."""
    from scipy.ndimage import minimum_filter1d

    out = np.ones(grid.size, dtype=np.bool_)
    for telemetry in log:
        there = ~np.any([np.zeros(telemetry.rows, dtype=np.bool_), *telemetry.lost.values()], axis=0)
        times = telemetry.time_s[there]
        after = np.clip(np.searchsorted(times, grid - 1e-9), 1, times.size - 1)
        out &= (times[after] - times[after - 1] <= 1.5 * short_s) & (grid > times[0] - 1e-9) & (grid < times[-1] + 1e-9)
    return np.asarray(minimum_filter1d(out, kernel, mode="constant", cval=0), dtype=np.bool_)


def _position(name: str, telemetry: Telemetry, ratio: float) -> Array:
    """Of the joint [rad], shape (rows,)."""
    if "load_position_rad" in telemetry:
        return telemetry["load_position_rad"]
    if "motor_position_rad" not in telemetry:
        raise InvestigationError(
            f"{name}: needs motor_position_rad (or load_position_rad): gravity depends on where the joints are"
        )
    return np.asarray(telemetry["motor_position_rad"] / ratio)


def _check_range(robot: Robot, name: str, position: Array) -> None:
    low, high, _ = robot.urdf.limits.get(name, (0.0, 0.0, 0.0))
    reach = OUTSIDE * max(abs(low), abs(high))
    seen = float(np.abs(position).max())
    if low >= high or seen <= reach:
        return
    unit = "m" if name in robot.urdf.prismatic else "rad"
    degrees = unit == "rad" and seen <= np.degrees(reach)
    hint = 'if it is in degrees, write unit = "deg" in the map' if degrees else "is the column right, and its unit?"
    raise InvestigationError(
        f"{name}: the position reaches {seen:.4g} {unit}; in the URDF the joint moves from {low:.4g} to {high:.4g} "
        f"{unit}; {hint}"
    )


def smoothed(values: Array, cut_hz: float, rate_hz: float, derivative: int) -> Array:
    """Smoothed over all rows; those at the ends, by odd reflection, do not count."""
    half = gaussian_kernel(cut_hz, rate_hz, derivative).size // 2
    return smooth(np.pad(values, half, "reflect", reflect_type="odd"), cut_hz, rate_hz, derivative, half)


@dataclass(frozen=True)
class RobotLog:
    """One log of a robot: telemetry of each joint, in the joints' order, over one clock.

    `recognised`: the channel map that reading it amounted to, where the columns were recognised; else empty.
    `unusable`: why the torque of a joint could not be read, by its name.
    """

    name: str
    joints: tuple[Telemetry, ...]
    recognised: str = ""
    unusable: Mapping[str, str] = field(default_factory=dict)


TORQUE = "motor_torque_nm"


def read_log(robot: Robot, path: Path, channels: str | None) -> RobotLog:
    """Read each joint's telemetry; a joint whose torque alone cannot be read goes without.

    Raises
    ------
    TelemetryError
        as `read_telemetry`, beginning with the joint; and where the columns of the joints are in doubt.
    """
    maps, recognised = read_joint_maps(path, logged_joints(robot), channels)
    read = [_read(path, joint.name, map_) for joint, map_ in zip(robot.joints, maps, strict=True)]
    return RobotLog(
        path.name, tuple(telemetry for telemetry, _ in read), recognised,
        {joint.name: why for joint, (_, why) in zip(robot.joints, read, strict=True) if why},
    )  # fmt: skip


def _read(path: Path, joint: str, channels: str | None) -> tuple[Telemetry, str]:
    """A joint's telemetry; without its torque where that cannot be read, and why: it still moves the others."""
    try:
        return read_telemetry(path, channels=channels), ""
    except TelemetryError as error:
        rest = {} if channels is None else {k: v for k, v in json.loads(channels).items() if k != TORQUE}
        try:
            return read_telemetry(path, channels=json.dumps(rest)), str(error)
        except TelemetryError:
            raise TelemetryError(f"{joint}: {error}") from None
