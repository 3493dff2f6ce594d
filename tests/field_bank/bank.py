"""What is asked: recordings for a library, and recordings to diagnose with what is true of each."""

import csv
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from shutil import which
from tempfile import mkdtemp
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
    """What is true of a sound. `truth` is a label, or "" where none is right; `base` numbers its undisturbed recording.

    `group` is undisturbed, unseen, harmless, disturbed or foreign; `fold` says which library may be asked.
    """

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


def half_seed(half: str, *what: object) -> np.random.Generator:
    """Return the source of chance of a half for something."""
    return np.random.default_rng((SEEDS[half], *(crc32(str(w).encode()) for w in what)))


def own_bank(half: str, gearboxes: int) -> Bank:
    """Return the bank of the own generator: a library of so many gearboxes, and six others to test."""
    units = make_units(half_seed(half, "units"), UNITS)

    def known(unit: int, label: str, i: int, rates: tuple[int, ...]) -> Known:
        rng = half_seed(half, unit, label, i)
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


def questions(bank: Bank) -> Iterator[tuple[Question, Sound]]:
    """Yield what is to be diagnosed, with what is true of it."""
    pool = [(fold, k) for fold, tested in enumerate(bank.tested) for k in tested]
    for i, (fold, k) in enumerate(pool):
        yield Question("undisturbed", "undisturbed", k.label, k.gearbox, k.size_rad, 0.0, i, fold), k.sound
    for k in bank.unseen:
        yield Question("unseen", UNSEEN, "", k.gearbox, k.size_rad, 0.0, -1, 0), k.sound
    for name in kinds_of(bank.half):
        change = KINDS[name]
        group = "harmless" if change.harmless else "disturbed"
        rng = half_seed(bank.half, name)
        for n, i in enumerate(balanced(rng, [k.label for _, k in pool])):
            fold, k = pool[i]
            strength = float(rng.random())
            sound = change.change(k.sound, half_seed(bank.half, name, n), strength)
            yield Question(group, name, k.label, k.gearbox, k.size_rad, strength, i, fold), sound
    for n, (name, sound) in enumerate(foreign(bank.half, FOREIGN, SEEDS[bank.half])):
        yield Question("foreign", name, "", "", 0.0, 0.0, -1, n % len(bank.libraries)), sound


def written(bank: Bank, cache: Path) -> list[tuple[Path, Question]]:
    """Return the files to diagnose, made at the first call and taken from the cache from then on."""
    digest = sha256(f"{bank.half} {bank.axis is None} {which('espeak-ng')} {SHARED.exists()}".encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if path.stem not in ("__main__", "product", "score", "test_bank"):
            digest.update(path.read_bytes())
    done = cache / f"{bank.half}-{digest.hexdigest()[:16]}"
    if not done.exists():
        cache.mkdir(parents=True, exist_ok=True)
        making = Path(mkdtemp(dir=cache, prefix="making-"))
        made = [(write(sound, making / f"r{i:05d}").name, asdict(q)) for i, (q, sound) in enumerate(questions(bank))]
        (making / "questions.json").write_text(json.dumps(made))
        making.rename(done)
    return [(done / name, Question(**q)) for name, q in json.loads((done / "questions.json").read_text())]


def write(sound: Sound, stem: Path) -> Path:
    """Write a sound beside other files and return its path, the stem with the suffix of its format."""
    path = stem.with_suffix(sound.suffix)
    sf.write(path, sound.samples, sound.rate, subtype=sound.subtype)
    return path


def balanced(rng: np.random.Generator, labels: list[str]) -> list[int]:
    """Return PER_KIND different places of a list of labels, as many of each label."""
    names = sorted(set(labels))
    each = PER_KIND // len(names)
    chosen = [rng.permutation([i for i, x in enumerate(labels) if x == name])[:each] for name in names]
    return [int(i) for i in np.concatenate(chosen)]
