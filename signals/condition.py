"""How a recording was taken, as far as it is known."""

import itertools
import math
from dataclasses import dataclass

from signals.errors import ConditionError
from signals.motion_profile import MotionProfile


@dataclass(frozen=True)
class OperatingCondition:
    """What is known of the motion and the axis; every field may be absent.

    Args:
        speed_rad_s: largest speed of the output (load side) during the motion [rad/s].
        payload_kg_m2: inertia of what the output carries [kg m2].
        motion_period_s: time of one full cycle of back and forth [s].
        reversal_times_s: times of standstill, from the start of the recording, ascending [s].
        steady: True for a shaft that turns at constant speed, False for back and forth, None if unknown.
        shaft_orders: turns of each shaft per turn of the output, motor first [1].
        mesh_orders: tooth engagements of each mesh per turn of the output, motor side first [1].
        motion: the whole course of back and forth.

    Raises:
        ConditionError: if a value is not finite or has an impossible sign.
    """

    speed_rad_s: float | None = None
    payload_kg_m2: float | None = None
    motion_period_s: float | None = None
    reversal_times_s: tuple[float, ...] = ()
    steady: bool | None = None
    shaft_orders: tuple[float, ...] = ()
    mesh_orders: tuple[float, ...] = ()
    motion: MotionProfile | None = None

    def __post_init__(self) -> None:
        positive = {
            "speed_rad_s": self.speed_rad_s,
            "payload_kg_m2": self.payload_kg_m2,
            "motion_period_s": self.motion_period_s,
        }
        for name, value in positive.items():
            if value is not None and not (math.isfinite(value) and value > 0):
                raise ConditionError(f"{name} must be a positive number, got {value}")
        for name, orders in (("shaft_orders", self.shaft_orders), ("mesh_orders", self.mesh_orders)):
            if not all(math.isfinite(order) and order > 0 for order in orders):
                raise ConditionError(f"{name} must be positive numbers, got {orders}")
        times = self.reversal_times_s
        ascending = all(a < b for a, b in itertools.pairwise(times))
        if not ascending or not all(math.isfinite(t) for t in times):
            raise ConditionError(f"reversal_times_s must be finite and ascending, got {times}")


UNKNOWN = OperatingCondition()
