"""The motion that an axis is driven along, back and forth over one stroke: given with a recording, or measured."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from signals.errors import ConditionError

Floats = NDArray[np.float64]
Kind = Literal["trapezoid", "s_curve", "sine"]


@dataclass(frozen=True)
class MotionProfile:
    """Back and forth between two positions, each way alike.

    Args:
        kind: course of the speed: trapezoid; s_curve, whose acceleration rises and falls linearly; sine: half a wave.
        stroke_rad: from one end to the other, at the output [rad].
        load_speed_rad_s: largest speed of the output [rad/s].
        acceleration_time_s: from standstill to the largest speed [s]; a sine has none.
        dwell_s: rest at each end [s].

    Raises:
        ConditionError: if something is missing, or no axis can move so.
    """

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    kind: Kind
    stroke_rad: float
    load_speed_rad_s: float
    acceleration_time_s: float | None = None
    dwell_s: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, float) and not (1e-9 if name != "dwell_s" else 0) <= value <= 1e9:
                raise ConditionError(f"{name} must be a number above 0, got {value}")
        ramp, top = self.acceleration_time_s, self.load_speed_rad_s
        if self.kind != "sine":
            if ramp is None:
                raise ConditionError(f"acceleration_time_s is missing: a motion of kind {self.kind} needs it")
            if top * ramp > self.stroke_rad * (1 + 1e-9):
                raise ConditionError(
                    f"stroke_rad of {self.stroke_rad:.4g} is too short for {top:.4g} rad/s in {ramp:.4g} s: "
                    f"speeding up and braking take {top * ramp:.4g} rad"
                )
        if not 0.05 <= self.period_s <= 600:
            raise ConditionError(
                f"one cycle of this motion takes {self.period_s:.4g} s, which is not between 0.05 and 600 s"
            )

    @property
    def moving_s(self) -> float:
        """Time from one end to the other [s]."""
        if self.kind == "sine":
            return math.pi / 2 * self.stroke_rad / self.load_speed_rad_s
        return self.stroke_rad / self.load_speed_rad_s + (self.acceleration_time_s or 0.0)

    @property
    def period_s(self) -> float:
        """One full cycle of back and forth [s]."""
        return 2 * (self.moving_s + self.dwell_s)

    def condition(self) -> Mapping[str, Any]:
        """Return what an operating condition has of it."""
        condition = {"speed_rad_s": self.load_speed_rad_s, "motion_period_s": self.period_s, "steady": False}
        return {**condition, "motion": self}

    def speeds(self, time_s: Floats) -> Floats:
        """Return the speed of the output, so long after it has left one end for the other, shape (n,) [rad/s]."""
        ramp = self.moving_s / 2 if self.acceleration_time_s is None else self.acceleration_time_s
        return self.load_speed_rad_s * _share(self.kind, time_s, self.moving_s, ramp)


def _share(kind: Kind, time_s: Floats, moving_s: float, ramp_s: float) -> Floats:
    """Return the speed over its largest, shape (n,) [1]."""
    if kind == "sine":
        wave: Floats = np.sin(np.pi * np.clip(time_s / moving_s, 0, 1))
        return wave
    rise: Floats = np.clip(np.minimum(time_s, moving_s - time_s) / ramp_s, 0, 1)
    return rise if kind == "trapezoid" else np.where(rise < 0.5, 2 * rise**2, 1 - 2 * (1 - rise) ** 2)
