"""Friction that falls as a film of lubricant builds up."""

from dataclasses import replace
from typing import ClassVar

from sim.description.axis import Axis
from sim.mechanisms.mechanism import Mechanics, Need, Parameter, Signature
from sim.mechanisms.places import ends, friction_at, with_friction
from sim.mechanisms.traits import Law, Traits
from sim.rotational.drive_train import DriveTrain


class StribeckFriction(Mechanics):
    """On top of Coulomb friction at standstill, gone well above its speed; both at the shaft of its location."""

    name: ClassVar[str] = "stribeck_friction"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("torque_n_m", "N m", 0.0, 1e4, 0.2),
        Parameter("speed_rad_s", "rad/s", 1e-6, 1e4, 10.0),
        Parameter("exponent", "1", 0.3, 4.0, 2.0),
    )
    size: ClassVar[str] = "torque_n_m"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.SEVERAL_SPEEDS})
    signature: ClassVar[Signature] = Signature("speed", direction="opposite")
    equations: ClassVar[str] = "tau = (tau_C + torque exp(-(|w| / speed)^exponent)) sign(w)"
    source: ClassVar[str] = "Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083"
    sentence: ClassVar[str] = (
        "Below about {speed_rad_s:.3g} rad/s of the motor friction rises by {torque_n_m:.3g} N m (Stribeck "
        "friction): the lubricant film breaks down."
    )
    action: ClassVar[str] = (
        "Check lubrication (grade, amount, age) and seals: at low speed the film breaks down. Do it at the next "
        "service. Enter it in the axis description if it was there from the beginning."
    )
    check: ClassVar[str] = (
        "Move at five even speeds from creeping to a third of the largest: with Stribeck friction the torque "
        "falls from speed to speed, with stiction alone it does not."
    )
    own_hypothesis: ClassVar[bool] = True
    traits: ClassVar[Traits] = Traits(
        least_gain=15.0,
        laws=frozenset({Law.FRICTION, Law.DISSIPATION}),
        over_strokes=True,
        like_noise=True,
    )

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return ends(axis)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        old = friction_at(train, place)
        changes = {"stribeck_speed": self["speed_rad_s"], "stribeck_exponent": self["exponent"]}
        return with_friction(train, place, replace(old, stribeck=old.stribeck + self["torque_n_m"], **changes))
