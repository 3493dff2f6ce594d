"""Start values that components share: checked, and the one that cannot be refused in words."""

from sim.errors import ParameterError, number
from sim.rotational.component import Component


def check_starts(part: Component, position: str, speed: str, acceleration: str) -> None:
    """Check a component's start values by their names.

    Raises
    ------
    ParameterError
        for what is no number, and for any start acceleration: Modelica takes it as a guess, or to find the position or
        speed that makes it; here positions and speeds are what is given.
    """
    name = type(part).__name__
    for field in (position, speed):
        if getattr(part, field) is not None:
            number(f"{name}.{field}", getattr(part, field), "")
    if getattr(part, acceleration) is not None:
        raise ParameterError(
            f"{name}.{acceleration}: a start acceleration is not taken, it follows from the torques at the start; "
            f"give {position} and {speed} instead"
        )
