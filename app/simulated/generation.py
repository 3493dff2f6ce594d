"""Cases by simulation: plan, simulate, take features, retain. The only place where simulator and library meet.

A case is known by its key, a hash of everything that determines its samples: whatever is generated twice, by a
repeated command or by a worker that takes over from a dead one, is one case.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import signal
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, field
from itertools import islice
from multiprocessing import get_context, parent_process
from threading import Thread
from typing import Any, Literal, TypeVar, cast

import numpy as np
import soundfile
from numpy.typing import NDArray
from sqlalchemy import select
from sqlalchemy.exc import IntegrityError

from app.jobs.job import JobKind, Json, Report
from app.recordings.intake import condition_on
from casebase.description import Labelling, RecordingDescription
from casebase.library import CaseLibrary
from casebase.origins import SIMULATED
from casebase.review import quarantine_far
from casebase.store.artifacts import active_artifact
from casebase.store.models import Case
from signals.condition import OperatingCondition
from signals.features import Extraction, extract
from signals.recording import Recording
from sim.acoustics.audibility import perform_fault
from sim.acoustics.microphone import SAMPLE_RATE_HZ, Microphone, microphone_of
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.errors import ParameterError
from sim.experiment.design_of_experiments import DURATION_S, Planned, Range, around, plan
from sim.experiment.scenario import MODEL_VERSION, Scenario
from sim.mechanisms import MECHANISMS

Task = TypeVar("Task")
Done = TypeVar("Done")
KIND = "simulations"
ACTOR = "generator"
MOST_CASES = 100_000
SECONDS_PER_TASK = 160.0  # of simulated sound: 2 to 6 s of work on one core


@dataclass(frozen=True)
class Campaign:
    """What is to be generated.

    Parameters
    ----------
    axis
        Whose gearbox is heard.
    counts
        Cases per label.
    microphones
        Paths fitted to the place; without any, housings are drawn from all that is usual.
    sound_version
        Version of the artifact that the microphones come from.
    payload_kg_m2, speed_rad_s
        From where to where; around the axis's own where None.
    motion
        Stroke, acceleration time and rest: around what the description says of them, or any.
    """

    axis: Axis
    counts: Mapping[str, int]
    seed: int = 0
    duration_s: float = DURATION_S
    microphones: tuple[Microphone, ...] = ()
    sound_version: int | None = None
    payload_kg_m2: tuple[float, float] | None = None
    speed_rad_s: tuple[float, float] | None = None
    motion: Literal["described", "any"] = "described"

    def __post_init__(self) -> None:
        for name in ("payload_kg_m2", "speed_rad_s"):
            ends = getattr(self, name)
            if ends is not None and not 0 < ends[0] <= ends[1] < math.inf:
                raise ParameterError(f"{name}: needs two numbers above 0, the smaller first, got {list(ends)}")
        total = sum(self.counts.values())
        if not (0 < total <= MOST_CASES and min(self.counts.values()) >= 0):
            raise ParameterError(f"counts: 1 to {MOST_CASES} cases can be generated at a time, got {dict(self.counts)}")
        if not 1.0 <= self.duration_s <= 120.0:
            raise ParameterError(f"duration_s: must be 1 to 120 s, got {self.duration_s}")
        plan(self.axis, dict.fromkeys(self.counts, 1), self.seed)

    def to_document(self) -> dict[str, Json]:
        """As JSON, for a job."""
        microphones = [asdict(each) for each in self.microphones]
        parts = {**vars(self), "axis": self.axis.to_mapping(), "counts": dict(self.counts), "microphones": microphones}
        document: dict[str, Json] = json.loads(json.dumps(parts))
        return document

    @classmethod
    def from_document(cls, document: Json) -> Campaign:
        """Read it back. Raises SimulationError where it is wrong."""
        known: dict[str, Any] = dict(cast(dict[str, Json], document))
        known["axis"] = read_axis(known["axis"])
        known["microphones"] = tuple(microphone_of(each) for each in known["microphones"])
        for name in ("payload_kg_m2", "speed_rad_s"):
            known[name] = tuple(known[name]) if known.get(name) else None
        return cls(**known)

    def planned(self, only: range | None = None) -> list[Planned]:
        """All cases, label by label, or some of them by number."""
        return plan(
            self.axis,
            self.counts,
            self.seed,
            microphones=self.microphones,
            duration_s=self.duration_s,
            operation=self._operation(),
            only=only,
        )

    def _operation(self) -> list[Range]:
        given = {
            "payload_factor": (self.payload_kg_m2, self.axis.load.inertia_kg_m2),
            "speed_factor": (self.speed_rad_s, self.axis.motion.load_speed_rad_s),
        }
        ranges = [Range(name, ends[0] / own, ends[1] / own) for name, (ends, own) in given.items() if ends is not None]
        return [*ranges, *(around(self.axis) if self.motion == "described" else ())]

    def batches(self) -> list[range]:
        """The cases by number, cut into tasks."""
        size = max(1, round(SECONDS_PER_TASK / self.duration_s))
        total = sum(self.counts.values())
        return [range(first, min(first + size, total)) for first in range(0, total, size)]


@dataclass(frozen=True, eq=False)
class Generated:
    """A simulated case before it is retained: as planned, and as it was performed so that its fault is heard.

    `audibility` is the fault's part of the sound over the rest (see `sim.acoustics.audibility`), None without fault.
    """

    planned: Planned
    key: str
    scenario: Scenario
    audibility: float | None
    audio: bytes = field(repr=False)
    recording: Recording
    extraction: Extraction


@dataclass(frozen=True)
class Outcome:
    """What a batch brought: new cases, known ones, and what simulation and features took of the processor [s]."""

    new: int
    known: int
    simulation_s: float = 0.0


def key_of(scenario: Scenario) -> str:
    """The case key: SHA-256 of the scenario and the version of the model."""
    document = {"model": MODEL_VERSION, **scenario.to_mapping()}
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def simulate_case(planned: Planned) -> Generated:
    """Simulate one case and take its features from what a WAV file of 16 bit keeps of it."""
    scenario, ratio = planned.scenario, None
    if planned.mechanism is None or MECHANISMS[planned.mechanism.name].kind == "measurement":
        sound = scenario.perform()
    else:
        heard = perform_fault(scenario)
        scenario, ratio, sound = heard.scenario, heard.ratio, heard.sound
    scenario, sound = scenario.with_head_room(sound)
    audio = wav(sound)
    samples, rate = soundfile.read(io.BytesIO(audio), dtype="float32")
    recording = Recording(samples, float(rate))
    extraction = extract(recording, condition_of(scenario))
    return Generated(planned, key_of(planned.scenario), scenario, ratio, audio, recording, extraction)


def condition_of(scenario: Scenario) -> OperatingCondition:
    """What a measurement would know of how the recording was taken: speed and payload, not the motion."""
    axis = scenario.axis
    return condition_on(axis, speed_rad_s=axis.motion.load_speed_rad_s, payload_kg_m2=scenario.payload_kg_m2)


def retain(library: CaseLibrary, generated: Sequence[Generated], batch: str) -> None:
    """Keep cases in one transaction, all or none."""
    with library.transaction(ACTOR) as session:
        for case in generated:
            scenario, entry = case.scenario, case.planned.mechanism
            size = {} if entry is None else {**entry.parameters, "audibility": case.audibility}
            description = RecordingDescription(
                file_name=f"{case.planned.label}-{case.key[:12]}.wav",
                axis=scenario.axis.name,
                gearbox=f"{SIMULATED}-{scenario.specimen.seed}",
                condition=condition_of(scenario),
                extra={"simulated": True},
            )
            row = library.retain.recording(session, case.audio, case.recording, case.extraction, description)
            labelling = Labelling(
                label=case.planned.label,
                origin="simulated",
                mechanism=None if entry is None else entry.name,
                location=None if entry is None else entry.location,
                severity=case.planned.size,
                parameters={**size, "scenario": scenario.to_mapping()},
                model_version=MODEL_VERSION,
                verified_by="simulation",
                key=case.key,
                batch=batch,
            )
            library.retain.case(session, row, labelling)


def missing(library: CaseLibrary, planned: Sequence[Planned]) -> list[Planned]:
    """Those that the library does not have yet."""
    keys = [key_of(each.scenario) for each in planned]
    with library.reading() as session:
        known = set(session.scalars(select(Case.key).where(Case.key.in_(keys))))
    return [each for each, key in zip(planned, keys, strict=True) if key not in known]


def generate(
    library: CaseLibrary, campaign: Campaign, *, processes: int, batch: str, advance: Callable[[int], None]
) -> Outcome:
    """Generate a campaign on several processes of this machine; `advance` is told of every case done."""
    planned = campaign.planned()
    wanted = missing(library, planned)
    advance(len(planned) - len(wanted))
    size = max(1, round(SECONDS_PER_TASK / campaign.duration_s / 4))
    with closing(in_parallel(simulate_case, wanted, processes, size)) as generated:
        while group := list(islice(generated, size)):
            retain(library, group, batch)
            advance(len(group))
    quarantine_far(library, ACTOR)
    return Outcome(len(wanted), len(planned) - len(wanted))


def in_parallel(
    work: Callable[[Task], Done], tasks: Sequence[Task], processes: int, together: int
) -> Generator[Done, None, None]:
    """Results in the order of the tasks, from so many processes; one is this process itself.

    Who stops early waits for what is being worked on, not for all that is left.
    """
    if processes == 1:
        yield from map(work, tasks)
        return
    with ProcessPoolExecutor(processes, get_context("spawn"), initializer=_end_with_parent) as pool:
        # its processes inherit this: Ctrl-C is for the one that started them, and each would print where it was
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            done = pool.map(work, tasks, chunksize=together)
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            yield from done
        finally:
            pool.shutdown(cancel_futures=True)


def _end_with_parent() -> None:
    """Leave nobody behind: a process of the pool ends when the one that started it was killed."""
    Thread(target=_watch_parent, daemon=True).start()


def _watch_parent() -> None:
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def fitted_microphones(library: CaseLibrary, axis: Axis) -> tuple[tuple[Microphone, ...], int | None]:
    """The paths fitted to this axis's place and their version, or nothing."""
    with library.reading() as session:
        row = active_artifact(session, sound_kind(axis.name))
        if row is None:
            return (), None
        listed = row.content["microphones"]
        assert isinstance(listed, list)
        return tuple(microphone_of(each) for each in listed), row.version


