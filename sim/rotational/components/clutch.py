"""Clutch, Brake and OneWayClutch: friction under a normal force that a signal sets."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from sim.errors import ParameterError, number
from sim.rotational.component import FORWARD, STUCK, Branch, Component, Row, Signal, Start, Variables
from sim.rotational.components.signals import Constant
from sim.rotational.components.sliding import Piece, Sliding, check_peak, friction_pieces, sliding_torques
from sim.rotational.components.start_values import check_starts
from sim.rotational.components.tables import SpeedTable, speed_table

ALWAYS = Constant(1.0)
RELATIVE_HYSTERESIS = 1e-4
"""Modelica's eps0 of OneWayClutch: least relative difference of the torques at rest and at the onset of sliding."""


@dataclass(frozen=True, kw_only=True)
class Pressed(Component):
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

    def __post_init__(self) -> None:
        name = type(self).__name__
        number(f"{name}.fn_max", self.fn_max, "N", at_least=0)
        number(f"{name}.cgeo", self.cgeo, "m", at_least=0)
        check_peak(name, self.peak)
        object.__setattr__(self, "mu_pos", speed_table(f"{name}.mu_pos", self.mu_pos, 2).rows)
        if not (self.table.constant or isinstance(self.f_normalized, Constant)):
            raise ParameterError(
                f"{name}.mu_pos: mu must be the same at all speeds where f_normalized changes; "
                "a product of speed and signal is not solved"
            )

    @cached_property
    def table(self) -> SpeedTable:
        return SpeedTable(self.mu_pos)  # type: ignore[arg-type]

    @property
    def signals(self) -> tuple[Signal, ...]:
        return (self.f_normalized,)

    def pressing(self, v: Variables) -> Row:
        """Normal force times geometry [N.m]."""
        return self.cgeo * self.fn_max * v.signal(0)

    def torques_at(self, v: Variables, speed: Row) -> list[Sliding]:
        level = self.f_normalized.k if isinstance(self.f_normalized, Constant) else 0.0
        return sliding_torques(self.table, v, speed, self.pressing(v), self.cgeo * self.fn_max * level)


@dataclass(frozen=True, kw_only=True)
class Clutch(Pressed):
    """Friction between two shafts: tau_b = tau, tau_a = -tau; stuck, both turn alike."""

    phi_rel: float | None = None
    w_rel: float | None = None
    a_rel: float | None = None

    units: ClassVar[Mapping[str, str]] = {
        "phi_rel": "rad",
        "w_rel": "rad/s",
        "tau": "N.m",
        "fn": "N",
        "lossPower": "W",
        "mode": "1",
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        check_starts(self, "phi_rel", "w_rel", "a_rel")

    @property
    def unknowns(self) -> int:
        return 1

    def states(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        given = ((v.phi_rel, self.phi_rel), (v.w_rel, self.w_rel))
        return tuple(Start(row, value) for row, value in given if value is not None)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau = v.unknown(0)
        pieces = friction_pieces(
            v, tau, v.w_rel, v.a_rel, lambda speed: self.torques_at(v, speed), self.peak, self.pressing(v)
        )
        return tuple(self._between(v, piece) for piece in pieces)

    def _between(self, v: Variables, piece: Piece) -> Branch:
        tau = v.unknown(0)
        return Branch(
            torques={"flange_a": -tau, "flange_b": tau},
            equations=(piece.equation,),
            holds=piece.holds,
            strict=piece.strict,
            stops=piece.stops,
            mode=piece.mode,
            channels={"phi_rel": v.phi_rel, "w_rel": v.w_rel, "tau": tau, "fn": self.fn_max * v.signal(0)},
            powers={"lossPower": (tau, v.w_rel)},
        )


@dataclass(frozen=True, kw_only=True)
class OneWayClutch(Clutch):
    """A clutch beside a freewheel: flange_b may run ahead of flange_a, never fall behind."""

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        tau, pressing = v.unknown(0), self.pressing(v)
        peak = max(self.peak, 1 + RELATIVE_HYSTERESIS)
        least = RELATIVE_HYSTERESIS * float(self.table.at_rest[0]) * self.cgeo * self.fn_max * v.one
        limit = peak * self.torques_at(v, 0 * v.one)[0].torque
        pieces = (
            Piece(STUCK, v.a_rel, (-pressing, least - tau), stops=(v.w_rel,)),
            Piece(STUCK, v.a_rel, (limit - tau,), (pressing,), stops=(v.w_rel,)),
            Piece(FORWARD, tau, (-pressing,), (v.w_rel,)),
            *(Piece(FORWARD, tau - one.torque, one.holds, (v.w_rel, pressing)) for one in self.torques_at(v, v.w_rel)),
        )
        return tuple(self._between(v, piece) for piece in pieces)
