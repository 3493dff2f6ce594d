"""What every verb has: options of one name, the installation's library, words on stderr, results on stdout.

What is slow to import is imported where it is needed: a verb that needs no library starts in three quarters of the
time.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from app.commands import DATA_DIR
from app.http.finite import finite

if TYPE_CHECKING:
    from app.settings import Settings
    from casebase.library import CaseLibrary
    from sim.description.axis import Axis

ACTOR = "command line"
WORDS, RESULTS = Console(stderr=True, soft_wrap=True), Console(soft_wrap=True)

AXIS = typer.Option(
    metavar="AXIS", help="description of the axis: a file such as axis.toml, or the name of a stored one"
)
NamedAxis = Annotated[
    str | None,
    typer.Option(
        "--axis",
        metavar="AXIS",
        help="name of the axis as the service knows it, or a file such as axis.toml with that name",
    ),
]
Channel = Annotated[int | None, typer.Option(help="channel to use, from 0")]
Gearbox = Annotated[str | None, typer.Option(help="serial number of the gearbox")]
Json = Annotated[bool, typer.Option("--json", help="one JSON document on stdout")]
Payload = Annotated[float | None, typer.Option(help="inertia carried by the output [kg m2]")]
Period = Annotated[float | None, typer.Option(help="one full cycle of the motion [s]")]
Processes = Annotated[int, typer.Option(min=1, help="at once")]
Speed = Annotated[float | None, typer.Option(help="largest speed of the output [rad/s]")]
Steady = Annotated[bool | None, typer.Option("--steady", help="the axis turns at constant speed")]
CORES = os.cpu_count() or 1


def settings() -> Settings:
    """The settings of this installation."""
    from app.settings import settings_of

    return settings_of(DATA_DIR.get())


@contextmanager
def library(*, look: bool = False) -> Iterator[CaseLibrary]:
    """The local library, made where needed; nothing is made or changed where it is only looked at."""
    from casebase.library import CaseLibrary

    opened = CaseLibrary.open(settings().data_dir, settings().database_url, look=look)
    try:
        yield opened
    finally:
        opened.close()


def axis_of(given: str) -> Axis:
    """Return the axis that a file describes, or the stored one of this name.

    Raises:
        NotFoundError: if it is neither; says which are stored.
    """
    described = _in_file(given)
    if described is not None:
        return described
    from casebase.axes import find_axis, unknown_axis
    from casebase.errors import NotFoundError
    from sim.description.axis_document import read_axis

    with library() as opened, opened.reading() as session:
        row = find_axis(session, given)
        if row is None:
            raise NotFoundError(f"--axis: there is no file {given}, and {unknown_axis(session, given)}")
        return read_axis(row.document)


def axis_name(given: str | None) -> str | None:
    """Return the name by which a service knows an axis: that in the file, or what was given."""
    described = _in_file(given) if given else None
    return given if described is None else described.name


def _in_file(given: str) -> Axis | None:
    from sim.description.axis_document import read_axis

    path = Path(given)
    return read_axis(path) if path.exists() and not path.is_dir() else None


def say(words: str) -> None:
    """Tell a person, on stderr."""
    WORDS.print(words, markup=False, highlight=False)


def show(*lines: str | Table) -> None:
    """Print lines and tables of the result, for people, on stdout."""
    for line in lines:
        RESULTS.print(line, markup=False, highlight=False)


def print_json(document: object) -> None:
    """Print the one JSON document of `--json` on stdout."""
    typer.echo(dumps(finite(document), ensure_ascii=False, allow_nan=False, indent=1))


def answer(json: bool, document: object, *lines: str | Table) -> None:
    """Print a result: as a document, or as lines and tables for people."""
    if json:
        print_json(document)
    else:
        show(*lines)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]], title: str | None = None) -> Table:
    """Return rows of a result under the names of their columns."""
    made = Table(*columns, title=title)
    for row in rows:
        made.add_row(*row)
    return made


def progress() -> Progress:
    """A progress bar on stderr, where that is a terminal."""
    return Progress(console=WORDS, transient=True, disable=not WORDS.is_terminal)
