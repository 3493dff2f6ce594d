"""Drive trains as documents: components and connections by Modelica's names, read from TOML; errors name their line."""

import re
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, NoReturn, get_args, get_type_hints

from signals.errors import TextError
from signals.reading.documents import parse_document
from signals.reading.text import text_of
from sim.errors import CompositionError, ParameterError, SimulationError, near_match, shown
from sim.rotational.component import Component, Signal
from sim.rotational.components import COMPONENTS, signals
from sim.rotational.drive_train import DriveTrain

SCHEMA = "gearcase-train/1"
KEYS = ("schema", "series", "connections", "components")
KINDS: Mapping[str, type] = {kind.__name__: kind for kind in COMPONENTS}
SIGNALS: Mapping[str, type] = {
    name: kind
    for name, kind in vars(signals).items()
    if isinstance(kind, type) and issubclass(kind, Signal) and kind is not Signal
}

_KEY = r"""(?:[\w-]+|"[^"]*"|'[^']*')"""
_PATH = rf"{_KEY}(?:\s*\.\s*{_KEY})*"
_LINE = re.compile(rf"\s*(?:\[\s*({_PATH})\s*\]|({_PATH})\s*=)")
_IDENTIFIER = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)

Path = tuple[str, ...]


def read_train(text: bytes | str) -> DriveTrain:
    """Read a drive train from a document: TOML, or the same as JSON, whose errors name no line.

    Raises
    ------
    ParameterError
        naming line and key, what is wrong with it and what would be right; unknown keys are refused.
    CompositionError
        naming the line of a connection that cannot be.

    >>> train = read_train('''
    ... series = ["drive", "motor"]
    ... components.drive = {type = "Torque", tau = {type = "Sine", amplitude = 12, f = 0.5}}
    ... components.motor = {type = "Inertia", J = 0.6}
    ... ''')
    >>> train["motor"], train.connections
    (Inertia(J=0.6, phi=None, w=None, a=None), (('drive.flange', 'motor.flange_a'),))
    """
    try:
        return _Reader(text).train()
    except TextError as error:
        raise ParameterError(str(error)) from None


class _Reader:
    def __init__(self, text: bytes | str) -> None:
        self._document = parse_document(text)
        self._text = text_of(text).split("\n")
        self._lines = _lines(self._text)

    def train(self) -> DriveTrain:
        self._known((), self._document, KEYS)
        if self._document.get("schema", SCHEMA) != SCHEMA:
            self._refuse(("schema",), f"must be {SCHEMA!r}, got {shown(self._document['schema'])}")
        tables = self._document.get("components")
        if not isinstance(tables, Mapping):
            self._refuse(("components",), "must be tables such as [components.motor]")
        parts = {name: self._component(name, table) for name, table in tables.items()}
        series, connections = (self._list(key) for key in ("series", "connections"))
        for i, name in enumerate(series):
            if not isinstance(name, str) or name not in parts:
                self._refuse(("series",), f"no component {shown(name)}{near_match(str(name), parts)}", str(name))
            if name in series[:i]:
                self._refuse(("series",), f"{name} stands there twice", name)
        try:
            train = DriveTrain.series(**{str(name): parts[str(name)] for name in series})
        except SimulationError as error:
            self._refuse(("series",), str(error))
        train = DriveTrain({**train.components, **parts}, train.connections)
        for flanges in connections:
            if not isinstance(flanges, list) or not all(isinstance(flange, str) for flange in flanges):
                self._refuse(("connections",), f"must be lists of flanges, got {shown(flanges)}")
            try:
                train = train.connect(*flanges)
            except SimulationError as error:
                self._refuse(("connections",), str(error), *flanges)
        return train

    def _component(self, name: str, table: object) -> Component:
        path = ("components", name)
        if not _IDENTIFIER.fullmatch(name):
            self._refuse(path, "must be a name of letters, digits and _ that begins with no digit")
        made: Component = self._made(path, table, KINDS)
        return made

    def _made(self, path: Path, table: object, kinds: Mapping[str, type]) -> Any:
        """Make a component or a signal of a table, by its `type` and the parameters of that."""
        if not isinstance(table, Mapping) or "type" not in table:
            self._refuse(path, f'must be a table with type = "...", got {shown(table)}')
        kind = table["type"]
        if not isinstance(kind, str) or kind not in kinds:
            self._refuse((*path, "type"), f"no type {shown(kind)}{near_match(str(kind), kinds)}")
        made, hints = kinds[kind], get_type_hints(kinds[kind])
        parameters = {field.name: field for field in fields(made) if field.init}
        self._known(path, table, ("type", *parameters))
        given: dict[str, object] = {}
        for key, field in parameters.items():
            if key in table:
                given[key] = self._value((*path, key), table[key], hints[key])
            elif field.default is MISSING:
                self._refuse((*path, key), f"missing; {kind} has no default of it")
        try:
            return made(**given)
        except SimulationError as error:
            whose = re.match(r"\w+\.(\w+)", str(error))
            if whose is None or whose[1] not in parameters:
                self._refuse(path, str(error))
            self._refuse((*path, whose[1]), str(error)[whose.end() :].removeprefix(": "))
        except (TypeError, ValueError, OverflowError) as error:
            self._refuse(path, f"{kind} cannot have these parameters: {error}")

    def _value(self, path: Path, value: object, hint: object) -> object:
        """A parameter; those that components take as they are, signals and truth values, are looked at here."""
        if isinstance(value, Mapping):
            value = self._made(path, value, SIGNALS)
        kinds = tuple(kind for kind in get_args(hint) or (hint,) if _is_one_of(kind, (bool, Signal)))
        if kinds and not isinstance(value, kinds):
            types = [name for name, kind in SIGNALS.items() if issubclass(kind, kinds)]
            right = f"a signal, a table whose type is {', '.join(types)}" if types else "true or false"
            self._refuse(path, f"must be {right}, got {shown(value)}")
        return value

    def _list(self, key: str) -> list[object]:
        value = self._document.get(key, [])
        if not isinstance(value, list):
            self._refuse((key,), f"must be a list, got {shown(value)}")
        return value

    def _known(self, path: Path, table: Mapping[str, object], known: tuple[str, ...]) -> None:
        for key in table:
            if key not in known:
                self._refuse((*path, key), f"unknown key{near_match(key, known)}")

    def _refuse(self, path: Path, words: str, *near: str) -> NoReturn:
        """Say what is wrong with a key, after its line: the first one from the key on that has all the words `near`."""
        known = [self._lines[path[:n]] for n in range(len(path), 0, -1) if path[:n] in self._lines]
        lines = [i for i, line in enumerate(self._text, 1) if known and i >= known[0] and all(w in line for w in near)]
        place = f"line {(lines or known)[0]}: " if known else ""
        kind = CompositionError if path[0] in ("series", "connections") else ParameterError
        raise kind(f"{place}{'.'.join(path)}{'' if words.startswith('[') else ': '}{words}")


def _is_one_of(kind: object, kinds: tuple[type, ...]) -> bool:
    return isinstance(kind, type) and issubclass(kind, kinds)


def _lines(text: list[str]) -> dict[Path, int]:
    """The line of every table and of every key that begins a line, from 1."""
    lines: dict[Path, int] = {}
    table: Path = ()
    for number, line in enumerate(text, 1):
        found = _LINE.match(line)
        if found:
            header, key = (tuple(name.strip("\"'") for name in re.findall(_KEY, part or "")) for part in found.groups())
            table = header or table
            path = (*table, *key)
            for depth in range(1, len(path) + 1):
                lines.setdefault(path[:depth], number)
    return lines
