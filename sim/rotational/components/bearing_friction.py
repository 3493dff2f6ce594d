"""BearingFriction: Coulomb friction of a shaft in its bearings, with stick-slip."""

from dataclasses import dataclass
from functools import cached_property

from sim.rotational.component import Row, Variables
from sim.rotational.components.sliding import Sliding, SupportFriction, check_peak, sliding_torques
from sim.rotational.components.tables import SpeedTable, speed_table


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
        object.__setattr__(self, "tau_pos", speed_table("BearingFriction.tau_pos", self.tau_pos, 2).rows)
        check_peak("BearingFriction", self.peak)

    @cached_property
    def table(self) -> SpeedTable:
        return SpeedTable(self.tau_pos)  # type: ignore[arg-type]

    def torques_at(self, v: Variables, speed: Row) -> list[Sliding]:
        return sliding_torques(self.table, v, speed, v.one)
