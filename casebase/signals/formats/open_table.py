"""A table of a file that has been opened, but of which only the names of the columns have been read."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Rows = tuple[NDArray[np.float64], ...]


@dataclass(frozen=True)
class OpenTable:
    """A table.

    Args:
        names: of the columns, as they stand in the file.
        rows: by the names of some columns, each of which stands once, gives their values block by block, arrays of
            shape (rows,) in this order; a missing value is NaN. Raises TelemetryError.
    """

    names: tuple[str, ...]
    rows: Callable[[Sequence[str]], Iterator[Rows]]
