"""`gearcase watch FOLDER`: send each finished new recording of a folder to a service, once."""

from pathlib import Path
from typing import Annotated

import typer

from app.commands.axis import METAVAR, NAMED, axis_name
from app.commands.exit_codes import DONE
from app.commands.frame import Frame, Steady, frame_of
from app.process import stop_on_signals
from app.recordings.metadata import RecordingMetadata
from app.recordings.remote import RefusedError, Remote, UnreachableError
from app.recordings.watch_folder import MEMORY, SETTLED_S, Candidate, Memory, WatchFolder
from app.report.words import verdict_of

EVERY_S, LONGEST_S = 1.0, 60.0
Service = Annotated[str, typer.Option(envvar="GEARCASE_URL", help="address of the service; its key is in GEARCASE_KEY")]


def register(app: typer.Typer) -> None:
    app.command("watch")(watch)


def watch(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(exists=True, file_okay=False, help="where recordings are written")],
    url: Service = "http://127.0.0.1:8000",
    axis: Annotated[str | None, typer.Option(metavar=METAVAR, help=NAMED)] = None,
    gearbox: Annotated[str | None, typer.Option(help="serial number of the gearbox")] = None,
    robot: Annotated[str | None, typer.Option(help="name or serial number of the robot")] = None,
    speed: Annotated[float | None, typer.Option(help="largest speed of the output [rad/s]")] = None,
    payload: Annotated[float | None, typer.Option(help="inertia carried by the output [kg m2]")] = None,
    steady: Steady = None,
    channel: Annotated[int | None, typer.Option(help="channel to use, from 0")] = None,
    move_to: Annotated[Path | None, typer.Option(help="folder for files that were sent; else they stay")] = None,
    memory: Annotated[Path | None, typer.Option(help=f"file that says what was sent [{MEMORY} in the folder]")] = None,
    settle: Annotated[
        float, typer.Option(min=0, help="a file that has not changed for so long is finished [s]")
    ] = SETTLED_S,
    once: Annotated[bool, typer.Option("--once", help="end when all that is there was sent")] = False,
) -> None:
    """Send each finished new recording of a folder to a service, once.

    What was sent is remembered through restarts of either side. Half-written files are waited for. While the service
    is away, recordings wait. Sub-folders are not looked at.
    """
    frame = frame_of(context)
    given = {
        "axis": axis_name(axis),
        "gearbox": gearbox,
        "robot": robot,
        "speed_rad_s": speed,
        "payload_kg_m2": payload,
        "steady": steady,
        "channel": channel,
    }
    metadata = RecordingMetadata.model_validate(given).description()
    remote = Remote.of_environment(url)
    stop = stop_on_signals()
    watched = WatchFolder(folder, Memory(memory or folder / MEMORY), settle, move_to)
    frame.say(f"watching {folder}; recordings go to {remote.url}")
    pause_s, waited_for = EVERY_S, set[str]()
    while not stop.is_set():
        try:
            for candidate in watched.look():
                _send(frame, remote, watched.memory, candidate, metadata)
                if stop.is_set():
                    break
            pause_s = EVERY_S
        except UnreachableError as error:
            frame.say(f"{error}; the next attempt is made in {pause_s:g} s")
            stop.wait(pause_s)
            pause_s = min(2 * pause_s, LONGEST_S)
            continue
        except FileNotFoundError as error:
            if not folder.exists():
                raise
            frame.say(f"{error.filename} went away before it was sent")
        for name in sorted(watched.incomplete - waited_for):
            frame.say(f"{name}: fewer bytes are there than its header says; it is sent when the rest has come")
        waited_for = set(watched.incomplete)
        if once and not watched.unsettled:
            break
        stop.wait(EVERY_S)
    raise typer.Exit(DONE)


def _send(frame: Frame, remote: Remote, memory: Memory, candidate: Candidate, metadata: dict[str, object]) -> None:
    try:
        diagnosis = remote.diagnose(candidate.path, metadata, candidate.sha256)
    except RefusedError as error:
        memory.add(candidate.sent(refused=str(error)))
        frame.print(f"{candidate.path.name}: refused: {error}")
        return
    memory.add(candidate.sent(diagnosis["id"]))
    frame.print(f"{candidate.path.name}: {verdict_of(diagnosis).headline}. {remote.page_of(diagnosis)}")
