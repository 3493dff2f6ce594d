"""ElastoBacklash: spring and damper behind a gap; the play of a gear."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from sim.errors import ParameterError
from sim.laws import APART, BOTH, ELASTO, ELASTO2, LIMITED, LINEAR, contact
from sim.rotational.component import CONTACT_NAMES, Branch, Range, Row, Variables
from sim.rotational.components.compliant import Compliant, SpringDamper

Law = Literal["linear", "elasto", "elasto2"]
CONTACT_LAWS: Mapping[str, float] = {"linear": LINEAR, "elasto": ELASTO, "elasto2": ELASTO2}
NO_GAP = 1e-10
"""Total backlash [rad] up to which it is a plain spring-damper (Modelica's bEps)."""


@dataclass(frozen=True)
class ElastoBacklash(Compliant):
    """Torque only beyond half the total backlash b on either side of phi_rel0.

    Beyond the gap tau_c = c (phi_rel - phi_rel0 -+ b/2) and tau_d = d w_rel; within it there is none.

    Parameters
    ----------
    c
        Stiffness in contact [N.m/rad].
    b
        Total backlash [rad].
    d
        Damping in contact [N.m.s/rad].
    phi_rel0
        Middle of the gap [rad].
    law
        How the damper acts in contact: `elasto` (Modelica 3.0 and later): it never pulls and never exceeds the
        spring, so that the torque is continuous; `elasto2` (ElastoBacklash2): it never pulls; `linear`
        (Modelica 2.2, Gear2): always, so that contact may pull.
    """

    c: float
    b: float = 0.0
    d: float = 0.0
    phi_rel0: float = 0.0
    law: Law = "elasto"

    ranges: ClassVar[Mapping[str, Range]] = {**SpringDamper.ranges, "b": Range("rad", at_least=0)}
    mode_names: ClassVar[Mapping[int, str]] = CONTACT_NAMES

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law not in CONTACT_LAWS:
            raise ParameterError(f"ElastoBacklash.law: must be {', '.join(CONTACT_LAWS)}, got {self.law!r}")

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        diff = v.phi_rel - self.phi_rel0 * v.one
        tau_d = self.d * v.w_rel
        if self.b <= NO_GAP:
            return (self.piece(v, self.c * diff + tau_d, tau_d),)
        half = 0.5 * self.b * v.one
        gap = self.piece(v, 0 * v.one, 0 * v.one, (half - diff, half + diff), 0)
        return (gap, *self._flank(v, diff - half, tau_d, 1), *self._flank(v, diff + half, tau_d, -1))

    def _flank(self, v: Variables, beyond: Row, tau_d: Row, side: int) -> tuple[Branch, ...]:
        """Branches of contact on one side; `beyond` is the way into it, signed as the torque."""
        tau_c = self.c * beyond

        def piece(number: int, *holds: Row) -> Branch:
            by_spring, by_damper = (contact(CONTACT_LAWS[self.law], *unit, number) for unit in ((1.0, 0.0), (0.0, 1.0)))
            tau = by_spring * tau_c + by_damper * tau_d
            return self.piece(v, tau, tau - tau_c if number != APART else 0 * v.one, holds, side)

        if self.law == "linear" or self.d == 0:
            return (piece(BOTH, side * beyond),)
        released = piece(APART, side * beyond, -side * (tau_c + tau_d))
        if self.law == "elasto2":
            return (piece(BOTH, side * tau_c, side * (tau_c + tau_d)), released)
        pressed = piece(BOTH, side * (tau_c + tau_d), side * (tau_c - tau_d))
        return (pressed, piece(LIMITED, side * beyond, side * (tau_d - tau_c)), released)


@dataclass(frozen=True)
class ElastoBacklash2(ElastoBacklash):
    """`ElastoBacklash` with the law of Modelica's component of this name."""

    law: Law = "elasto2"
