"""`gearcase record`: record with a microphone of this machine, check what came out, send it."""

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from app.commands.axis import METAVAR, NAMED, axis_name
from app.commands.exit_codes import BAD_INPUT, DONE
from app.commands.frame import Frame, Steady, frame_of
from app.commands.watch import Service
from app.process import stop_on_signals
from app.recordings.metadata import RecordingMetadata
from app.recordings.microphone import Level, listed, opened, record
from app.recordings.remote import Remote
from app.recordings.sound import read_sound
from app.report.words import verdict_of
from signals.features import extract
from signals.recording_quality.quality import QualityFlag, Severity


def register(app: typer.Typer) -> None:
    app.command("record")(record_)


def record_(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option(help="WAV file to write; named by the time if not given")] = None,
    seconds: Annotated[float, typer.Option(min=0.5, max=600, help="how long [s]; Ctrl-C ends it sooner")] = 20.0,
    device: Annotated[str | None, typer.Option(help="name or number of the microphone")] = None,
    rate: Annotated[int, typer.Option(min=8000, max=192_000, help="samples per second [Hz]")] = 48_000,
    list_: Annotated[bool, typer.Option("--list", help="name the microphones and end")] = False,
    send: Annotated[bool, typer.Option("--send", help="send it to the service if the check finds nothing")] = False,
    anyway: Annotated[bool, typer.Option("--anyway", help="send it whatever the check finds")] = False,
    url: Service = "http://127.0.0.1:8000",
    axis: Annotated[str | None, typer.Option(metavar=METAVAR, help=NAMED)] = None,
    gearbox: Annotated[str | None, typer.Option(help="serial number of the gearbox")] = None,
    speed: Annotated[float | None, typer.Option(help="largest speed of the output [rad/s]")] = None,
    payload: Annotated[float | None, typer.Option(help="inertia carried by the output [kg m2]")] = None,
    steady: Steady = None,
) -> None:
    """Record with a microphone, check the recording, send it.

    A level says where to hold the microphone. What weakens the recording is said before it is sent; a poor one is
    sent only with --anyway.
    """
    frame = frame_of(context)
    if list_:
        for each in listed():
            frame.print(each)
        raise typer.Exit(DONE)
    remote = Remote.of_environment(url) if send or anyway else None
    begun = datetime.now().astimezone()
    target = out or Path(f"recording {begun:%Y-%m-%d %H-%M-%S}.wav")
    given = {
        "axis": axis_name(axis),
        "gearbox": gearbox,
        "speed_rad_s": speed,
        "payload_kg_m2": payload,
        "steady": steady,
    }
    metadata = RecordingMetadata.model_validate({**given, "recorded_at": begun.isoformat(timespec="seconds")})
    _record(frame, target, device, rate, seconds)
    found = extract(read_sound(target), metadata.condition()).quality
    for flag in found:
        frame.say(f"{flag.severity}, {flag.name.replace('_', ' ')}: {flag.reason}")
    poor = _is_poor(found)
    frame.say("The check: record again, as said above." if poor else "The check: the recording can be diagnosed.")
    frame.print(str(target))
    if remote is None:
        raise typer.Exit(BAD_INPUT if poor else DONE)
    if poor and not anyway:
        frame.say("It was not sent; --anyway sends it nevertheless.")
        raise typer.Exit(BAD_INPUT)
    diagnosis = remote.diagnose(target, metadata.description())
    frame.print(f"{verdict_of(diagnosis).headline}. {remote.page_of(diagnosis)}")


def _record(frame: Frame, target: Path, device: str | None, rate_hz: int, seconds: float) -> None:
    number = int(device) if device is not None and device.isdigit() else device
    stop = stop_on_signals()
    with opened(number, rate_hz) as blocks, frame.progress() as progress:
        frame.say(f"recording {seconds:g} s: hold the microphone to the gearbox while the axis moves")
        task = progress.add_task("", total=seconds)

        def tell(done_s: float, level: Level) -> None:
            words = f"{level.rms_dbfs:.0f} dB of full scale. {level.advice}"
            progress.update(task, completed=done_s, description=words)

        took_s = record(blocks, target, rate_hz, seconds, stop, tell)
    frame.say(f"{target}: {took_s:.1f} s")


def _is_poor(flags: tuple[QualityFlag, ...]) -> bool:
    return any(flag.severity is not Severity.NOTE for flag in flags)
