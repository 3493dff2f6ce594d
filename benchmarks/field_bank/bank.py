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

from benchmarks.field_bank.disturbances import KINDS
from benchmarks.field_bank.foreign import foreign
from benchmarks.field_bank.gearboxes import LABELS, UNSEEN, make_units, record
from benchmarks.field_bank.sounds import Sound, envelope
from benchmarks.shared_data import SHARED

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


def half_seed(half: str, *what: object) -> np.random.Generator:
    """Return the source of chance of a half for something."""
    return np.random.default_rng((SEEDS[half], *(crc32(str(w).encode()) for w in what)))


def own(half: str, unit: int, label: str, i: int, rates: tuple[int, ...] = (8000,)) -> Known:
    """Return the i-th recording of a gearbox of the own generator with a label."""
    rng = half_seed(half, unit, label, i)
    units = make_units(half_seed(half, "units"), UNITS)
    made = record(units[unit], label, rng, rate=int(rng.choice(rates)))
    return Known(made.sound, label, made.gearbox, made.speed_rad_s, made.payload_kg_m2, made.size_rad)


def shared_axis() -> list[list[Known]]:
    """Return the shared recordings by gearbox. Raises FileNotFoundError where they are absent."""
    by_gearbox: dict[str, list[Known]] = {}
    for row in csv.DictReader((AXIS / "manifest.csv").open()):
        samples, rate = sf.read(AXIS / row["file"], dtype="float64")
        sound = with_standstills(Sound(samples, int(rate)))
        speed, payload = float(row["speed_rad_s"]), float(row["payload_kg_m2"])
        known = Known(sound, row["label"], row["gearbox"], speed, payload, 0.0)
        by_gearbox.setdefault(row["gearbox"], []).append(known)
    return [by_gearbox[name] for name in sorted(by_gearbox)]


def libraries(half: str, source: str, gearboxes: int) -> list[list[Known]]:
    """Return the cases of each library: of so many own gearboxes, or of all shared ones but one."""
    if source == "own":
        return [[own(half, u, label, i) for u in range(gearboxes) for label in LABELS for i in range(2)]]
    boxes = shared_axis()
    return [[k for box in boxes if box is not left_out for k in box] for left_out in boxes]


def tested(half: str, source: str) -> list[list[Known]]:
    """Return the undisturbed recordings for each library; those whose label is UNSEEN have a fault no case has."""
    if source != "own":
        return shared_axis()
    rates = (8000,) * 7 + (16000, 44100, 48000)
    others = range(IN_LIBRARY, UNITS)
    known = [own(half, u, label, i, rates) for i in range(UNDISTURBED_PER_LABEL) for u in others for label in LABELS]
    unseen = [own(half, u, UNSEEN, i) for u in others for i in range(UNSEEN_COUNT // len(others))]
    return [known + unseen]


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


def questions(half: str, source: str) -> Iterator[tuple[Question, Sound]]:
    """Yield what is to be diagnosed, with what is true of it."""
    everything = [(fold, k) for fold, known in enumerate(tested(half, source)) for k in known]
    pool = [(fold, k) for fold, k in everything if k.label != UNSEEN]
    for i, (fold, k) in enumerate(pool):
        yield Question("undisturbed", "undisturbed", k.label, k.gearbox, k.size_rad, 0.0, i, fold), k.sound
    for fold, k in everything:
        if k.label == UNSEEN:
            yield Question("unseen", UNSEEN, "", k.gearbox, k.size_rad, 0.0, -1, fold), k.sound
    for name in kinds_of(half):
        change = KINDS[name]
        group = "harmless" if change.harmless else "disturbed"
        rng = half_seed(half, name)
        for n, i in enumerate(balanced(rng, [k.label for _, k in pool])):
            fold, k = pool[i]
            strength = float(rng.random())
            sound = change.change(k.sound, half_seed(half, name, n), strength)
            yield Question(group, name, k.label, k.gearbox, k.size_rad, strength, i, fold), sound
    folds = 1 + max(fold for fold, _ in everything)
    for n, (name, sound) in enumerate(foreign(half, FOREIGN, SEEDS[half])):
        yield Question("foreign", name, "", "", 0.0, 0.0, -1, n % folds), sound


def written(half: str, source: str, cache: Path) -> list[tuple[Path, Question]]:
    """Return the files to diagnose, made at the first call and taken from the cache from then on."""
    digest = sha256(f"{half} {SEEDS[half]} {source} {which('espeak-ng')} {SHARED.exists()}".encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if path.stem not in ("__main__", "product", "score", "test_bank"):
            digest.update(path.read_bytes())
    done = cache / f"{half}-{digest.hexdigest()[:16]}"
    if not done.exists():
        cache.mkdir(parents=True, exist_ok=True)
        making = Path(mkdtemp(dir=cache, prefix="making-"))
        made = [
            (write(sound, making / f"r{i:05d}").name, asdict(q)) for i, (q, sound) in enumerate(questions(half, source))
        ]
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
