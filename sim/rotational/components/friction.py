"""Coulomb friction: stuck, sliding forward or backward, and free when nothing presses (Modelica's PartialFriction).

BearingFriction and Brake are that of a shaft against its support, Clutch and OneWayClutch that between two shafts.
"""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple

from sim.errors import ParameterError
from sim.laws import friction
from sim.rotational.component import (
    BACKWARD,
    FORWARD,
    FREE,
    STUCK,
    Branch,
    Component,
    Range,
    Row,
    Signal,
    Variables,
    WithStarts,
)
from sim.rotational.components.signals import Constant
from sim.rotational.components.tables import SpeedTable, speed_table

ALWAYS = Constant(1.0)
RELATIVE_HYSTERESIS = 1e-4
"""Modelica's eps0 of OneWayClutch: least relative difference of the torques at rest and at the onset of sliding."""


class Sliding(NamedTuple):
    """A piece of the torque of sliding friction, and the rows that are >= 0 while the speed lies on it."""

    torque: Row
    holds: tuple[Row, ...]


class Friction(Component):
    """What all friction shares; `peak`: torque that breaks away over torque at the onset of sliding, >= 1."""

    peak: float

    ranges: ClassVar[Mapping[str, Range]] = {"peak": Range(at_least=1)}

    @abstractmethod
    def sliding(self, v: Variables, speed: Row) -> list[Sliding]:
        """Return the pieces of the sliding torque at the row |w|."""

    def pressing(self, v: Variables) -> Row | None:
        """Return the normal force times geometry [N.m] that a signal sets; None where friction is always there."""
        return None

    def more_channels(self, v: Variables) -> Mapping[str, Row]:
        """Return channels that only this kind has."""
        return {}

    def pieces(self, v: Variables, tau: Row, speed: Row, acceleration: Row) -> tuple[Branch, ...]:
        """Return the branches of a friction torque `tau` against `speed`, without its torques at the flanges.

        Stuck, the torque may reach `peak` times the sliding one at standstill. Stuck stands before sliding: where both
        are possible, a shaft that came to rest stays at rest.
        """
        limit, pressing = self.peak * self.sliding(v, 0 * v.one)[0].torque, self.pressing(v)
        pressed = () if pressing is None else (pressing,)
        free = () if pressing is None else (Branch({}, (tau,), (-pressing,), mode=FREE),)
        stuck = Branch({}, (acceleration,), (limit - tau, limit + tau), pressed, (speed,), STUCK)
        sliding = [
            Branch({}, (tau - way * one.torque,), one.holds, (way * speed, *pressed), mode=way)
            for way in (FORWARD, BACKWARD)
            for one in self.sliding(v, way * speed)
        ]
        return (*free, stuck, *sliding)


def sliding_torques(table: SpeedTable, v: Variables, speed: Row, factor: Row, gain: float = 1.0) -> list[Sliding]:
    """Return the pieces of the first column at the row |w|, times `factor`; what rises with the speed times `gain`."""
    out = []
    for line in table.lines:
        level, slope = float(line.levels[0]), float(line.slopes[0])
        at_rest, at_one = (friction(level, level, slope, slope, 0.0, 1.0, 2.0, 0.0, w, 1.0, 0.0) for w in (0.0, 1.0))
        out.append(Sliding(at_rest * factor + (at_one - at_rest) * gain * speed, line.holds(v, speed)))
    return out


class SupportFriction(Friction):
    """Friction of a shaft against its support: phi_a = phi_b, tau_a + tau_b = tau."""

    flanges: ClassVar[tuple[str, ...]] = ("flange_a", "flange_b", "support")
    grounded: ClassVar[tuple[str, ...]] = ("support",)
    unknowns: ClassVar[int] = 2

    def kinematics(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        through, tau = v.unknown(0), v.unknown(1)
        phi, w, a = v.motion("flange_a")
        return tuple(
            replace(
                piece,
                torques={"flange_a": through, "flange_b": tau - through, "support": -tau},
                channels={"phi": phi, "w": w, "tau": tau, **self.more_channels(v)},
                powers={"lossPower": (tau, w)},
            )
            for piece in self.pieces(v, tau, w, a)
        )


@dataclass(frozen=True)
class BearingFriction(SupportFriction):
    """phi_a = phi_b, tau_a + tau_b = tau, which opposes the speed w against the support.

    Parameters
    ----------
    tau_pos
        Rows [w, tau]: friction torque [N.m] over speed [rad/s] for w >= 0; the same, turned round, backward.
    peak
        Torque that breaks the shaft away over torque at the onset of sliding, >= 1.
    """

    tau_pos: object = ((0.0, 1.0),)
    peak: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "tau_pos", speed_table("BearingFriction.tau_pos", self.tau_pos, 2).rows)

    @cached_property
    def table(self) -> SpeedTable:
        return SpeedTable(self.tau_pos)  # type: ignore[arg-type]

    def sliding(self, v: Variables, speed: Row) -> list[Sliding]:
        return sliding_torques(self.table, v, speed, v.one)


