"""The kinds of files in which telemetry comes, in words: for pages, commands and refusals, which read none of them."""

TEXT: tuple[str, ...] = (".csv", ".txt", ".tsv")
"""Endings of tables of text."""

BINARY: dict[str, tuple[str, ...]] = {
    "Parquet": (".parquet",),
    "MAT": (".mat",),
    "TDMS (LabVIEW)": (".tdms",),
    "MCAP (ROS 2)": (".mcap",),
}
"""All other kinds with the endings of their files; read by `signals.formats.READERS`."""


def table_kinds(text: str = "CSV") -> str:
    """Return all kinds of tables in words, `text` for those of text.

    >>> table_kinds()
    'CSV, Parquet, MAT, TDMS (LabVIEW) or MCAP (ROS 2)'
    """
    *others, last = BINARY
    return f"{', '.join((text, *others))} or {last}"


def binary_endings() -> tuple[str, ...]:
    """Return the endings of files whose columns are named anywhere in them."""
    return tuple(ending for endings in BINARY.values() for ending in endings)
