"""`simulate`: one call for every drive train; it picks the engine, and the result names it."""

from collections import OrderedDict
from collections.abc import Callable
from functools import cached_property, partial
from threading import Lock
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.errors import CompositionError, ParameterError, RunError, number
from sim.piecewise_affine.engine import ExactEngine, Run, component_events
from sim.piecewise_affine.system import Array, System
from sim.residual import Residual, check_finite, instants
from sim.rotational.drive_train import DriveTrain
from sim.rotational.trajectory import MEMORY_LIMIT_BYTES, Channels, Trajectory

Engine = Literal["exact", "chain"]
MAX_DURATION_S = 1e6
MAX_RATE_HZ = 1e6
KEPT_ENGINES = 16
CHAIN_WIDTH = 17
"""Numbers that four shafts in series give of a sample."""
_engines: OrderedDict[tuple[int, float], tuple[DriveTrain, ExactEngine]] = OrderedDict()
_lock = Lock()


def simulate(
    drive_train: DriveTrain,
    duration_s: float,
    sample_rate_hz: float = 8000.0,
    *,
    engine: Engine | None = None,
    watch: Array | None = None,
) -> Trajectory:
    """Simulate a drive train from its start values.

    Parameters
    ----------
    drive_train
        What to simulate.
    duration_s
        How long [s], at most 1e6; the samples stand at 0, 1/rate, ... up to the duration.
    sample_rate_hz
        Samples per second of the result [Hz]; the solution does not depend on it.
    engine
        `exact` needs components that are affine in every mode (`drive_train.affine`); `chain` takes shafts in series
        with all that is not affine: servo, imperfect meshes, friction of any curve. None: exact where it can be.
    watch
        One number, which becomes the share of a chain's run that is done, for another thread to look at.

    Returns
    -------
    Trajectory
        channels named `component.variable` of shape (n,), all events, and the engine's name.

    Raises
    ------
    ParameterError, RunError, CompositionError
        for a duration, rate or composition that cannot be, before any work; RunError where no motion continues.
    """
    samples = _samples(duration_s, sample_rate_hz)
    if _pick(drive_train, engine) == "chain":
        from sim.chain.reduction import simulate_chain

        _check_memory(samples, CHAIN_WIDTH, duration_s)
        return simulate_chain(drive_train, samples, sample_rate_hz, watch)
    exact = _engine(drive_train, sample_rate_hz)
    _check_memory(samples, exact.system.state_width, duration_s)
    return _trajectory(exact, exact.run(samples), sample_rate_hz)


def _samples(duration_s: float, sample_rate_hz: float) -> int:
    duration = number("duration_s", duration_s, "s", above=0, at_most=MAX_DURATION_S)
    rate = number("sample_rate_hz", sample_rate_hz, "Hz", above=0, at_most=MAX_RATE_HZ)
    return int(np.floor(duration * rate + 1e-6)) + 1


def _check_memory(samples: int, width: int, duration_s: float) -> None:
    if samples * width * 8 > MEMORY_LIMIT_BYTES:
        longest = MEMORY_LIMIT_BYTES / (8 * width) * duration_s / samples
        raise ParameterError(
            f"duration_s: must be at most {longest:.0f} s at this rate (2 GB of results), got {duration_s:g}"
        )


def _pick(drive_train: DriveTrain, engine: Engine | None) -> Engine:
    if not drive_train.components:
        raise CompositionError("a drive train needs at least one component")
    if engine not in (None, "exact", "chain"):
        raise ParameterError(f"engine: must be 'exact' or 'chain', got {engine!r}")
    if engine == "exact" and not drive_train.affine:
        bent = [name for name, part in drive_train.components.items() if not part.affine]
        raise RunError(f"engine: exact needs affine components; {', '.join(bent)} is not; use engine='chain'")
    return engine or ("exact" if drive_train.affine else "chain")


def _engine(drive_train: DriveTrain, sample_rate_hz: float) -> ExactEngine:
    """Return the engine of this very train at this rate, with the modes that it has learnt."""
    key = (id(drive_train), sample_rate_hz)
    with _lock:
        if key in _engines:
            _engines.move_to_end(key)
            return _engines[key][1]
        engine = ExactEngine(System(drive_train), sample_rate_hz)
        _engines[key] = (drive_train, engine)
        while len(_engines) > KEPT_ENGINES:
            _engines.popitem(last=False)
        return engine


def _trajectory(engine: ExactEngine, run: Run, sample_rate_hz: float) -> Trajectory:
    time = np.arange(len(run.states)) / sample_rate_hz
    events = tuple(component_events(engine, run))
    reader = _Reader(engine, run, time)
    residual = _verify(engine, run, time)
    return Trajectory(time, Channels(reader.sources), reader.units, events, "exact", residual)


def _verify(engine: ExactEngine, run: Run, time: Array) -> Residual:
    """Look at a run; raise RunError where it does not obey its equations."""
    verifier = engine.verifier
    check_finite(time, run.states, verifier.coordinate)
    at = instants(len(time))
    x = engine.system.states(time[at], run.states[at])
    following = np.minimum(at + 1, len(time) - 1)
    quiet = (run.modes[following] == run.modes[at]) & (following > at)
    knots = [signal.breakpoints(time[0], time[-1]) for signal in engine.system.signals]
    stops = np.sort(np.concatenate([*knots, run.change_times]))
    quiet &= np.searchsorted(stops, time[at] - 1e-9) == np.searchsorted(stops, time[following] + 1e-9)
    motion = verifier.motion(time[at], x)
    found = verifier.laws(engine.modes, run.modes[at], time[at], x, run.states[following], quiet)
    equations, limits, flow, energy = found
    return Residual(equations, limits, motion, flow, energy)


class _Reader:
    """Turns states and modes into named channels, each when it is asked for."""

    def __init__(self, engine: ExactEngine, run: Run, time_s: Array) -> None:
        self._engine, self._moving, self._modes, self._time = engine, run.states, run.modes, time_s
        self._solves = {i: engine.modes[i].solve for i in run.visited}
        self.units: dict[str, str] = {}
        self.sources: dict[str, Callable[[], Array]] = {}
        for i, (name, part) in enumerate(engine.system.train.components.items()):
            branch = engine.system.pieces[i][0].branch
            for channel in (*branch.channels, *branch.powers, *(("mode",) if branch.mode is not None else ())):
                self.units[f"{name}.{channel}"] = part.unit(channel)
                self.sources[f"{name}.{channel}"] = partial(self._read, i, channel)

    @cached_property
    def _states(self) -> Array:
        return self._engine.system.states(self._time, self._moving)

    def _read(self, i: int, channel: str) -> Array:
        pieces = self._engine.system.pieces[i]
        out = np.empty(len(self._time))
        for mode, solve in self._solves.items():
            at = self._modes == mode if len(self._solves) > 1 else slice(None)
            branch = pieces[self._engine.modes[mode].key[i]].branch
            if channel == "mode":
                out[at] = 0 if branch.mode is None else branch.mode
            elif channel in branch.channels:
                out[at] = self._values(at, solve, branch.channels[channel])
            else:
                one, other = branch.powers[channel]
                out[at] = self._values(at, solve, one) * self._values(at, solve, other)
        return out

    def _values(self, at: NDArray[np.bool_] | slice, solve: Array, row: Array) -> Array:
        system = self._engine.system
        by_state = row[: system.known] @ system.to_known + row[system.known :] @ solve
        used = np.flatnonzero(by_state)
        states = self._states if used.max(initial=0) >= self._moving.shape[1] else self._moving
        return np.asarray(states[at][:, used] @ by_state[used])
