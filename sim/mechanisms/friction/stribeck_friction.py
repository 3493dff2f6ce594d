"""Friction that falls as a film of lubricant builds up."""

from dataclasses import replace

from sim.mechanisms.locations import ENDS, friction_at, with_friction
from sim.mechanisms.mechanism import Law, Mechanics, Need, Parameter, Signature, Traits, only
from sim.rotational.drive_train import DriveTrain


class StribeckFriction(Mechanics):
    """On top of Coulomb friction at standstill, gone well above its speed; both at the shaft of its location.

    Equations: tau = (tau_C + torque exp(-(|w| / speed)^exponent)) sign(w)
    Source: Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083
    """

    name = "stribeck_friction"
    parameters = (
        Parameter("torque_n_m", "N m", 0.0, 1e4, 0.2),
        Parameter("speed_rad_s", "rad/s", 1e-6, 1e4, 10.0),
        Parameter("exponent", "1", 0.3, 4.0, 2.0),
    )
    size = "torque_n_m"
    locations = only(*ENDS)
    needs = frozenset({Need.SEVERAL_SPEEDS})
    signature = Signature("speed", direction="opposite")
    sentence = (
        "Below about {speed_rad_s:.3g} rad/s of the motor friction rises by {torque_n_m:.3g} N m (Stribeck "
        "friction): the lubricant film breaks down."
    )
    action = (
        "Check lubrication (grade, amount, age) and seals: at low speed the film breaks down. Do it at the next "
        "service. Enter it in the axis description if it was there from the beginning."
    )
    check = (
        "Move at five even speeds from creeping to a third of the largest: with Stribeck friction the torque "
        "falls from speed to speed, with stiction alone it does not."
    )
    traits = Traits(
        own_hypothesis=True,
        least_gain=15.0,
        laws=frozenset({Law.FRICTION, Law.DISSIPATION}),
        over_strokes=True,
        like_noise=True,
    )

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        old = friction_at(train, place)
        changes = {"stribeck_speed": self["speed_rad_s"], "stribeck_exponent": self["exponent"]}
        return with_friction(train, place, replace(old, stribeck=old.stribeck + self["torque_n_m"], **changes))