@dataclass(frozen=True, kw_only=True)
class Pressed(Friction):
    """Friction torque mu(w) cgeo fn with fn = fn_max f_normalized(t).

    Parameters
    ----------
    fn_max
        Normal force where the signal is 1 [N].
    f_normalized
        Signal; nothing presses where it is <= 0.
    mu_pos
        Rows [w, mu]: friction coefficient over speed [rad/s], w >= 0; constant where the
        force changes.
    peak
        mu that breaks away over mu at the onset of sliding, >= 1.
    cgeo
        Geometry constant [m].
    """

    fn_max: float
    f_normalized: Signal = ALWAYS
    mu_pos: object = ((0.0, 0.5),)
    peak: float = 1.0
    cgeo: float = 1.0

    ranges: ClassVar[Mapping[str, Range]] = {
        **Friction.ranges, "fn_max": Range("N", at_least=0), "cgeo": Range("m", at_least=0)
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        name = type(self).__name__
        object.__setattr__(self, "mu_pos", speed_table(f"{name}.mu_pos", self.mu_pos, 2).rows)
        if not (self.table.constant or isinstance(self.f_normalized, Constant)):
            raise ParameterError(
                f"{name}.mu_pos: mu must be the same at all speeds where f_normalized changes; "
                "a product of speed and signal is not solved"
            )

    @cached_property
    def table(self) -> SpeedTable:
        return SpeedTable(self.mu_pos)  # type: ignore[arg-type]

    def pressing(self, v: Variables) -> Row:
        return self.cgeo * self.fn_max * v.signal(0)

    def more_channels(self, v: Variables) -> Mapping[str, Row]:
        return {"fn": self.fn_max * v.signal(0)}

    def sliding(self, v: Variables, speed: Row) -> list[Sliding]:
        level = self.f_normalized.k if isinstance(self.f_normalized, Constant) else 0.0
        return sliding_torques(self.table, v, speed, self.pressing(v), self.cgeo * self.fn_max * level)


@dataclass(frozen=True, kw_only=True)
class Brake(Pressed, SupportFriction):
    """phi_a = phi_b, tau_a + tau_b = tau, friction against the support; parameters as of a clutch."""


@dataclass(frozen=True, kw_only=True)
class Clutch(Pressed, WithStarts):
    """Friction between two shafts: tau_b = tau, tau_a = -tau; stuck, both turn alike."""

    phi_rel: float | None = None
    w_rel: float | None = None
    a_rel: float | None = None

    ranges: ClassVar[Mapping[str, Range]] = {**Pressed.ranges, **WithStarts.ranges}
    unknowns: ClassVar[int] = 1

    def between(self, v: Variables) -> tuple[Branch, ...]:
        """Return the branches, without what all of them share."""
        return self.pieces(v, v.unknown(0), v.w_rel, v.a_rel)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = v.unknown(0)
        return tuple(
            replace(
                piece,
                torques={"flange_a": -tau, "flange_b": tau},
                channels={"phi_rel": v.phi_rel, "w_rel": v.w_rel, "tau": tau, **self.more_channels(v)},
                powers={"lossPower": (tau, v.w_rel)},
            )
            for piece in self.between(v)
        )


@dataclass(frozen=True, kw_only=True)
class OneWayClutch(Clutch):
    """A clutch beside a freewheel: flange_b may run ahead of flange_a, never fall behind."""

    def between(self, v: Variables) -> tuple[Branch, ...]:
        tau, pressing = v.unknown(0), self.pressing(v)
        peak = max(self.peak, 1 + RELATIVE_HYSTERESIS)
        least = RELATIVE_HYSTERESIS * float(self.table.at_rest[0]) * self.cgeo * self.fn_max * v.one
        limit = peak * self.sliding(v, 0 * v.one)[0].torque
        sliding = [
            Branch({}, (tau - one.torque,), one.holds, (v.w_rel, pressing), mode=FORWARD)
            for one in self.sliding(v, v.w_rel)
        ]
        return (
            Branch({}, (v.a_rel,), (-pressing, least - tau), (), (v.w_rel,), STUCK),
            Branch({}, (v.a_rel,), (limit - tau,), (pressing,), (v.w_rel,), STUCK),
            Branch({}, (tau,), (-pressing,), (v.w_rel,), mode=FORWARD),
            *sliding,
        )
