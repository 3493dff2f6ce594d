"""The simulator: drive trains, axes with their mechanisms, and what is measured of them. `simulate` runs every one."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim.solver import simulate

__all__ = ["simulate"]


def __getattr__(name: str) -> object:
    """Import the engines with their first use: who reads a description alone needs none of them."""
    if name == "simulate":
        from sim.solver import simulate

        return simulate
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
