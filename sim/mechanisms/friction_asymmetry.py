"""Friction that differs by direction."""

from dataclasses import replace
from typing import ClassVar

from sim.axis import Axis
from sim.drive_train import DriveTrain
from sim.mechanism import Mechanics, Parameter, Signature
from sim.mechanisms.places import axis_of, ends, friction_at, with_friction


class FrictionAsymmetry(Mechanics):
    """Half the difference forward minus backward, of Coulomb and of viscous friction, at the shaft of its location."""

    name: ClassVar[str] = "friction_asymmetry"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("torque_n_m", "N m", -1e4, 1e4, 0.1),
        Parameter("coefficient_n_m_s_per_rad", "N m s/rad", -1e4, 1e4, 0.0),
    )
    size: ClassVar[str] = "torque_n_m"
    signature: ClassVar[Signature] = Signature("speed", direction="one")
    equations: ClassVar[str] = "tau = (tau_C +- torque) sign(w) + (d +- coefficient) w, + forward, - backward"
    source: ClassVar[str] = (
        "EMPS benchmark: Janot, Gautier and Brunot, Workshop on Nonlinear System Identification Benchmarks (2019)"
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return ends(axis)

    def apply(self, train: DriveTrain) -> DriveTrain:
        place = self.placed(axis_of(train))
        old = friction_at(train, place)
        coulomb = old.coulomb if old.coulomb_backward is None else old.coulomb_backward
        viscous = old.viscous if old.viscous_backward is None else old.viscous_backward
        torque, slope = self["torque_n_m"], self["coefficient_n_m_s_per_rad"]
        new = replace(
            old,
            coulomb=old.coulomb + torque,
            coulomb_backward=coulomb - torque,
            viscous=old.viscous + slope,
            viscous_backward=viscous - slope,
        )
        return (
            train
            if new == replace(old, coulomb_backward=coulomb, viscous_backward=viscous)
            else with_friction(train, place, new)
        )
