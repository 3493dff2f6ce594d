"""`gearcase simulate`: one simulated run, of an axis with its telemetry and its sound, or of any drive train.

What a run needs is imported when it is run: help and refusals come at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
import typer
from numpy.typing import NDArray

from app.commands import frame
from app.commands.frame import AXIS, Json
from signals.reading.plain_file import plain_bytes
from sim.errors import ParameterError, near_match

if TYPE_CHECKING:
    from signals.telemetry import Telemetry
    from sim.rotational.trajectory import Trajectory

RATE_HZ = 8000.0
SOUND_RATE_HZ = 8000
DECIMALS = 9
Result = TypeVar("Result")


@dataclass
class Wanted:
    """A mechanism as the command line says it: a name, and the settings that follow it."""

    name: str
    location: str | None
    values: dict[str, float]


def simulate(
    out: Annotated[Path, typer.Option(metavar="DIR", help="where the results are written")],
    axis: Annotated[str | None, AXIS] = None,
    train: Annotated[
        Path | None, typer.Option(metavar="TRAIN.toml", help="instead: components and connections by Modelica's names")
    ] = None,
    mechanism: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[@LOCATION]", help="a mechanism that is added to the axis; may be repeated"),
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="[NAME.]PARAM=VALUE", help="a parameter of a mechanism")
    ] = None,
    duration: Annotated[float, typer.Option(metavar="S", help="how long [s]")] = 30.0,
    seed: Annotated[int, typer.Option(help="of all noise of an axis: the same seed gives the same files")] = 0,
    rate: Annotated[float, typer.Option(metavar="HZ", help="samples per second of a train's result")] = RATE_HZ,
    parquet: Annotated[bool, typer.Option("--parquet", help="a Parquet file instead of CSV")] = False,
    json: Json = False,
) -> None:
    """Simulate an axis along its motion, its telemetry at 2 kHz and its sound at 8 kHz; or any drive train."""
    if (axis is None) == (train is None):
        raise ParameterError("give --axis or --train, one of them")
    if train is not None and (mechanism or settings):
        raise ParameterError("--mechanism and --set go with --axis")
    ending = "parquet" if parquet else "csv"
    if axis is not None:
        wanted = read_mechanisms(mechanism or [], settings or [])
        names = ("axis.toml", f"telemetry.{ending}", "sound.wav")
        document, lines = simulate_axis(axis, wanted, seed, duration, [out / name for name in names])
    else:
        assert train is not None
        names = ("train.toml", f"result.{ending}", "events.csv")
        document, lines = simulate_train(train, rate, duration, [out / name for name in names])
    frame.answer(json, document, *lines, *document["files"])


def watched(duration: float, run: Callable[[NDArray[np.float64]], Result]) -> Result:
    """Run in a thread and show how far it is; the compiled engine works without the interpreter's lock."""
    watch = np.zeros(1)
    with frame.progress() as progress, ThreadPoolExecutor(1) as beside:
        task = progress.add_task(f"simulating {duration:g} s", total=1.0)
        running = beside.submit(run, watch)
        while wait([running], timeout=0.1).not_done:
            progress.update(task, completed=float(watch[0]))
    return running.result()


