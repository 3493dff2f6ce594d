"""`gearcase record` and `watch`: recordings of a microphone, or of a folder, are sent to a service."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from app.commands import BAD_INPUT, DONE, frame
from app.commands.frame import Channel, Gearbox, NamedAxis, Payload, Speed, Steady
from app.logs import stop_on_signals
from app.recordings import microphone
from app.recordings.intake import RecordingMetadata, read_sound
from app.recordings.remote import RefusedError, Remote, UnreachableError
from app.recordings.watch_folder import MEMORY, SETTLED_S, Memory, Sent, WatchFolder
from app.report.words import verdict_of
from signals.features import extract
from signals.recording_quality.quality import FlagLevel

EVERY_S, LONGEST_S, LONGEST_ONCE_S = 1.0, 60.0, 8.0
"""How long it waits between two looks, and where the service is away; with --once it gives up after the last."""
Service = Annotated[str, typer.Option(envvar="GEARCASE_URL", help="address of the service; its key is in GEARCASE_KEY")]


def record(
    out: Annotated[Path | None, typer.Option(help="WAV file to write; named by the time if not given")] = None,
    seconds: Annotated[float, typer.Option(min=0.5, max=600, help="how long [s]; Ctrl-C ends it sooner")] = 20.0,
    device: Annotated[str | None, typer.Option(help="name or number of the microphone")] = None,
    rate: Annotated[int, typer.Option(min=8000, max=192_000, help="samples per second [Hz]")] = 48_000,
    list_: Annotated[bool, typer.Option("--list", help="name the microphones and end")] = False,
    send: Annotated[bool, typer.Option("--send", help="send it to the service if the check finds nothing")] = False,
    anyway: Annotated[bool, typer.Option("--anyway", help="send it whatever the check finds")] = False,
    url: Service = "http://127.0.0.1:8000",
    axis: NamedAxis = None,
    gearbox: Gearbox = None,
    speed: Speed = None,
    payload: Payload = None,
    steady: Steady = None,
) -> None:
    """Record with a microphone, check the recording, send it.

    A level says where to hold the microphone. What weakens the recording is said before it is sent; a poor one is
    sent only with --anyway.
    """
    if list_:
        frame.show(*microphone.listed())
        raise typer.Exit(DONE)
    remote = Remote.of_environment(url) if send or anyway else None
    begun = datetime.now().astimezone()
    target = out or Path(f"recording {begun:%Y-%m-%d %H-%M-%S}.wav")
    given = {
        "axis": frame.axis_name(axis),
        "gearbox": gearbox,
        "speed_rad_s": speed,
        "payload_kg_m2": payload,
        "steady": steady,
    }
    metadata = RecordingMetadata.model_validate({**given, "recorded_at": begun.isoformat(timespec="seconds")})
    _record(target, device, rate, seconds)
    found = extract(read_sound(target), metadata.condition()).quality
    for flag in found:
        frame.say(f"{flag.severity}, {flag.name.replace('_', ' ')}: {flag.reason}")
    poor = any(flag.severity is not FlagLevel.NOTE for flag in found)
    frame.say("The check: record again, as said above." if poor else "The check: the recording can be diagnosed.")
    frame.show(str(target))
    if remote is None:
        raise typer.Exit(BAD_INPUT if poor else DONE)
    if poor and not anyway:
        frame.say("It was not sent; --anyway sends it nevertheless.")
        raise typer.Exit(BAD_INPUT)
    diagnosis = remote.diagnose(target, metadata.description())
    frame.show(f"{verdict_of(diagnosis).headline}. {remote.page_of(diagnosis)}")


def _record(target: Path, device: str | None, rate_hz: int, seconds: float) -> None:
    number = int(device) if device is not None and device.isdigit() else device
    stop = stop_on_signals()
    with microphone.opened(number, rate_hz) as blocks, frame.progress() as progress:
        frame.say(f"recording {seconds:g} s: hold the microphone to the gearbox while the axis moves")
        task = progress.add_task("", total=seconds)

        def tell(done_s: float, level: microphone.Level) -> None:
            words = f"{level.rms_dbfs:.0f} dB of full scale. {level.advice}"
            progress.update(task, completed=done_s, description=words)

        took_s = microphone.record(blocks, target, rate_hz, seconds, stop, tell)
    frame.say(f"{target}: {took_s:.1f} s")


def watch(
    folder: Annotated[Path, typer.Argument(exists=True, file_okay=False, help="where recordings are written")],
    url: Service = "http://127.0.0.1:8000",
    axis: NamedAxis = None,
    gearbox: Gearbox = None,
    robot: Annotated[str | None, typer.Option(help="name or serial number of the robot")] = None,
    speed: Speed = None,
    payload: Payload = None,
    steady: Steady = None,
    channel: Channel = None,
    move_to: Annotated[Path | None, typer.Option(help="folder for files that were sent; else they stay")] = None,
    memory: Annotated[Path | None, typer.Option(help=f"file that says what was sent [{MEMORY} in the folder]")] = None,
    settle: Annotated[
        float, typer.Option(min=0, help="a file that has not changed for so long is finished [s]")
    ] = SETTLED_S,
    once: Annotated[bool, typer.Option("--once", help="end when all that is there was sent")] = False,
) -> None:
    """Send each finished new recording of a folder to a service, once.

    What was sent is remembered through restarts of either side. Half-written files are waited for. While the service
    is away, recordings wait; with --once it is tried for some seconds, and the exit code is 1 if it stays away and 2
    if it refused a recording. Sub-folders are not looked at.
    """
    given = {
        "axis": frame.axis_name(axis),
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
    pause_s, waited_for, code = EVERY_S, set[str](), DONE
    while not stop.is_set():
        try:
            for path, found in watched.look():
                sent = _sent(remote, path, found, metadata)
                watched.memory.add(sent)
                code = BAD_INPUT if sent.refused else code
                if stop.is_set():
                    break
            pause_s = EVERY_S
        except UnreachableError as error:
            if once and pause_s > LONGEST_ONCE_S:
                raise UnreachableError(f"{error}; what was not sent waits for the next time") from None
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
    raise typer.Exit(code if once else DONE)


def _sent(remote: Remote, path: Path, found: Sent, metadata: dict[str, object]) -> Sent:
    """Send a recording, say what was answered, and return what to remember."""
    try:
        diagnosis = remote.diagnose(path, metadata, found.sha256)
    except RefusedError as error:
        frame.show(f"{path.name}: refused: {error}")
        return replace(found, refused=str(error))
    frame.show(f"{path.name}: {verdict_of(diagnosis).headline}. {remote.page_of(diagnosis)}")
    return replace(found, diagnosis_id=diagnosis["id"])
