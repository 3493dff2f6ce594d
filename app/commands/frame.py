"""What every verb has: the installation's settings, words for people on stderr, results on stdout.

The library is imported where it is opened: a verb that needs none starts in three quarters of the time.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from app.http.finite import finite

if TYPE_CHECKING:
    from app.settings import Settings
    from casebase.library import CaseLibrary

ACTOR = "command line"


@dataclass(frozen=True)
class Frame:
    """The command line of one installation."""

    data_dir: Path | None
    words: Console = field(default_factory=lambda: Console(stderr=True, soft_wrap=True))
    results: Console = field(default_factory=lambda: Console(soft_wrap=True))

    @cached_property
    def settings(self) -> Settings:
        from app.settings import settings_of

        return settings_of(self.data_dir)

    def say(self, words: str) -> None:
        """Tell a person, on stderr."""
        self.words.print(words, markup=False, highlight=False)

    def print(self, words: str) -> None:
        """Print a line of the result, for people, on stdout."""
        self.results.print(words, markup=False, highlight=False)

    def progress(self) -> Progress:
        """A progress bar on stderr, where that is a terminal."""
        return Progress(console=self.words, transient=True, disable=not self.words.is_terminal)

    def print_json(self, document: object) -> None:
        """Print the one JSON document of `--json` on stdout."""
        typer.echo(json.dumps(finite(document), ensure_ascii=False, allow_nan=False, indent=1))

    @contextmanager
    def library(self) -> Iterator[CaseLibrary]:
        """The local library, made or upgraded where needed."""
        from casebase.library import CaseLibrary

        library = CaseLibrary.open(self.settings.data_dir, self.settings.database_url)
        try:
            yield library
        finally:
            library.close()


Steady = Annotated[bool | None, typer.Option("--steady", help="the axis turns at constant speed")]
Json = Annotated[bool, typer.Option("--json", help="one JSON document on stdout")]


def frame_of(context: typer.Context) -> Frame:
    return Frame(context.obj)
