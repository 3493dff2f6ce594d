"""Friction that changes while the axis runs, as the lubricant warms up."""

from dataclasses import replace

from sim.mechanisms.locations import friction_at, with_friction
from sim.mechanisms.mechanism import WARMED, Mechanics, Need, Parameter, Signature, Traits, only
from sim.rotational.drive_train import DriveTrain


class FrictionDrift(Mechanics):
    """All Coulomb and viscous friction times (1 + rate t), at every shaft or at the one of its location.

    Equations: tau = (tau_C sign(w) + d w) (1 + rate t)
    Source: warming joints: Bittencourt and Gunnarsson, J. Dyn. Syst. Meas. Control 134 (2012) 051013
    """

    name = "friction_drift"
    parameters = (Parameter("rate_per_s", "1/s", -0.1, 0.1, -0.005),)
    size = "rate_per_s"
    locations = only(None, "motor", "load")
    shown_by = frozenset({Need.BOTH_DIRECTIONS})
    """One way each place is passed once: what changes with the time changes with the place as well."""
    signature = Signature("time", direction="opposite")
    sentence = "Friction changes by {rate_per_s:.2%} per second during the record, as when the gear warms up."
    action = (
        "Warm the axis up before measuring, and log the temperature; if friction rises when warm, check preload and "
        "the amount of grease."
    )
    check = (
        "Repeat the motion after half an hour of running, with the temperature logged: a change by heat is over "
        "by then, wear is still there."
    )
    traits = Traits(
        own_hypothesis=True,
        least_gain=16.0,
        in_good_order=WARMED,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        for end in (place,) if place else ("motor", "load"):
            old = friction_at(train, end)
            if old.coulomb or old.viscous or old.stribeck:
                train = with_friction(train, end, replace(old, drift=old.drift + self["rate_per_s"]))
        return train
