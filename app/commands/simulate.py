"""`gearcase simulate`: one simulated run, of an axis with its telemetry and its sound, or of any drive train.

What a run needs is imported when it is run: help and refusals come at once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
import typer
from numpy.typing import NDArray

from app.commands import frame
from app.commands.frame import AXIS, Json
from app.simulated.simulation_files import write_events, write_sound, write_table, write_telemetry
from sim.errors import ParameterError, near_match

if TYPE_CHECKING:
    from sim.description.axis import Axis
    from sim.experiment.virtual_measurement import Measurement
    from sim.rotational.trajectory import Trajectory

RATE_HZ = 8000.0
Result = TypeVar("Result")


@dataclass
class Wanted:
    """A mechanism as the command line says it: a name, and the settings that follow it."""

    name: str
    location: str | None
    values: dict[str, float]


@dataclass(frozen=True)
class Run:
    """What every run is told: how long [s], and where its files go."""

    duration: float
    out: Path
    parquet: bool

    @property
    def table(self) -> str:
        return "parquet" if self.parquet else "csv"

    def watched(self, run: Callable[[NDArray[np.float64]], Result]) -> Result:
        """Run in a thread and show how far it is; the compiled engine works without the interpreter's lock."""
        watch = np.zeros(1)
        with frame.progress() as progress, ThreadPoolExecutor(1) as beside:
            task = progress.add_task(f"simulating {self.duration:g} s", total=1.0)
            running = beside.submit(run, watch)
            while wait([running], timeout=0.1).not_done:
                progress.update(task, completed=float(watch[0]))
        return running.result()


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
    if train is None and axis is not None:
        run = Run(duration, out, parquet)
        document = simulate_axis(run, axis, read_mechanisms(mechanism or [], settings or []), seed)
        lines = axis_lines(document)
    elif axis is None and train is not None:
        if mechanism or settings:
            raise ParameterError("--mechanism and --set go with --axis")
        document = simulate_train(Run(duration, out, parquet), train, rate)
        lines = train_lines(document)
    else:
        raise ParameterError("give --axis or --train, one of them")
    frame.answer(json, document, *lines, *document["files"])


def simulate_axis(run: Run, given: str, wanted: list[Wanted], seed: int) -> dict[str, Any]:
    """Simulate an axis and write its files; return what was simulated, in numbers."""
    from sim.description.axis_document import write_axis
    from sim.experiment.virtual_measurement import Measurement, heard, moved, recorded
    from sim.mechanisms import MECHANISMS
    from sim.mechanisms.catalogue import with_mechanism

    described = frame.axis_of(given)
    for one in wanted:
        described = with_mechanism(described, MECHANISMS[one.name](one.location, one.values))
    trajectory = run.watched(lambda watch: moved(described, run.duration, watch))
    files = [run.out / name for name in ("axis.toml", f"telemetry.{run.table}", "sound.wav")]
    run.out.mkdir(parents=True, exist_ok=True)
    telemetry = recorded(trajectory, described, seed)
    with ThreadPoolExecutor(1) as beside:
        table = beside.submit(write_telemetry, telemetry, files[1])
        sound = heard(trajectory, described, seed)
        write_sound(sound, files[2])
        table.result()
    files[0].write_text(write_axis(described), encoding="utf-8")
    return summary(Measurement(trajectory, telemetry, sound), described, files)


def simulate_train(run: Run, path: Path, rate: float) -> dict[str, Any]:
    """Simulate a drive train and write its files; return what was simulated, in numbers."""
    from sim.rotational.train_document import read_train
    from sim.solver import simulate as simulate_any

    text = path.read_bytes()
    train = read_train(text)
    result = run.watched(lambda watch: simulate_any(train, run.duration, rate, watch=watch))
    columns = {"time_s": result.time_s, **result.channels}
    files = [run.out / name for name in ("train.toml", f"result.{run.table}", "events.csv")]
    run.out.mkdir(parents=True, exist_ok=True)
    files[0].write_bytes(text)
    write_table(columns, files[1])
    write_events(result.events, files[2])
    return {
        "train": str(path),
        "engine": result.engine,
        "duration_s": float(result.time_s[-1]),
        "sample_rate_hz": rate,
        "events": events_of(result),
        "channels": {
            name: {"unit": result.units[name], "smallest": float(values.min()), "largest": float(values.max())}
            for name, values in result.channels.items()
        },
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


def events_of(trajectory: Trajectory) -> dict[str, int]:
    """How many changes of mode each component had."""
    return dict(Counter(event.component for event in trajectory.events))


def summary(result: Measurement, axis: Axis, files: list[Path]) -> dict[str, Any]:
    """What was simulated, in numbers."""
    torque = result.telemetry["motor_torque_nm"]
    return {
        "axis": axis.name,
        "mechanisms": axis.to_mapping().get("mechanisms", []),
        "engine": result.trajectory.engine,
        "duration_s": float(result.trajectory.time_s[-1]),
        "events": events_of(result.trajectory),
        "motor_torque_nm": {"rms": float(np.sqrt(np.mean(torque**2))), "largest": float(np.abs(torque).max())},
        "sound": {"rms": float(np.std(result.sound)), "largest": float(np.abs(result.sound).max())},
        "files": [str(path) for path in files],
    }


def axis_lines(document: dict[str, Any]) -> list[str]:
    """The run of an axis for people."""
    effects = ", ".join(str(entry["name"]) for entry in document["mechanisms"]) or "no added mechanism"
    torque, sound = document["motor_torque_nm"], document["sound"]
    return [
        f"{document['axis']}: {document['duration_s']:g} s with {effects} ({document['engine']})",
        f"motor torque: rms {torque['rms']:.3g} N m, largest {torque['largest']:.3g} N m",
        f"sound: rms {sound['rms']:.3g}, largest {sound['largest']:.3g} of full scale",
    ]


def train_lines(document: dict[str, Any]) -> list[str]:
    """The run of a drive train for people."""
    events = ", ".join(f"{name} {count}" for name, count in document["events"].items()) or "none"
    length, channels = document["duration_s"], len(document["channels"])
    return [
        f"{document['train']}: {length:g} s of {channels} channels ({document['engine']})",
        f"changes of mode: {events}",
    ]
