"""Whether channels hold what their names say: units, signs, turns that were cut off, places that were swapped."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.data.data_fault import InvestigationError
from sim.investigation.data.sample_defects import quantum

NAMES = {
    "torque": "motor_torque_nm",
    "angle": "motor_position_rad",
    "load": "load_position_rad",
    "reference": "reference_position_rad",
}
TURNS = {2.0 * math.pi: "2 pi", 360.0: "360"}
UNITS = {1e3: "mrad", 180.0 / math.pi: "degrees", 1e6: "microrad", 1.0 / (2.0 * math.pi): "turns"}
ALIKE = 0.05


def check_channels(axis: Axis, even: Mapping[str, Array]) -> None:
    """Refuse channels that stand still, are wrapped, swapped, turned or in another unit.

    `even`: channels by their short names, each of shape (n,); `reference` may be of the motor or of the load. Without
    `torque` the two encoders are held against each other alone.

    Raises
    ------
    InvestigationError
        naming the channel, what it does and what would be right.
    """
    angle = even["angle"]
    if float(np.ptp(angle)) < 20.0 * quantum(angle) or np.ptp(angle) == 0.0:
        raise InvestigationError("motor_position_rad: the motor stands still; a record of the axis in motion is needed")
    for name in ("angle", "load", "reference"):
        if name in even:
            _check_wrapped(NAMES[name], even[name])
    if "torque" in even and np.ptp(even["torque"]) == 0.0:
        raise InvestigationError(
            f"motor_torque_nm: stays at {even['torque'][0]:.4g} N m in every row: the drive was off, or it is the "
            "torque of an axis that did not move; name the columns of the one that moved"
        )
    if "torque" in even:
        _check_swapped(axis, even)
    if "load" in even:
        _check_load(axis, even)


def _check_wrapped(name: str, values: Array) -> None:
    for turn, word in TURNS.items():
        steps = np.abs(np.diff(values))
        cut = steps > 0.9 * turn
        cuts = int(cut.sum())
        if cuts == cut.size:
            continue  # an angle that jumps by a turn in every row is in another unit, not cut off
        # a dropout to zero neither lands where the motion goes on, nor moves there
        moves = np.array([steps[i + 1 : i + 4].any() and steps[max(i - 3, 0) : i].any() for i in np.flatnonzero(cut)])
        goes_on = moves.astype(np.bool_) & (np.abs(steps[cut] - turn) < 3.0 * float(np.quantile(steps[~cut], 0.99)))
        if cuts and goes_on.sum() > 0.5 * cuts and 0.9 * turn < np.ptp(values) < 1.001 * turn:
            raise InvestigationError(
                f"{name}: jumps by {word} {cuts} times and never leaves one turn: the angle is wrapped; unwrap it, so "
                "that it goes on over whole turns" + ("" if turn < 10.0 else ", and give it in rad")
            )


def _check_swapped(axis: Axis, even: Mapping[str, Array]) -> None:
    """Whether the torque is a position, told by the other positions."""
    torque, angle = even["torque"], even["angle"]
    if _follows(angle, torque, 1.0) or ("load" in even and _follows(even["load"] * axis.ratio, torque, 1.0)):
        place = "motor_position_rad"
        if _follows(angle, torque, 1.0):
            place = "reference_position_rad" if "reference" in even else "another position"
        raise InvestigationError(
            f"motor_torque_nm: moves as a position of the motor does: it is swapped with {place}; "
            "give each its own name"
        )
    if "reference" in even and not _follows(even["reference"], angle, 1.0) and _follows(even["reference"], torque, 1.0):
        raise InvestigationError(
            "motor_torque_nm: follows reference_position_rad, and motor_position_rad does not: the two are swapped; "
            "give each its own name"
        )


def _check_load(axis: Axis, even: Mapping[str, Array]) -> None:
    angle, load = even["angle"], even["load"]
    times = slope(angle, load) * axis.ratio
    if not math.isfinite(times) or np.ptp(load) == 0.0:
        raise InvestigationError("load_position_rad: the load encoder does not move while the motor does")
    if abs(times - 1.0) < ALIKE:
        return
    if abs(times + 1.0) < ALIKE:
        raise InvestigationError(
            "load_position_rad: runs against the motor: the load encoder counts the other way round; turn its sign"
        )
    if axis.ratio != 1.0 and abs(times / axis.ratio**2 - 1.0) < ALIKE:
        raise InvestigationError(
            "motor_position_rad and load_position_rad are swapped: the load's moves "
            f"{times / axis.ratio:.4g} times as far as the motor's, and the ratio is {axis.ratio:.6g}"
        )
    for factor, unit in UNITS.items():
        for size, large, small in (
            (abs(times), "load_position_rad", "motor_position_rad"),
            (1.0 / max(abs(times), 1e-300), "motor_position_rad", "load_position_rad"),
        ):
            if abs(size / factor - 1.0) < ALIKE:
                raise InvestigationError(
                    f"load_position_rad moves {abs(times):.4g} times as far as motor_position_rad over the ratio says: "
                    f"{large} is in {unit}, or {small} is too small by {factor:.4g}, or the ratio {axis.ratio:.6g} is "
                    "another; rad are needed"
                )
    raise InvestigationError(
        f"load_position_rad: moves {times:.4g} times as far as motor_position_rad over the ratio {axis.ratio:.6g} "
        "says; are two channels swapped, is a unit not rad, or is the ratio another?"
    )


def slope(angle: Array, other: Array) -> float:
    """Change of `other` over that of `angle`, the median over where the motor is fast: some rows may be of no use."""
    lag = max(1, angle.size // 1000)
    turned, moved = angle[lag:] - angle[:-lag], other[lag:] - other[:-lag]
    fast = np.abs(turned) > 0.3 * float(np.quantile(np.abs(turned), 0.95))
    return float(np.median(moved[fast] / turned[fast])) if fast.any() else math.nan


def _follows(angle: Array, other: Array, times: float) -> bool:
    """Whether `other` moves as `angle` does, `times` as far."""
    if np.ptp(angle) == 0.0 or np.ptp(other) == 0.0:
        return False
    thin = max(1, angle.size // 5000)
    alike = float(np.corrcoef(angle[::thin], other[::thin])[0, 1])
    return alike > 0.99 and abs(slope(angle, other) / times - 1.0) < ALIKE
