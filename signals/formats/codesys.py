"""Traces of CODESYS and its kin (ctrlX, TwinCAT 2): keys and values, one block of stamps and values a variable."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from signals.errors import TelemetryError
from signals.formats.columns import Column, in_memory
from signals.formats.layout import Wanted
from signals.formats.open_table import OpenTable

KIND = "a trace of CODESYS"
VARIABLE = re.compile(r"\d+\.Variable; *(.*)")
PAIR = re.compile(r"(?:\d+\.Data)?; *([-+.\deE]+); *([-+.\deE]+)")


def open_codesys(path: Path, _: Wanted | None = None) -> OpenTable:
    """Return the table of the variables by their names, over the stamps of the first, `time`, whose unit no key says.

    Raises:
        TelemetryError: if there are no variables with values.
    """
    names: list[str] = []
    pairs: list[list[tuple[float, float]]] = []
    for line in _lines(path):
        if match := VARIABLE.fullmatch(line):
            names.append(match[1].strip())
            pairs.append([])
        elif pairs and (match := PAIR.fullmatch(line)):
            try:
                pairs[-1].append((float(match[1]), float(match[2])))
            except ValueError:
                raise TelemetryError(f"{KIND}: {line[:60]!r} holds something that is no number") from None
    blocks = [(name, np.array(block)) for name, block in zip(names, pairs, strict=True) if len(block) > 1]
    if not blocks:
        raise TelemetryError(f"{KIND} without values; save it while it holds some, or export its variables as a table")
    times = blocks[0][1][:, 0]
    if any(np.diff(block[:, 0]).min() < 0.0 for _, block in blocks):
        raise TelemetryError(f"{KIND} whose stamps do not run forwards")
    columns = [Column(name, "", np.interp(times, block[:, 0], block[:, 1])) for name, block in blocks]
    return in_memory([Column("time", "", times), *columns])


def _lines(path: Path) -> Iterator[str]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            yield line.strip()
