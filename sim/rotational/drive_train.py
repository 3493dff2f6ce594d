"""A drive train: components and how their flanges are connected; immutable, every change makes a new one.

The axis of Olsson and Stolyarchuk, in a few lines:

>>> from sim.rotational.components import Gearbox, Inertia, Sine, Torque
>>> axis = DriveTrain.series(
...     torque=Torque(Sine(amplitude=12, f=0.5)),
...     motor=Inertia(J=0.6),
...     gear=Gearbox(ratio=100, lossTable=[0, 0.9, 0.9, 0.9, 0.9], c=1e5),
...     load=Inertia(J=30),
... )
>>> list(axis.components)
['torque', 'motor', 'gear.lossyGear', 'gear.elastoBacklash', 'load']
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from sim.description.axis import Axis
from sim.errors import CompositionError, near_match
from sim.rotational.component import Component
from sim.rotational.components import (
    Gearbox,
)


@dataclass(frozen=True)
class DriveTrain:
    """Components by name, and connections as tuples of flanges that are one: ``("motor.flange_b", "gear.flange_a")``.

    Raises
    ------
    CompositionError
        where a connection names a component or a flange that is not there, or a flange twice.
    """

    components: Mapping[str, Component] = field(default_factory=dict)
    connections: tuple[tuple[str, ...], ...] = ()
    axis: Axis | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", MappingProxyType(dict(self.components)))
        for name, component in self.components.items():
            if not isinstance(component, Component):
                raise CompositionError(f"{name}: must be a component, got {component!r}")
        for connection in self.connections:
            if len(set(connection)) < 2:
                raise CompositionError(f"a connection joins two or more flanges, got {connection}")
            for flange in connection:
                self._require(flange)

    def __getitem__(self, name: str) -> Component:
        if name not in self.components:
            raise CompositionError(f"no component {name!r}{near_match(name, self.components)}")
        return self.components[name]

    def __reduce__(self) -> tuple[object, ...]:
        return DriveTrain, (dict(self.components), self.connections, self.axis)

    @property
    def affine(self) -> bool:
        """Whether the exact engine can have it."""
        return all(component.affine for component in self.components.values())

    @classmethod
    def series(cls, /, **parts: Component | Gearbox) -> "DriveTrain":
        """Connect parts in the order given: each one's last flange to the next one's first.

        A part with one flange (a source, Fixed) stands at an end, or hangs between its neighbours.
        """
        return cls()._chain(None, parts)

    def branch(self, at: str, **parts: Component | Gearbox) -> "DriveTrain":
        """Hang a series of parts on the flange `at`, such as ``damper=Damper(d=10), ground=Fixed()``."""
        self._require(at)
        return self._chain(at, parts)

    def add(self, name: str, component: Component, **flanges: str) -> "DriveTrain":
        """Add a component, its flanges connected as given: ``flange_a="motor.flange_b"``."""
        for flange in flanges.values():
            self._require(flange)
        connections = tuple((f"{name}.{mine}", other) for mine, other in flanges.items())
        return self._with({name: component}, connections)

    def connect(self, *flanges: str) -> "DriveTrain":
        """Make flanges one, such as a gear's `support` and its housing's `flange_a`."""
        return replace(self, connections=(*self.connections, flanges))

    def replace(self, name: str, component: Component) -> "DriveTrain":
        """Put another component in the place of one; its connections stay."""
        self[name]
        return replace(self, components={**self.components, name: component})

    def remove(self, name: str) -> "DriveTrain":
        """Take a component out, with its connections."""
        self[name]
        left = {key: part for key, part in self.components.items() if key != name}
        kept = (
            tuple(flange for flange in connection if _component_of(flange) != name) for connection in self.connections
        )
        return replace(self, components=left, connections=tuple(c for c in kept if len(c) > 1))

    def nodes(self) -> list[frozenset[str]]:
        """Sets of flanges that turn as one, every flange in exactly one set."""
        sets = {
            f"{name}.{flange}": {f"{name}.{flange}"}
            for name, component in self.components.items()
            for flange in component.flanges
        }
        for connection in self.connections:
            joined = set().union(*(sets[flange] for flange in connection))
            for flange in joined:
                sets[flange] = joined
        unique: dict[int, set[str]] = {id(flanges): flanges for flanges in sets.values()}
        return [frozenset(flanges) for flanges in unique.values()]

    def _require(self, flange: str) -> None:
        name = _component_of(flange)
        known = self[name].flanges
        if flange[len(name) + 1 :] not in known:
            raise CompositionError(f"{flange}: no such flange{near_match(flange[len(name) + 1 :], known)}")

    def _with(self, parts: Mapping[str, Component], connections: tuple[tuple[str, ...], ...]) -> "DriveTrain":
        for name in parts:
            if name in self.components:
                raise CompositionError(f"{name}: there is already a component of this name")
        return replace(self, components={**self.components, **parts}, connections=(*self.connections, *connections))

    def _chain(self, end: str | None, parts: Mapping[str, Component | Gearbox]) -> "DriveTrain":
        singles: dict[str, Component] = {}
        for name, part in parts.items():
            inner = part.parts() if isinstance(part, Gearbox) else {"": part}
            singles.update({f"{name}.{key}" if key else name: one for key, one in inner.items()})
        connections: list[tuple[str, ...]] = []
        for name, part in singles.items():
            if not isinstance(part, Component):
                raise CompositionError(f"{name}: must be a component, got {part!r}")
            through = [flange for flange in part.flanges if flange not in part.grounded]
            if end is not None:
                connections.append((end, f"{name}.{through[0]}"))
            end = f"{name}.{through[-1]}" if len(through) > 1 or end is None else end
        return self._with(singles, tuple(connections))


def _component_of(flange: str) -> str:
    return flange.rpartition(".")[0]
