"""RelativeStates: the relative motion of two flanges as states, with its start values; it carries no torque."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sim.rotational.component import Branch, Component, Row, Start, Variables
from sim.rotational.components.start_values import check_starts


@dataclass(frozen=True)
class RelativeStates(Component):
    """phi_rel = phi_b - phi_a [rad] and w_rel [rad/s] are states; start values, None: not given; a_rel is refused."""

    phi_rel: float | None = None
    w_rel: float | None = None
    a_rel: float | None = None

    units: ClassVar[Mapping[str, str]] = {"phi_rel": "rad", "w_rel": "rad/s", "a_rel": "rad/s2"}

    def __post_init__(self) -> None:
        check_starts(self, "phi_rel", "w_rel", "a_rel")

    def states(self, v: Variables) -> tuple[Row, ...]:
        return (v.phi_rel,)

    def starts(self, v: Variables) -> tuple[Start, ...]:
        given = ((v.phi_rel, self.phi_rel), (v.w_rel, self.w_rel))
        return tuple(Start(row, value) for row, value in given if value is not None)

    def branches(self, v: Variables) -> tuple[Branch, ...]:
        return (Branch(torques={}, channels={"phi_rel": v.phi_rel, "w_rel": v.w_rel, "a_rel": v.a_rel}),)
