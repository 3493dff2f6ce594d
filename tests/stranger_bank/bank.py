"""Recordings on demand, libraries, sets of questions, and the cache on disk."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import soundfile as sf
from scipy import fft
from scipy.signal import butter, sosfiltfilt

from . import sound
from .axes import DESIGNS, IN_HOUSE, gearboxes, unit_of
from .kinds import (
    KNOWN_STATES,
    MOTIONS,
    TWO_AT_ONCE,
    UNSEEN_FAULTS,
    Floats,
    Gearbox,
    Half,
    Recorded,
    rng_of,
)
from .mechanics import RUN_IN_S, Build, Run, healthy, run, worsen
from .motions import RATE, Motion, motion_of

VERSION = 1
"""Raise it when the sound of any recording changes: it is part of the cache's keys."""
SNRS: tuple[float | None, ...] = (None, 15.0, 5.0, 0.0, -6.0)


@dataclass(frozen=True)
class Spec:
    """Everything a recording follows from (see `record`)."""

    gearbox: Gearbox
    state: str
    motion: str
    seed: int
    snr_db: float | None = None
    size: float | None = None
    duration_s: float = 20.0

    @property
    def key(self) -> str:
        """Name of the recording in the cache."""
        text = f"{VERSION}|{self.gearbox.name}|{self.state}|{self.motion}|{self.seed}"
        text += f"|{self.snr_db}|{self.size}|{self.duration_s}"
        return hashlib.sha1(text.encode(), usedforsecurity=False).hexdigest()[:16]


@dataclass(frozen=True)
class QuestionSet:
    """A named set of recordings; iterating it gives `Recorded`s, from the cache where it can.

    library_axis: axis type whose library the set is to be asked of.
    """

    name: str
    about: str
    library_axis: str
    specs: tuple[Spec, ...]

    def __len__(self) -> int:
        return len(self.specs)

    def __iter__(self) -> Iterator[Recorded]:
        return (cached(s) for s in self.specs)


@dataclass(frozen=True, eq=False)
class _Machine:
    """Sound at the housing of one run and of its healthy twin, before room and recorder."""

    motion: Motion
    payload: float
    build: Build
    run: Run
    spectrum: Floats
    twin: Floats | None
    size: int


@lru_cache(maxsize=1)
def _machine(box: Gearbox, state: str, motion: str, seed: int, size: float | None,
             duration_s: float) -> _Machine:  # fmt: skip
    unit = unit_of(box)
    d = unit.design
    modern = box.half == "final"
    # normal, notch and play of one seed share motion, payload, microphone and noise
    draw = rng_of("motion", box.name, motion, seed)
    m = motion_of(motion, box.half, d, draw, None)
    payload = float(draw.uniform(*d.payload))
    start = int(draw.integers(0, m.position.size))
    phase = float(draw.uniform(0, 2 * np.pi))
    if d.gravity > 0:
        phase = float(draw.uniform(-0.4, 0.4)) + np.pi / 2 * float(draw.integers(0, 2))
    span = (float(m.position.min()), float(m.position.max()))
    build = healthy(unit)
    rng_fault = rng_of("fault", box.name, state, motion, seed)
    faults = [] if state == "normal" else state.split("+")
    for f in faults:
        worsen(build, f, rng=rng_fault, size=size, span=span, modern=modern)

    def go(b: Build) -> Run:
        return run(b, m, duration_s=duration_s, payload=payload, start=start,
                   gravity_phase=phase, modern=modern)  # fmt: skip

    r = go(build)
    n = sound.fft_size(r.out_nm.size)
    irs = fft.rfft(sound.housing(box), n, axis=1)
    spec = sound.spectrum(box, build, r, rng_fault, seed, irs, n)
    twin = None
    if faults:
        b = healthy(unit)
        mechanical = set(faults) - {"bearing", "loose"}
        twin = sound.spectrum(box, b, go(b) if mechanical else r, rng_fault, seed, irs, n)
    return _Machine(m, payload, build, r, spec, twin, n)


