"""LossyGear: a gear with mesh efficiency and bearing friction that rolls forward, backward, or sticks.

Gearbox has no physics of its own: it connects a LossyGear and an ElastoBacklash, as Modelica's Gearbox and Gear2.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import inf
from typing import ClassVar

import numpy as np

from sim.errors import ParameterError
from sim.laws import driver_torque, turning_torque
from sim.rotational.component import BACKWARD, FORWARD, FREE, STUCK, Branch, Component, Row, Variables
from sim.rotational.components.elasto_backlash import ElastoBacklash, Law
from sim.rotational.components.ideal_gear import Gear
from sim.rotational.components.tables import Line, SpeedTable, speed_table

IDEAL = ((0.0, 1.0, 1.0, 0.0, 0.0),)


@dataclass(frozen=True)
class LossyGear(Gear):
    """Modelica 4.1's law of a gear with losses.

    phi_a = ratio phi_b, 0 = tau_b + ratio (tau_a - tauLoss); the loss depends on who drives and on the direction.

    Parameters
    ----------
    ratio
        phi_a / phi_b.
    lossTable
        Rows [|w_a|, eta_mf1, eta_mf2, |tau_bf1|, |tau_bf2|]: speed [rad/s], efficiency of the mesh and bearing friction
        at flange_a [N.m] when flange_a (1) or flange_b (2) drives. One row: the same at all speeds. Of several, the
        efficiencies must be the same; where bearing friction falls below zero beyond them its absolute value counts,
        as in Modelica.
    """

    ratio: float
    lossTable: object = IDEAL

    unknowns: ClassVar[int] = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        table = speed_table("LossyGear.lossTable", self.lossTable, 5)
        for i, row in enumerate(table.rows):
            for j in (1, 2):
                if not 0 < row[j] <= 1:
                    raise ParameterError(f"LossyGear.lossTable[{i}][{j}]: must be > 0 and <= 1, got {row[j]:g}")
        if len({row[1:3] for row in table.rows}) > 1:
            raise ParameterError(
                "LossyGear.lossTable: the efficiencies must be the same in all rows; "
                "an efficiency that changes with the speed is not solved"
            )
        object.__setattr__(self, "lossTable", table.rows)

    @cached_property
    def table(self) -> SpeedTable:
        return SpeedTable(self.lossTable)  # type: ignore[arg-type]

    @property
    def loses_torque(self) -> bool:
        return self.table.rows != IDEAL

    @cached_property
    def _lines(self) -> list[Line]:
        """Straight pieces of the table on which no bearing friction passes zero, all of it positive."""
        out = []
        for low, high, levels, slopes in self.table.lines:
            zeros = -levels[2:] / np.where(slopes[2:] != 0, slopes[2:], np.inf)
            edges = [low, *sorted({zero for zero in zeros.tolist() if low < zero < high}), high]
            for start, end in pairwise(edges):
                middle = start + 1.0 if end == inf else 0.5 * (start + end)
                sign = np.where(levels + slopes * middle < 0, -1.0, 1.0)
                out.append(Line(start, end, sign * levels, sign * slopes))
        return out

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        if self.table.rows == IDEAL:
            return (self._branch(v, FREE, v.unknown(1), ()),)
        eta1, eta2, bf1, bf2 = self._lines[0].levels[:, None]
        # stuck, one combination cannot be: between the two torques at which the driver changes, both or none drive
        never = float(np.sign(_switch(float(eta1[0]), float(eta2[0]), bf1, bf2))[0])
        stuck = [(upper, lower) for upper in (1, -1) for lower in (1, -1) if (upper, lower) != (never, never)]
        rolling = [(way, driver, line) for way in (FORWARD, BACKWARD) for driver in (1, -1) for line in self._lines]
        return (*(self._stuck(v, *sides) for sides in stuck), *(self._rolling(v, *piece) for piece in rolling))

    def _branch(
        self,
        v: Variables,
        mode: int,
        equation: Row,
        holds: tuple[Row, ...],
        strict: tuple[Row, ...] = (),
        stops: tuple[Row, ...] = (),
    ) -> Branch:
        tau_a, loss = v.unknown(0), v.unknown(1)
        tau_b = -self.ratio * (tau_a - loss)
        phi_a, w_a, _ = v.motion("flange_a")
        return Branch(
            torques={"flange_a": tau_a, "flange_b": tau_b, "support": -tau_a - tau_b},
            equations=(equation,),
            holds=holds,
            strict=strict,
            stops=stops,
            mode=mode,
            channels={
                "phi_a": phi_a,
                "w_a": w_a,
                "tauLoss": loss,
                "flange_a.tau": tau_a,
                "flange_b.tau": tau_b,
            },
            powers={"lossPower": (loss, w_a)},
        )

    def _rolling(self, v: Variables, direction: int, driver: int, line: Line) -> Branch:
        """Flange_a drives (eta_mf1), or flange_b (eta_mf2); the torque at flange_a tells which."""
        tau_a, loss = v.unknown(0), v.unknown(1)
        turns = direction * v.motion("flange_a")[1]
        eta1, eta2 = line.levels[:2].tolist()
        bf1, bf2 = (line.levels[i] * v.one + line.slopes[i] * turns for i in (2, 3))
        share, bearing = _lost(eta1, eta2, driver > 0), bf1 if driver > 0 else bf2
        equation = loss - share * tau_a - direction * bearing
        drives = driver * (direction * tau_a - _switch(eta1, eta2, bf1, bf2))
        return self._branch(v, direction, equation, (drives, *line.holds(v, turns)), (turns,))

    def _stuck(self, v: Variables, upper_side: int, lower_side: int) -> Branch:
        """The loss holds the gear while it lies within limits; each limit has two pieces, by who would drive."""
        tau_a, loss = v.unknown(0), v.unknown(1)
        eta1, eta2, *bearings = self._lines[0].levels.tolist()
        bf1, bf2 = (bearing * v.one for bearing in bearings)
        switch = _switch(eta1, eta2, bf1, bf2)
        upper, lower = ((_lost(eta1, eta2, side > 0), bf1 if side > 0 else bf2) for side in (upper_side, lower_side))
        holds = (
            upper[0] * tau_a + upper[1] - loss,
            loss - lower[0] * tau_a + lower[1],
            upper_side * (tau_a - switch),
            lower_side * (-tau_a - switch),
        )
        _, w_a, a_a = v.motion("flange_a")
        return self._branch(v, STUCK, a_a, holds, stops=(w_a,))


def _lost(eta1: float, eta2: float, drives: bool) -> float:
    """Share of the torque at flange_a that the mesh loses."""
    return 1.0 - 1.0 / driver_torque(1.0, 1.0, drives, eta1, eta2, 0.0, 0.0)


def _switch(eta1: float, eta2: float, bf1: Row, bf2: Row) -> Row:
    """Torque at flange_a [N.m] above which, rolling forward, flange_a drives: there both pieces meet."""
    by_first, by_second = (turning_torque(eta1, eta2, *unit) for unit in ((1.0, 0.0), (0.0, 1.0)))
    return by_first * bf1 + by_second * bf2


@dataclass(frozen=True)
class Gearbox:
    """A gear with losses on the side of flange_a, then elasticity and backlash, felt at flange_b.

    Parameters
    ----------
    ratio, lossTable
        As of `LossyGear`.
    c, d, b
        Stiffness [N.m/rad], damping [N.m.s/rad], total backlash [rad], all after the reduction.
    law
        As of `ElastoBacklash`; `linear` gives Gear2 of Modelica 2.2.
    """

    ratio: float
    lossTable: object = IDEAL
    c: float = 1e5
    d: float = 0.0
    b: float = 0.0
    law: Law = "elasto"

    def __post_init__(self) -> None:
        self.parts()

    def parts(self) -> dict[str, Component]:
        """Components by name, in series from flange_a to flange_b."""
        return {
            "lossyGear": LossyGear(self.ratio, self.lossTable),
            "elastoBacklash": ElastoBacklash(c=self.c, d=self.d, b=self.b, law=self.law),
        }
