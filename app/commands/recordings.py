"""`gearcase recordings erase | expire`: audio that is not to be kept."""

from typing import Annotated

import typer

from app.commands import frame
from app.commands.frame import ACTOR, Json
from app.documents import ErasedAnswer
from app.upkeep import erase_old
from casebase.errors import InvalidRequestError
from casebase.store.erasing import erase as erase_audio

recordings = typer.Typer(help="Erase the audio of recordings.", no_args_is_help=True)
Yes = Annotated[bool, typer.Option("--yes", help="do not ask")]
LOST = "The sound and its plots are gone for good. Features, diagnoses and cases stay. Older backups still hold it."


@recordings.command()
def erase(
    ids: Annotated[list[str], typer.Argument(metavar="ID...", help="ids of recordings")],
    yes: Yes = False,
    json: Json = False,
) -> None:
    """Erase the audio of recordings.

    All of them or none. Features, diagnoses, cases and the audit log stay.
    """
    _confirm(yes, json, f"Erase the audio of {len(ids)} recordings? {LOST}")
    with frame.library() as library, library.transaction(ACTOR) as session:
        done = [erase_audio(library, session, each) for each in ids]
    lines = []
    for one in done:
        also = sorted(set(one.recordings) - {one.id})
        lines += [f"{one.id}: erased", *(f"{other}: erased too, for it has the same file" for other in also)]
    frame.answer(json, [ErasedAnswer.model_validate(one).model_dump(mode="json") for one in done], *lines)
    for other in () if json else (other for one in done for other in one.same_sound):
        frame.say(f"{other} is of the same sound in another file; its audio is still here")


@recordings.command()
def expire(
    days: Annotated[
        int | None, typer.Option(min=1, help="how long audio is kept [GEARCASE_RETAIN_AUDIO_DAYS]", show_default=False)
    ] = None,
    yes: Yes = False,
    json: Json = False,
) -> None:
    """Erase old audio.

    That is the audio of recordings that are no cases and are older than so many days.
    """
    days = days or frame.settings().retain_audio_days
    if days is None:
        raise InvalidRequestError("say how long audio is kept: --days N, or set GEARCASE_RETAIN_AUDIO_DAYS")
    _confirm(yes, json, f"Erase the audio of all recordings that are no cases and older than {days} days? {LOST}")
    with frame.library() as library:
        gone = erase_old(library, days, ACTOR)
    frame.answer(json, {"days": days, "erased": gone}, f"{len(gone)} recordings erased")


def _confirm(yes: bool, json: bool, question: str) -> None:
    if yes:
        return
    if json:
        raise InvalidRequestError("with --json nobody is asked: add --yes if you are sure")
    typer.confirm(question, abort=True, err=True)
