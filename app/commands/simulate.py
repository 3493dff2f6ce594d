"""`gearcase simulate`: one simulated run of an axis, its telemetry and its sound."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import soundfile
import typer
from numpy.typing import NDArray

from app.commands.axis import MEANT, METAVAR, axis_of
from app.commands.frame import Frame, frame_of
from app.simulation_plot import plot_measurement
from casebase.signals.telemetry import Telemetry
from sim.acoustics.microphone import SAMPLE_RATE_HZ
from sim.description.axis import Axis
from sim.description.axis_document import write_axis
from sim.errors import ParameterError, near_match
from sim.experiment.virtual_measurement import Measurement, measure
from sim.mechanisms import MECHANISMS
from sim.mechanisms.catalogue import with_mechanism

DECIMALS = 9


@dataclass
class Wanted:
    """A mechanism as the command line says it: a name, and the settings that follow it."""

    name: str
    location: str | None
    values: dict[str, float]


def register(app: typer.Typer) -> None:
    app.command("simulate")(simulate)


def simulate(
    context: typer.Context,
    out: Annotated[Path, typer.Option(metavar="DIR", help="where telemetry.csv and sound.wav are written")],
    axis: Annotated[str, typer.Option(metavar=METAVAR, help=MEANT)],
    mechanism: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[@LOCATION]", help="a mechanism that is added to the axis; may be repeated"),
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="[NAME.]PARAM=VALUE", help="a parameter of a mechanism")
    ] = None,
    duration: Annotated[float, typer.Option(metavar="S", help="how long [s]")] = 30.0,
    seed: Annotated[int, typer.Option(help="of all noise: the same seed gives the same files")] = 0,
    parquet: Annotated[bool, typer.Option("--parquet", help="telemetry.parquet instead of telemetry.csv")] = False,
    plot: Annotated[bool, typer.Option("--plot", help="also run.png and run.svg")] = False,
    json: Annotated[bool, typer.Option("--json", help="one JSON document on stdout")] = False,
) -> None:
    """Simulate an axis along its motion; write its telemetry at 2 kHz and its sound at 8 kHz."""
    frame = frame_of(context)
    wanted = read_mechanisms(mechanism or [], settings or [])
    described = axis_of(frame, axis)
    for one in wanted:
        described = with_mechanism(described, MECHANISMS[one.name](one.location, one.values))
    result = _watched(frame, duration, lambda watch: measure(described, duration, seed, watch=watch))
    files = write(result, described, out, parquet=parquet)
    if plot:
        files += plot_measurement(result, described, out)
    document = summary(result, described, files)
    if json:
        frame.print_json(document)
    else:
        _show(frame, document)


def read_mechanisms(names: list[str], settings: list[str]) -> list[Wanted]:
    """Pair mechanisms with their settings: `PARAM=VALUE` belongs to the last mechanism that knows PARAM.

    Raises ParameterError for a name or a setting that no mechanism knows, or that is no number.
    """
    wanted = []
    for text in names:
        name, _, location = text.partition("@")
        if name not in MECHANISMS:
            raise ParameterError(f"--mechanism: no mechanism {name!r}{near_match(name, MECHANISMS)}")
        wanted.append(Wanted(name, location or None, {}))
    for text in settings:
        key, equals, value = text.partition("=")
        if not equals:
            raise ParameterError(f"--set: must be PARAM=VALUE, got {text!r}")
        _set(wanted, key.strip(), value.strip())
    return wanted


def _set(wanted: list[Wanted], key: str, value: str) -> None:
    owner, dot, parameter = key.rpartition(".")
    known = ["location"]
    for one in reversed(wanted):
        parameters = [each.name for each in MECHANISMS[one.name].parameters]
        known += parameters
        if (dot and owner != one.name) or parameter not in (*parameters, "location"):
            continue
        if parameter == "location" and one.location is None:
            one.location = value
            return
        if parameter != "location" and parameter not in one.values:
            one.values[parameter] = _number(key, value)
            return
    if not wanted:
        raise ParameterError(f"--set {key}: needs a --mechanism that it is a parameter of")
    missing = "no --mechanism given here has this parameter, or it was set twice"
    raise ParameterError(f"--set {key}: {missing}{near_match(parameter, known)}")


def _number(key: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ParameterError(f"--set {key}: must be a number, got {value!r}") from None


def _watched(frame: Frame, duration: float, run: Callable[[NDArray[np.float64]], Measurement]) -> Measurement:
    """Run in a thread and show how far it is; the compiled engine works without the interpreter's lock."""
    watch = np.zeros(5)
    done: dict[str, Any] = {}

    def work() -> None:
        try:
            done["result"] = run(watch)
        except Exception as error:  # noqa: BLE001 - raised again below, in the thread that called
            done["error"] = error

    thread = threading.Thread(target=work)
    with frame.progress() as progress:
        task = progress.add_task(f"simulating {duration:g} s", total=1.0)
        thread.start()
        while thread.is_alive():
            progress.update(task, completed=float(watch[4]))
            thread.join(0.1)
    if "error" in done:
        raise done["error"]
    measured: Measurement = done["result"]
    return measured


