"""What can be wrong with a drive train, its description or a run: errors that say what would be right."""

import math
from collections.abc import Iterable
from difflib import get_close_matches

LONGEST_SHOWN = 60


class SimulationError(ValueError):
    """Base of all errors that the simulator raises on purpose."""


class ParameterError(SimulationError):
    """A number is missing, not finite or out of its range; the message names it."""


class AxisError(SimulationError):
    """An axis description is wrong; the message starts with the path of the key."""


class CompositionError(SimulationError):
    """Components are connected in a way that cannot be, or a name is not there."""


class RunError(SimulationError):
    """A run cannot be begun (too long, too large) or has no continuation."""


def near_match(name: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` or the list of what is known.

    >>> near_match("stifness", ["stiffness", "damping"])
    "; did you mean 'stiffness'?"
    >>> near_match("q", ["a", "b"])
    '; known: a, b'
    """
    names = sorted(known)
    close = get_close_matches(name, names, n=1)
    return f"; did you mean {close[0]!r}?" if close else f"; known: {', '.join(names)}"


def number(
    name: str,
    value: object,
    unit: str,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
) -> float:
    """Return `value` as a finite float within its range.

    Raises
    ------
    ParameterError
        with the name, the range, the unit and the value that was given.

    >>> number("Inertia.J", 3, "kg.m2", above=0)
    3.0
    """
    rule = _range(unit, above, at_least, at_most)
    if isinstance(value, bool) or not hasattr(value, "__float__"):
        raise ParameterError(f"{name}: must be {rule}, got {shown(value)}")
    try:
        x = float(value)
    except OverflowError:  # a whole number of more than 308 digits
        x = math.inf
    if not math.isfinite(x) or x <= above or x < at_least or x > at_most:
        raise ParameterError(f"{name}: must be {rule}, got {shown(value)}")
    return x


def shown(value: object) -> str:
    """Write what was given, shortened.

    >>> shown(-20), shown("9" * 99)
    ('-20', "'999999999999999999999999999...")
    """
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[: LONGEST_SHOWN - 32]}..."


def _range(unit: str, above: float, at_least: float, at_most: float) -> str:
    parts = []
    if above > -math.inf:
        parts.append(f"> {above:g}")
    if at_least > -math.inf:
        parts.append(f">= {at_least:g}")
    if at_most < math.inf:
        parts.append(f"<= {at_most:g}")
    words = " and ".join(parts) or "a finite number"
    return f"{words} {unit}" if unit not in ("", "1") else words
