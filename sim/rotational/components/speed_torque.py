"""A torque that follows the speed of its flange."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import number
from sim.rotational.component import Branch, Component, Variables
from sim.rotational.components.torque import UNITS, driving


@dataclass(frozen=True)
class LinearSpeedDependentTorque(Component):
    """Drives its flange with tau = tau_nominal w/w_nominal, or |w|/w_nominal where TorqueDirection is true.

    Parameters
    ----------
    tau_nominal
        Torque [N.m] at w_nominal [rad/s]; negative: brakes forward motion.
    TorqueDirection
        True: the same direction of torque whichever way it turns.
    """

    tau_nominal: float
    w_nominal: float
    TorqueDirection: bool = True

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = UNITS

    def __post_init__(self) -> None:
        number("LinearSpeedDependentTorque.tau_nominal", self.tau_nominal, "N.m")
        number("LinearSpeedDependentTorque.w_nominal", self.w_nominal, "rad/s", above=0)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        w = v.w("flange") - v.w("support")
        tau = self.tau_nominal / self.w_nominal * w
        return (driving(v, tau, (w,)), driving(v, -tau, (-w,))) if self.TorqueDirection else (driving(v, tau),)
