"""Names and units of a trajectory's channels."""

from collections.abc import Mapping

from sim.piecewise_affine.system import System


def channel_names(system: System, i: int) -> list[str]:
    """Names of the channels of component i, those of its class that its branches speak of."""
    branch = system.pieces[i][0].branch
    names = [*branch.channels, *branch.powers]
    return [*names, "mode"] if branch.mode is not None else names


def channel_units(system: System) -> Mapping[str, str]:
    """Unit of every channel of a train."""
    return {
        f"{name}.{channel}": part.unit(channel)
        for i, (name, part) in enumerate(zip(system.names, system.components, strict=True))
        for channel in channel_names(system, i)
    }