def _db(a: float, b: float) -> float:
    return float(10 * np.log10(max(a, 1e-30) / max(b, 1e-30)))


def _audibility(fault: Floats, normal: Floats, rate: int) -> tuple[float, float, float]:
    """Low band, full band and loud-frame level [dB] of a fault's part in a recording."""
    full = _db(float(np.sum(fault**2)), float(np.sum(normal**2)))
    step = max(1, rate // 2000)

    def low(x: Floats) -> Floats:
        # block means, then a low pass at 200 Hz
        y = x[: x.size // step * step].reshape(-1, step).mean(axis=1)
        return sosfiltfilt(butter(4, 200, fs=rate / step, output="sos"), y)

    k = round(0.05 * rate / step)
    a, b = low(fault)[k:-k], low(normal)[k:-k]  # the filter's ends are not sound
    fa = np.mean(a[: a.size // k * k].reshape(-1, k) ** 2, axis=1)
    fb = np.mean(b[: b.size // k * k].reshape(-1, k) ** 2, axis=1)
    loud = np.mean(np.sort(fa)[-max(1, fa.size // 50) :])
    return _db(np.sum(a**2), np.sum(b**2)), full, _db(float(loud), float(np.median(fb)))


def record(
    gearbox: Gearbox,
    state: str,
    motion: str,
    *,
    seed: int,
    snr_db: float | None = None,
    size: float | None = None,
    duration_s: float = 20.0,
) -> Recorded:
    """Make one recording.

    state: 'normal', 'play', 'notch', 'bearing', 'wear', 'dry', 'misaligned', 'loose', or several
    joined with '+'. size: gap or depth [rad at the output] for play and notch, 0..1 for the other
    faults; None draws it. snr_db: healthy machine over added noise [dB]. duration_s [s].
    """
    mach = _machine(gearbox, state, motion, seed, size, duration_s)
    half = gearbox.half
    draw = rng_of("microphone", gearbox.name, motion, seed)
    mic = sound.microphone_of(draw, half)
    rate = mic.rate_hz
    f = np.arange(mach.size // 2 + 1) * (RATE / mach.size)
    way = sound.path(mic, f, draw, half)
    total = mach.run.out_nm.size
    heard = sound.at_rate(mach.spectrum * way, mach.size, rate, total)
    twin = heard if mach.twin is None else sound.at_rate(mach.twin * way, mach.size, rate, total)
    n = heard.size
    level = float(np.sqrt(np.mean(twin**2)))
    noise_rng = rng_of("noise", gearbox.name, motion, seed)
    rest = sound.fan(noise_rng, gearbox, n, rate) * (0.5 if mic.kind == "contact" else 1.0)
    rest += level * 10 ** (mic.floor_db / 20) * noise_rng.standard_normal(n)
    rest += 0.02 * level * sound.pwm(noise_rng, n, rate)
    if snr_db is not None:
        hall = sound.surroundings(rng_of("hall", gearbox.name, motion, seed), n, rate, half)
        rest += level * 10 ** (-snr_db / 20) * hall
    aud: tuple[float | None, float | None, float | None] = (None, None, None)
    if mach.twin is not None:
        aud = _audibility(heard - twin, twin + rest, rate)
    y = heard + rest
    gain = 10 ** (mic.level_dbfs / 20) / float(np.sqrt(np.mean(y**2)))
    gain = min(gain, 0.98 / float(np.max(np.abs(y))))
    ints = np.clip(np.round(y * gain * 32768 + noise_rng.uniform(-0.5, 0.5, n)), -32768, 32767)
    labels = frozenset(state.split("+"))
    sizes = tuple(mach.build.sizes.items())
    one = dict(sizes)
    size_rad = one.get("notch", one.get("play"))
    cut = round(RUN_IN_S * RATE)
    side = mach.run.side[cut:]
    landings = np.flatnonzero(np.diff(side) != 0) / RATE
    events: tuple[float, ...] = ()
    if mach.build.notch_angle is not None:
        turn = (mach.run.output_rad[cut:] - mach.build.notch_angle) / (2 * np.pi)
        jump = np.diff(np.floor(turn)) != 0
        events = tuple(float(t) for t in np.round(np.flatnonzero(jump) / RATE, 4))
    return Recorded(
        samples=(ints / 32768).astype(np.float32),
        rate_hz=float(rate),
        axis=gearbox.axis,
        gearbox=gearbox.name,
        motion=motion,
        labels=labels,
        size_rad=size_rad,
        speed_rad_s=mach.motion.peak_speed,
        payload_kg_m2=mach.payload,
        period_s=mach.motion.period_s,
        snr_db=snr_db,
        audibility_low_db=aud[0],
        audibility_db=aud[1],
        microphone=mic.name,
        seed=seed,
        audibility_peak_db=aud[2],
        sizes=sizes,
        notch_angle_rad=mach.build.notch_angle,
        events_s=events,
        landings_s=tuple(float(t) for t in np.round(landings[:400], 4)),
    )


_folder: Path | None = None


def use_folder(folder: Path | str) -> None:
    """Keep and look for recordings in this folder (default: see `folder_of`)."""
    global _folder
    _folder = Path(folder)


def folder_of(half: Half) -> Path:
    """Folder of a half: `use_folder`, else $STRANGER_BANK, else one in the temp folder."""
    root = _folder or Path(os.environ.get("STRANGER_BANK", ""))
    if str(root) in {"", "."}:
        root = Path(tempfile.gettempdir()) / "stranger_bank"
    return root / half


def truth_of(rec: Recorded) -> dict[str, object]:
    """The truth of a recording as plain values."""
    out = {f.name: getattr(rec, f.name) for f in dataclasses.fields(rec) if f.name != "samples"}
    out["labels"] = sorted(rec.labels)
    return out


def cached(spec: Spec) -> Recorded:
    """The recording of `spec`, from disk where it is there, else made and put there."""
    folder = folder_of(spec.gearbox.half)
    wav, truth = folder / f"{spec.key}.wav", folder / f"{spec.key}.json"
    if truth.exists() and wav.exists():
        t = json.loads(truth.read_text())
        samples, _ = sf.read(wav, dtype="float32")
        t["labels"] = frozenset(t["labels"])
        t["sizes"] = tuple((str(k), float(v)) for k, v in t["sizes"])
        t["events_s"], t["landings_s"] = tuple(t["events_s"]), tuple(t["landings_s"])
        return Recorded(samples=samples, **t)
    rec = record(
        spec.gearbox,
        spec.state,
        spec.motion,
        seed=spec.seed,
        snr_db=spec.snr_db,
        size=spec.size,
        duration_s=spec.duration_s,
    )
    folder.mkdir(parents=True, exist_ok=True)
    ints = np.round(rec.samples.astype(np.float64) * 32768).astype(np.int16)
    part = wav.with_suffix(f".{os.getpid()}.part")
    sf.write(part, ints, int(rec.rate_hz), subtype="PCM_16", format="WAV")
    part.replace(wav)
    part = truth.with_suffix(f".{os.getpid()}.part")
    part.write_text(json.dumps(truth_of(rec)))
    part.replace(truth)
    return rec


def _boxes(half: Half, axis: str, held_out: bool) -> list[Gearbox]:
    return [b for b in gearboxes(half) if b.axis == axis and b.held_out == held_out]


def _length(motion: str) -> float:
    return 30.0 if motion == "turn" else 20.0


def library_specs(half: Half, axis: str, count: int) -> list[Spec]:
    """Specs of a library: of each gearbox 3 normal, 3 notch and 3 play."""
    if count > IN_HOUSE:
        raise ValueError(f"only {IN_HOUSE} gearboxes of an axis may be in a library")
    out = []
    for b in _boxes(half, axis, held_out=False)[:count]:
        order = rng_of("library motions", b.name).permutation(len(MOTIONS))
        for i, state in enumerate(KNOWN_STATES):
            for j in range(3):
                motion = MOTIONS[order[(3 * i + j) % len(MOTIONS)]]
                out.append(Spec(b, state, motion, 1000 + 10 * i + j, duration_s=_length(motion)))
    return out


def library(half: Half, axis: str, gearboxes: int) -> list[Recorded]:
    """A library of `gearboxes` (at most 6) gearboxes of an axis, 9 recordings each."""
    return [cached(s) for s in library_specs(half, axis, gearboxes)]


def questions(half: Half) -> list[QuestionSet]:
    """All sets of questions of a half; every recording is of a held-out gearbox."""
    sets: list[QuestionSet] = []
    axes = list(DESIGNS[half])
    each = 6 if half == "work" else 5
    for axis in axes:
        boxes = _boxes(half, axis, held_out=True)
        known: dict[str, list[Spec]] = {}
        for motion in MOTIONS:
            specs = []
            for j in range(each):
                b = boxes[j % len(boxes)]
                for i, state in enumerate(KNOWN_STATES):
                    brief = j == each - 1 and motion in {"short", "sine", "s_curve", "trapezoid"}
                    sec = 10.0 if brief else _length(motion)
                    specs.append(Spec(b, state, motion, 2000 + 100 * i + j, duration_s=sec))
            known[motion] = specs
            sets.append(
                QuestionSet(
                    f"known/{axis}/{motion}",
                    "normal, notch and play on gearboxes the library has not seen",
                    axis,
                    tuple(specs),
                )
            )
        for k, fault in enumerate((*UNSEEN_FAULTS, *TWO_AT_ONCE)):
            specs = []
            for j in range(8):
                motion = MOTIONS[(j + k) % len(MOTIONS)]
                b = boxes[(j + k) % len(boxes)]
                specs.append(Spec(b, fault, motion, 3000 + 100 * k + j, duration_s=_length(motion)))
            kind = "two" if "+" in fault else "unseen"
            about = "two faults at once" if kind == "two" else "a fault that no library has"
            sets.append(QuestionSet(f"{kind}/{axis}/{fault}", about, axis, tuple(specs)))
        for snr in SNRS:
            specs = []
            for j in range(2):
                for i, state in enumerate(KNOWN_STATES):
                    motion = ("trapezoid_dwell", "s_curve", "production")[(i + j) % 3]
                    b = boxes[(j + i) % len(boxes)]
                    specs.append(Spec(b, state, motion, 4000 + 100 * i + j, snr_db=snr))
            name = "quiet" if snr is None else f"{snr:+.0f}dB"
            about = "the same recordings under rising noise of the surroundings"
            sets.append(QuestionSet(f"noise/{axis}/{name}", about, axis, tuple(specs)))
        other = axes[(axes.index(axis) + 1) % len(axes)]
        sets.append(
            QuestionSet(
                f"cross/{axis}/on_{other}",
                f"known states of {axis}, asked of the library of {other}",
                other,
                tuple(known["trapezoid_dwell"] + known["production"][:6]),
            )
        )
    return sets


def all_specs(half: Half) -> dict[Spec, list[str]]:
    """Every recording of a half with the names of the sets it is in."""
    out: dict[Spec, list[str]] = {}
    for axis in DESIGNS[half]:
        for s in library_specs(half, axis, IN_HOUSE):
            out.setdefault(s, []).append(f"library/{axis}")
    # noise sweeps last and side by side, so that one run of the machine serves all levels
    sweep: dict[Spec, list[str]] = {}
    for q in questions(half):
        for s in q.specs:
            (sweep if q.name.startswith("noise/") else out).setdefault(s, []).append(q.name)
    key = lambda s: (s.gearbox.name, s.state, s.motion, s.seed)  # noqa: E731
    for s in sorted(sweep, key=key):
        out.setdefault(s, []).extend(sweep[s])
    return out