def sound_kind(axis: str) -> str:
    """Kind of artifact under which fitted paths are kept."""
    return f"sound/{axis}"


def simulations(library: CaseLibrary) -> JobKind:
    """The job kind behind `POST /simulations`, for one library."""

    def cut(parameters: dict[str, Json]) -> list[dict[str, Json]]:
        batches = Campaign.from_document(parameters).batches()
        return [{"campaign": parameters, "first": batch.start, "stop": batch.stop} for batch in batches]

    def run(task: dict[str, Json], _report: Report) -> Json:
        only = range(cast(int, task["first"]), cast(int, task["stop"]))
        wanted = Campaign.from_document(task["campaign"]).planned(only)
        outcome = _retained(library, wanted)
        return {"new": outcome.new, "known": outcome.known, "simulation_s": round(outcome.simulation_s, 3)}

    def finish(parameters: dict[str, Json], results: list[Json]) -> Json:
        quarantine_far(library, ACTOR)
        counted = [result for result in results if isinstance(result, dict)]
        return {
            "new": sum(int(str(result["new"])) for result in counted),
            "known": sum(int(str(result["known"])) for result in counted),
            "simulation_s": round(sum(float(str(result["simulation_s"])) for result in counted), 3),
            "counts": parameters["counts"],
        }

    return JobKind(KIND, "simulating", cut, run, finish)


def _retained(library: CaseLibrary, planned: Sequence[Planned]) -> Outcome:
    """Simulate and keep what is missing of a batch; somebody else may be at the same cases."""
    generated: dict[str, Generated] = {}
    took = 0.0
    while wanted := missing(library, planned):
        started = time.thread_time()
        for each in wanted:
            if key_of(each.scenario) not in generated:
                case = simulate_case(each)
                generated[case.key] = case
        took += time.thread_time() - started
        try:
            retain(library, [generated[key_of(each.scenario)] for each in wanted], KIND)
        except IntegrityError:
            continue  # another worker kept some of them first: look again
        return Outcome(len(wanted), len(planned) - len(wanted), took)
    return Outcome(0, len(planned), took)


def wav(sound: NDArray[np.float32]) -> bytes:
    """Return a sound at `SAMPLE_RATE_HZ`, in full scales, as WAV of 16 bit."""
    memory = io.BytesIO()
    soundfile.write(memory, sound, int(SAMPLE_RATE_HZ), subtype="PCM_16", format="WAV")
    return memory.getvalue()
