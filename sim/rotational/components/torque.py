"""Torque sources that a signal drives, or that are constant."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.errors import ParameterError, number
from sim.rotational.component import Branch, Component, Row, Signal, Variables
from sim.rotational.components.signals import Step

UNITS: Mapping[str, str] = {"tau": "N.m", "phi": "rad", "w": "rad/s"}


def driving(v: Variables, tau: Row, holds: tuple[Row, ...] = ()) -> Branch:
    """Return the branch of a source that drives its flange with `tau` against its support."""
    return Branch(
        torques={"flange": -tau, "support": tau},
        holds=holds,
        channels={
            "tau": tau,
            "phi": v.phi("flange") - v.phi("support"),
            "w": v.w("flange") - v.w("support"),
        },
    )


def is_signal(name: str, value: object) -> None:
    if not isinstance(value, Signal):
        raise ParameterError(f"{name}: must be a signal such as Sine or Sampled, got {value!r}")


@dataclass(frozen=True)
class Torque(Component):
    """Drives its flange with the signal's torque [N.m], against its support."""

    tau: Signal

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = UNITS

    def __post_init__(self) -> None:
        is_signal("Torque.tau", self.tau)

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.tau,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (driving(v, v.signal(0)),)


@dataclass(frozen=True)
class Torque2(Component):
    """Drives flange_b with the signal's torque [N.m], against flange_a."""

    tau: Signal

    units: ClassVar[Mapping[str, str]] = {"tau": "N.m"}

    def __post_init__(self) -> None:
        is_signal("Torque2.tau", self.tau)

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.tau,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = v.signal(0)
        return (Branch(torques={"flange_a": tau, "flange_b": -tau}, channels={"tau": tau}),)


@dataclass(frozen=True)
class ConstantTorque(Component):
    """Drives its flange with tau_constant [N.m]."""

    tau_constant: float

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = UNITS

    def __post_init__(self) -> None:
        number("ConstantTorque.tau_constant", self.tau_constant, "N.m")

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (driving(v, self.tau_constant * v.one),)


@dataclass(frozen=True)
class TorqueStep(Component):
    """Drives its flange with offsetTorque, from startTime on with stepTorque more [N.m]."""

    stepTorque: float
    offsetTorque: float = 0.0
    startTime: float = 0.0

    flanges: ClassVar[tuple[str, ...]] = ("flange", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    units: ClassVar[Mapping[str, str]] = UNITS

    def __post_init__(self) -> None:
        for name, unit in (("stepTorque", "N.m"), ("offsetTorque", "N.m"), ("startTime", "s")):
            number(f"TorqueStep.{name}", getattr(self, name), unit)

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (Step(self.stepTorque, self.offsetTorque, self.startTime),)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (driving(v, v.signal(0)),)