def write(result: Measurement, axis: Axis, out: Path, *, parquet: bool = False) -> list[Path]:
    """Write axis.toml, telemetry.csv or .parquet and sound.wav (16 bits) into a directory that is made where needed."""
    out.mkdir(parents=True, exist_ok=True)
    files = [out / "axis.toml", out / ("telemetry.parquet" if parquet else "telemetry.csv"), out / "sound.wav"]
    files[0].write_text(write_axis(axis), encoding="utf-8")
    write_telemetry(result.telemetry, files[1])
    write_sound(result.sound, files[2])
    return files


def write_sound(sound: NDArray[np.float32], path: Path) -> None:
    """A WAV file of 16 bits."""
    soundfile.write(path, sound, int(SAMPLE_RATE_HZ), subtype="PCM_16")


def write_telemetry(telemetry: Telemetry, path: Path) -> None:
    """One row per sample, columns in SI units by the names of `casebase.signals.telemetry.CHANNELS`.

    Parquet where the name ends so, else CSV.
    """
    import pyarrow as pa

    columns = {"time_s": telemetry.time_s, **telemetry.channels}
    table = pa.table({name: np.round(values, DECIMALS) for name, values in columns.items()})
    if path.suffix == ".parquet":
        from pyarrow import parquet

        parquet.write_table(table, path)
        return
    from pyarrow import csv

    csv.write_csv(table, path, csv.WriteOptions(quoting_style="none", quoting_header="none"))


def summary(result: Measurement, axis: Axis, files: list[Path]) -> dict[str, Any]:
    """What was simulated, in numbers."""
    contacts: dict[str, int] = {}
    for event in result.trajectory.events:
        contacts[event.component] = contacts.get(event.component, 0) + 1
    torque = result.telemetry["motor_torque_nm"]
    return {
        "axis": axis.name,
        "mechanisms": axis.to_mapping().get("mechanisms", []),
        "engine": result.trajectory.engine,
        "duration_s": float(result.trajectory.time_s[-1]),
        "events": contacts,
        "motor_torque_nm": {"rms": float(np.sqrt(np.mean(torque**2))), "largest": float(np.abs(torque).max())},
        "sound": {"rms": float(np.std(result.sound)), "largest": float(np.abs(result.sound).max())},
        "files": [str(path) for path in files],
    }


def _show(frame: Frame, document: dict[str, Any]) -> None:
    effects = ", ".join(str(entry["name"]) for entry in document["mechanisms"]) or "no added mechanism"
    frame.print(f"{document['axis']}: {document['duration_s']:g} s with {effects} ({document['engine']})")
    torque, sound = document["motor_torque_nm"], document["sound"]
    frame.print(f"motor torque: rms {torque['rms']:.3g} N m, largest {torque['largest']:.3g} N m")
    frame.print(f"sound: rms {sound['rms']:.3g}, largest {sound['largest']:.3g} of full scale")
    for path in document["files"]:
        frame.print(path)
