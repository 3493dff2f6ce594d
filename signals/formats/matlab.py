"""MAT files of MATLAB 5 to 7.2 and of Octave (`save -v7`): variables, and fields of structures, are columns."""

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.errors import TelemetryError
from signals.formats.columns import Column, common_length, in_memory
from signals.formats.layout import Wanted
from signals.formats.open_table import OpenTable

KIND = "the MAT file"
DEEPEST = 8
"""Structures within structures that are looked into."""


def open_matlab(path: Path, _: Wanted | None = None) -> OpenTable:
    """Return the table of a MAT file: `q`, a field as `log.q`, the columns of a matrix as `q[1]`, `q[2]`.

    Objects (timeseries, table, timetable) are no arrays and are left out.

    Raises:
        TelemetryError: if it is no such file or holds no columns of numbers.
    """
    from scipy import io  # of all formats this one alone pays for it

    try:
        variables = io.loadmat(path)
    except (ValueError, TypeError, KeyError, IndexError, EOFError, OSError, NotImplementedError, zlib.error) as error:
        raise TelemetryError(f"{KIND} cannot be read: {error}") from error
    except io.matlab.MatReadError as error:
        raise TelemetryError(f"{KIND} cannot be read: {error}") from error
    arrays = [
        each for name, value in variables.items() if not name.startswith("__") for each in _arrays(name, value, DEEPEST)
    ]
    try:
        rows = common_length([max(array.shape) for _, array in arrays], KIND)
    except TelemetryError as error:
        raise TelemetryError(
            f"{error}; a timeseries, a table or a timetable is none: save its numbers, such as t = x.Time, q = x.Data"
        ) from None
    return in_memory([column for name, array in arrays for column in _columns(name, array, rows)])


def _arrays(name: str, value: Any, deep: int) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Arrays of numbers with at most two dimensions, below their names."""
    if not isinstance(value, np.ndarray) or value.size == 0:
        return
    if value.dtype.names:
        if value.size == 1 and deep:
            for field in value.dtype.names:
                yield from _arrays(f"{name}.{field}", value[field].flat[0], deep - 1)
    elif value.dtype.kind in "biuf" and (array := np.squeeze(value)).ndim in (1, 2):
        yield name, array.astype(np.float64)


def _columns(name: str, array: NDArray[np.float64], rows: int) -> Iterator[Column]:
    """The columns of an array, whichever way it lies, if it has so many rows."""
    if array.ndim == 1 and array.size == rows:
        yield Column(name, "", array)
    elif array.ndim == 2 and rows in array.shape:
        table = array if array.shape[0] == rows else array.T
        for place in range(table.shape[1]):
            yield Column(f"{name}[{place + 1}]", "", np.ascontiguousarray(table[:, place]))
