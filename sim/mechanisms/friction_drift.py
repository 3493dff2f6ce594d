"""Friction that changes while the axis runs, as the lubricant warms up."""

from dataclasses import replace
from typing import ClassVar

from sim.description.axis import Axis
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature
from sim.mechanisms.places import friction_at, with_friction
from sim.mechanisms.traits import WARMED, Traits
from sim.rotational.drive_train import DriveTrain


class FrictionDrift(Mechanics):
    """All Coulomb and viscous friction times (1 + rate t), at every shaft or at the one of its location."""

    name: ClassVar[str] = "friction_drift"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("rate_per_s", "1/s", -0.1, 0.1, -0.005),)
    size: ClassVar[str] = "rate_per_s"
    shown_by: ClassVar[frozenset[Need]] = frozenset({Need.BOTH_DIRECTIONS})
    """One way each place is passed once: what changes with the time changes with the place as well."""
    signature: ClassVar[Signature] = Signature("time", direction="opposite", grows_with="time")
    equations: ClassVar[str] = "tau = (tau_C sign(w) + d w) (1 + rate t)"
    source: ClassVar[str] = "warming joints: Bittencourt and Gunnarsson, J. Dyn. Syst. Meas. Control 134 (2012) 051013"
    sentence: ClassVar[str] = (
        "Friction changes by {rate_per_s:.2%} per second during the record, as when the gear warms up."
    )
    action: ClassVar[str] = (
        "Warm the axis up before measuring, and log the temperature; if friction rises when warm, check preload and "
        "the amount of grease."
    )
    check: ClassVar[str] = (
        "Repeat the motion after half an hour of running, with the temperature logged: a change by heat is over "
        "by then, wear is still there."
    )
    own_hypothesis: ClassVar[bool] = True
    traits: ClassVar[Traits] = Traits(
        least_gain=16.0,
        in_good_order=WARMED,
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return (None, "motor", "load")

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        for end in (place,) if place else ("motor", "load"):
            old = friction_at(train, end)
            if old.coulomb or old.viscous or old.stribeck:
                train = with_friction(train, end, replace(old, drift=old.drift + self["rate_per_s"]))
        return train
