"""Numbers that note what they decide.

A deciding number goes through arithmetic as itself, twice itself and half of itself. Where it ends in a comparison, or
in the larger or smaller of two arrays, the ledger counts whether the outcome would have been another. It does not see
what becomes of a number as a factor of an array, which it counts as scaled, nor what functions of `math` make of it.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

import numpy as np

Others = Mapping[str, tuple[float, float]]
COMPARISONS = frozenset({np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal})
CHOICES = COMPARISONS | {np.maximum, np.minimum}


@dataclass
class Use:
    """How often a number was compared, how often that would have come out otherwise, how often it scaled an array."""

    compared: int = 0
    decided: int = 0
    scaled: int = 0


@dataclass
class Ledger:
    """The uses of all numbers by name."""

    uses: dict[str, Use] = field(default_factory=dict)
    lock: Lock = field(default_factory=Lock)

    def of(self, name: str) -> Use:
        """What was noted of a number; nothing yet if it is new."""
        with self.lock:
            return self.uses.setdefault(name, Use())

    def note(self, name: str, *, decided: bool) -> None:
        """Count a comparison."""
        use = self.of(name)
        use.compared += 1
        use.decided += decided

    def scale(self, name: str) -> None:
        """Count an array that was made with a number."""
        self.of(name).scaled += 1


class Deciding:
    """What whole and broken numbers share; `others`: by name, the same quantity with that number twice and half."""

    plain: type
    others: Others
    ledger: Ledger

    def __new__(cls, value: Any, others: Others, ledger: Ledger) -> Any:
        self: Any = super().__new__(cls, value)  # type: ignore[call-arg]
        self.others, self.ledger = others, ledger
        return self

    def __reduce__(self) -> tuple[type, tuple[Any]]:
        return self.plain, (self.plain(self),)

    def __hash__(self) -> int:
        return hash(self.plain(self))

    def __neg__(self) -> Any:
        return self._through(operator.neg, (self,))

    def __array_ufunc__(self, function: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method == "__call__" and not options:
            return self._through(function, inputs)
        for name in self.others:
            self.ledger.scale(name)
        return getattr(function, method)(*(_plain(x) for x in inputs), **options)

    def _through(self, function: Callable[..., Any], inputs: tuple[Any, ...]) -> Any:
        """The function of plain inputs, as a deciding number where it is one number; choices are noted."""
        out = function(*(_plain(x) for x in inputs))
        names = {name for x in inputs if isinstance(x, Deciding) for name in x.others}
        one = np.ndim(out) == 0 and not isinstance(out, bool | np.bool_)
        others = {}
        for name in names:
            if not one and function not in CHOICES and not isinstance(out, bool | np.bool_):
                self.ledger.scale(name)
                continue
            twice, half = (function(*(_other(x, name, k) for x in inputs)) for k in (0, 1))
            if one:
                others[name] = (float(twice), float(half))
            else:
                self.ledger.note(name, decided=not (np.array_equal(twice, out) and np.array_equal(half, out)))
        return number(out, others, self.ledger) if one else out


class DecidingFloat(Deciding, float):
    """A broken number."""

    plain = float


class DecidingInt(Deciding, int):
    """A whole number."""

    plain = int


def _plain(value: Any) -> Any:
    return value.plain(value) if isinstance(value, Deciding) else value


def _other(value: Any, name: str, which: int) -> Any:
    changed = isinstance(value, Deciding) and name in value.others
    return value.others[name][which] if changed else _plain(value)


def number(value: Any, others: Others, ledger: Ledger) -> Any:
    """A deciding number of the kind of `value`; what is no number stays what it is."""
    if isinstance(value, int | np.integer) and all(x == int(x) for pair in others.values() for x in pair):
        return DecidingInt(int(value), others, ledger)
    if isinstance(value, int | float | np.floating):
        return DecidingFloat(float(value), others, ledger)
    return value


def deciding(name: str, value: Any, ledger: Ledger) -> Any:
    """`value` with each number in it, in tuples and dictionaries too, noting what it decides under `name`."""
    if isinstance(value, bool):
        return value
    if isinstance(value, int):
        ledger.of(name)
        return number(value, {name: (2 * value, value // 2)}, ledger)
    if isinstance(value, float):
        ledger.of(name)
        return number(value, {name: (2.0 * value, value / 2.0)}, ledger)
    if isinstance(value, tuple) and type(value) is tuple:
        return tuple(deciding(name, x, ledger) for x in value)
    if isinstance(value, dict):
        return {key: deciding(name, x, ledger) for key, x in value.items()}
    return value


def _made(function: Callable[..., Any], *, turned: bool) -> Callable[[Any, Any], Any]:
    def applied(self: Deciding, other: Any) -> Any:
        if not isinstance(other, int | float | np.number | np.ndarray):
            return NotImplemented
        return self._through(function, (other, self) if turned else (self, other))

    return applied


for _name in ("add", "sub", "mul", "truediv", "floordiv", "pow", "mod"):
    setattr(Deciding, f"__{_name}__", _made(getattr(operator, _name), turned=False))
    setattr(Deciding, f"__r{_name}__", _made(getattr(operator, _name), turned=True))
for _name in ("lt", "le", "gt", "ge", "eq", "ne"):
    setattr(Deciding, f"__{_name}__", _made(getattr(operator, _name), turned=False))
