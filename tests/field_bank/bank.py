"""What is asked: recordings for a library, and recordings to diagnose with what is true of each."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import numpy as np
import soundfile as sf

from tests.field_bank.disturbances import KINDS
from tests.field_bank.foreign import foreign
from tests.field_bank.gearboxes import LABELS, UNSEEN, make_units, record
from tests.field_bank.sounds import Sound, envelope
from tests.shared_data import SHARED

SEEDS = {"work": 20_000, "final": 70_000}
IN_LIBRARY, UNITS = 10, 16
PER_KIND, FOREIGN, UNDISTURBED_PER_LABEL, UNSEEN_COUNT = 30, 300, 5, 30
AXIS = SHARED / "data" / "axis_recordings"


@dataclass(frozen=True)
class Known:
    """A recording of which everything is known; speed in rad/s, payload in kg m2, size of the fault in rad."""

    sound: Sound
    label: str
    gearbox: str
    speed_rad_s: float
    payload_kg_m2: float
    size_rad: float


@dataclass(frozen=True)
class Question:
    """A sound to diagnose. `truth` is a label, or "" where none is right; `base` numbers its undisturbed recording.

    `group` is undisturbed, unseen, harmless, disturbed or foreign; `fold` says which library may be asked.
    """

    sound: Sound
    group: str
    kind: str
    truth: str
    gearbox: str
    size_rad: float
    strength: float
    base: int
    fold: int


@dataclass(frozen=True)
class Bank:
    """Libraries by fold, each a list of known recordings, and undisturbed recordings by fold."""

    half: str
    libraries: tuple[tuple[Known, ...], ...]
    tested: tuple[tuple[Known, ...], ...]
    unseen: tuple[Known, ...]
    axis: Path | None


def _seed(half: str, *what: object) -> np.random.Generator:
    return np.random.default_rng((SEEDS[half], *(crc32(str(w).encode()) for w in what)))


def own_bank(half: str, gearboxes: int) -> Bank:
    """Return the bank of the own generator: a library of so many gearboxes, and six others to test."""
    units = make_units(_seed(half, "units"), UNITS)

    def known(unit: int, label: str, i: int, rates: tuple[int, ...]) -> Known:
        rng = _seed(half, unit, label, i)
        made = record(units[unit], label, rng, rate=int(rng.choice(rates)))
        return Known(made.sound, label, made.gearbox, made.speed_rad_s, made.payload_kg_m2, made.size_rad)

    library = tuple(known(u, label, i, (8000,)) for u in range(gearboxes) for label in LABELS for i in range(2))
    rates = (8000,) * 7 + (16000, 44100, 48000)
    others = range(IN_LIBRARY, UNITS)
    tested = tuple(known(u, label, i, rates) for i in range(UNDISTURBED_PER_LABEL) for u in others for label in LABELS)
    each = UNSEEN_COUNT // len(others)
    unseen = tuple(known(u, UNSEEN, i, (8000,)) for u in others for i in range(each))
    return Bank(half, (library,), (tested,), unseen, None)


def axis_bank(half: str) -> Bank:
    """Return the bank of the shared recordings: each gearbox is tested with a library of the others.

    Raises FileNotFoundError where they are absent.
    """
    known = []
    for row in csv.DictReader((AXIS / "manifest.csv").open()):
        samples, rate = sf.read(AXIS / row["file"], dtype="float64")
        sound = with_standstills(Sound(samples, int(rate)))
        speed, payload = float(row["speed_rad_s"]), float(row["payload_kg_m2"])
        known.append(Known(sound, row["label"], row["gearbox"], speed, payload, 0.0))
    names = sorted({k.gearbox for k in known})
    libraries = tuple(tuple(k for k in known if k.gearbox != name) for name in names)
    tested = tuple(tuple(k for k in known if k.gearbox == name) for name in names)
    return Bank(half, libraries, tested, (), AXIS / "axis.toml")


def with_standstills(sound: Sound) -> Sound:
    """Return the sound with the standstills and the period that its envelope shows, for sounds of unknown motion."""
    loud = envelope(sound.samples, sound.rate, 0.1)[:: sound.rate // 100][10:-10]
    still = np.concatenate(([False], loud < 0.45 * np.median(loud), [False]))
    edges = np.flatnonzero(np.diff(still.astype(int))) / 100 + 0.1
    stops = [(float(a), float(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 0.05]
    merged = [s for i, s in enumerate(stops) if i == 0 or s[0] - stops[i - 1][0] > 1.0]
    middles = [(a + b) / 2 for a, b in merged]
    period = 2 * float(np.median(np.diff(middles))) if len(middles) > 2 else 6.0
    return replace(sound, standstills=tuple(merged), period_s=period)


def kinds_of(half: str) -> list[str]:
    """Return the names of the kinds of a half."""
    return [name for name, k in KINDS.items() if half == "final" or not k.final_only]


def questions(bank: Bank, only: str | None = None) -> Iterator[Question]:
    """Yield what is to be diagnosed; `only` leaves the undisturbed recordings and one kind, or `foreign`.

    Raises ValueError for a kind that this half does not have.
    """
    kinds = kinds_of(bank.half)
    if only is not None and only not in (*kinds, "foreign", "undisturbed"):
        raise ValueError(f"no such kind in this half: {only}; there are foreign, undisturbed, {', '.join(kinds)}")
    pool = [(fold, k) for fold, tested in enumerate(bank.tested) for k in tested]
    for i, (fold, k) in enumerate(pool):
        yield Question(k.sound, "undisturbed", "undisturbed", k.label, k.gearbox, k.size_rad, 0.0, i, fold)
    if only in (None, "undisturbed"):
        for k in bank.unseen:
            yield Question(k.sound, "unseen", UNSEEN, "", k.gearbox, k.size_rad, 0.0, -1, 0)
    for name in kinds:
        if only not in (None, name):
            continue
        change = KINDS[name]
        group = "harmless" if change.harmless else "disturbed"
        rng = _seed(bank.half, name)
        for n, i in enumerate(balanced(rng, [k.label for _, k in pool])):
            fold, k = pool[i]
            strength = float(rng.random())
            sound = change.change(k.sound, _seed(bank.half, name, n), strength)
            yield Question(sound, group, name, k.label, k.gearbox, k.size_rad, strength, i, fold)
    if only in (None, "foreign"):
        for n, (name, sound) in enumerate(foreign(bank.half, FOREIGN, SEEDS[bank.half])):
            yield Question(sound, "foreign", name, "", "", 0.0, 0.0, -1, n % len(bank.libraries))


def balanced(rng: np.random.Generator, labels: list[str]) -> list[int]:
    """Return PER_KIND different places of a list of labels, as many of each label."""
    names = sorted(set(labels))
    each = PER_KIND // len(names)
    chosen = [rng.permutation([i for i, x in enumerate(labels) if x == name])[:each] for name in names]
    return [int(i) for i in np.concatenate(chosen)]
