"""Torque sources: driven by a signal, constant, or over the speed of their flange."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import Branch, Component, Range, Row, Signal, Variables
from sim.rotational.components.signals import Step


class Source(Component):
    """A torque [N.m] on a flange, against its support; of a signal, unless a subclass says else."""

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)

    def driving(self, v: Variables, tau: Row, holds: tuple[Row, ...] = ()) -> Branch:
        """Return the branch that drives the flange with `tau`."""
        phi, w, _ = v.motion("flange")
        return Branch({"flange": -tau, "support": tau}, holds=holds, channels={"tau": tau, "phi": phi, "w": w})

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (self.driving(v, v.signal(0)),)


@dataclass(frozen=True)
class Torque(Source):
    """Drives its flange with the signal's torque [N.m], against its support."""

    tau: Signal


@dataclass(frozen=True)
class Torque2(Component):
    """Drives flange_b with the signal's torque [N.m], against flange_a."""

    tau: Signal

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = v.signal(0)
        return (Branch(torques={"flange_a": tau, "flange_b": -tau}, channels={"tau": tau}),)


@dataclass(frozen=True)
class ConstantTorque(Source):
    """Drives its flange with tau_constant [N.m]."""

    tau_constant: float

    ranges: ClassVar[Mapping[str, Range]] = {"tau_constant": Range("N.m")}

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (self.driving(v, self.tau_constant * v.one),)


@dataclass(frozen=True)
class TorqueStep(Source):
    """Drives its flange with offsetTorque, from startTime on with stepTorque more [N.m]."""

    stepTorque: float
    offsetTorque: float = 0.0
    startTime: float = 0.0

    ranges: ClassVar[Mapping[str, Range]] = {
        "stepTorque": Range("N.m"), "offsetTorque": Range("N.m"), "startTime": Range("s")
    }  # fmt: skip

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (Step(self.stepTorque, self.offsetTorque, self.startTime),)


@dataclass(frozen=True)
class LinearSpeedDependentTorque(Source):
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

    ranges: ClassVar[Mapping[str, Range]] = {"tau_nominal": Range("N.m"), "w_nominal": Range("rad/s", above=0)}

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        w = v.motion("flange")[1]
        tau = self.tau_nominal / self.w_nominal * w
        return (
            (self.driving(v, tau, (w,)), self.driving(v, -tau, (-w,)))
            if self.TorqueDirection
            else (self.driving(v, tau),)
        )