def simulate_axis(
    given: str, wanted: list[Wanted], seed: int, duration: float, files: list[Path]
) -> tuple[dict[str, Any], list[str]]:
    """Simulate an axis and write its description, telemetry and sound; return what was simulated, and in words."""
    import soundfile

    from sim.description.axis_document import write_axis
    from sim.experiment.virtual_measurement import heard, moved, recorded
    from sim.mechanisms import MECHANISMS
    from sim.mechanisms.catalogue import with_mechanism

    described = frame.axis_of(given)
    for one in wanted:
        described = with_mechanism(described, MECHANISMS[one.name](one.location, one.values))
    trajectory = watched(duration, lambda watch: moved(described, duration, watch))
    files[0].parent.mkdir(parents=True, exist_ok=True)
    telemetry = recorded(trajectory, described, seed)
    with ThreadPoolExecutor(1) as beside:
        table = beside.submit(write_telemetry, telemetry, files[1])
        sound = heard(trajectory, described, seed)
        soundfile.write(files[2], sound, SOUND_RATE_HZ, subtype="PCM_16")
        table.result()
    files[0].write_text(write_axis(described), encoding="utf-8")
    torque = telemetry["motor_torque_nm"]
    moments = {"rms": float(np.sqrt(np.mean(torque**2))), "largest": float(np.abs(torque).max())}
    loudness = {"rms": float(np.std(sound)), "largest": float(np.abs(sound).max())}
    mechanisms: Any = described.to_mapping().get("mechanisms", [])
    document: dict[str, Any] = {
        "axis": described.name,
        "mechanisms": mechanisms,
        **_about(trajectory, files),
        "motor_torque_nm": moments,
        "sound": loudness,
    }
    effects = ", ".join(str(entry["name"]) for entry in mechanisms) or "no added mechanism"
    return document, [
        f"{described.name}: {document['duration_s']:g} s with {effects} ({trajectory.engine})",
        f"motor torque: rms {moments['rms']:.3g} N m, largest {moments['largest']:.3g} N m",
        f"sound: rms {loudness['rms']:.3g}, largest {loudness['largest']:.3g} of full scale",
    ]


def simulate_train(path: Path, rate: float, duration: float, files: list[Path]) -> tuple[dict[str, Any], list[str]]:
    """Simulate a drive train, write it, its channels and events; return what was simulated, and in words."""
    from sim.rotational.train_document import read_train
    from sim.solver import simulate as simulate_any

    text = plain_bytes(path)
    train = read_train(text)
    result = watched(duration, lambda watch: simulate_any(train, duration, rate, watch=watch))
    files[0].parent.mkdir(parents=True, exist_ok=True)
    files[0].write_bytes(text)
    write_table({"time_s": result.time_s, **result.channels}, files[1])
    rows = (f"{event.time_s!r},{event.component},{event.from_name},{event.to_name}\n" for event in result.events)
    files[2].write_text("time_s,component,from,to\n" + "".join(rows), encoding="utf-8")
    channels = {
        name: {"unit": result.units[name], "smallest": float(values.min()), "largest": float(values.max())}
        for name, values in result.channels.items()
    }
    document: dict[str, Any] = {
        "train": str(path),
        "sample_rate_hz": rate,
        "channels": channels,
        **_about(result, files),
    }
    events = ", ".join(f"{name} {count}" for name, count in document["events"].items()) or "none"
    return document, [
        f"{path}: {document['duration_s']:g} s of {len(channels)} channels ({result.engine})",
        f"changes of mode: {events}",
    ]


def _about(run: Trajectory, files: list[Path]) -> dict[str, Any]:
    """What every run has; `events`: how many changes of mode each component had."""
    return {
        "engine": run.engine,
        "duration_s": float(run.time_s[-1]),
        "events": dict(Counter(event.component for event in run.events)),
        "files": [str(path) for path in files],
    }


def read_mechanisms(names: list[str], settings: list[str]) -> list[Wanted]:
    """Pair mechanisms with their settings: `PARAM=VALUE` belongs to the last mechanism that knows PARAM.

    Raises ParameterError for a name or a setting that no mechanism knows, or that is no number.
    """
    from sim.mechanisms import MECHANISMS

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
    from sim.mechanisms import MECHANISMS

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


def write_table(columns: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    """Columns of equal length, every digit: Parquet where the name ends so, else CSV."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    table = pa.table(dict(columns))
    if path.suffix == ".parquet":
        parquet.write_table(table, path, use_dictionary=False)  # of numbers that hardly repeat
    else:
        csv.write_csv(table, path, csv.WriteOptions(quoting_style="none", quoting_header="none"))


def write_telemetry(telemetry: Telemetry, path: Path) -> None:
    """One row per sample, columns in SI units by the names of `signals.telemetry.CHANNELS`, to nine decimals."""
    columns = {"time_s": telemetry.time_s, **telemetry.channels}
    write_table({name: np.round(values, DECIMALS) + 0.0 for name, values in columns.items()}, path)  # no -0
