"""What the bank hands out: gearboxes, recordings with their truth, and named sets of questions."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Half = Literal["work", "final"]
Floats = NDArray[np.float64]

MOTIONS: tuple[str, ...] = (
    "trapezoid_dwell",
    "trapezoid",
    "sine",
    "s_curve",
    "short",
    "turn",
    "production",
    "fast_ramp",
)
KNOWN_STATES: tuple[str, ...] = ("normal", "notch", "play")
UNSEEN_FAULTS: tuple[str, ...] = ("bearing", "wear", "dry", "misaligned", "loose")
TWO_AT_ONCE: tuple[str, ...] = ("play+notch", "notch+bearing")


@dataclass(frozen=True)
class Gearbox:
    """One gearbox of an axis type. Its numbers follow from `half`, `axis` and `number` alone.

    `held_out` gearboxes are never in a library; the questions are recorded on them.
    """

    half: Half
    axis: str
    number: int
    held_out: bool

    @property
    def name(self) -> str:
        """Name that is unique over both halves."""
        return f"{self.half}-{self.axis}-{self.number:02d}"


@dataclass(frozen=True, eq=False)
class Recorded:
    """One recording and its truth.

    samples: float32 in -1..1, already rounded to the 16 bit of the recorder.
    rate_hz: sample rate [Hz]. axis, gearbox, motion: names.
    labels: {'normal'}, {'play'}, {'play', 'notch'}, {'bearing'}, ...
    size_rad: depth of the notch's dent, or the play's whole gap [rad at the output]; the notch's
        when both are there; None for other states.
    speed_rad_s: peak commanded output speed [rad/s]. payload_kg_m2: inertia added to the arm.
    period_s: time after which the motion repeats [s].
    snr_db: machine over added surrounding noise [dB], None where nothing was added.
    audibility_low_db, audibility_db: energy of (faulty minus its healthy twin) over the energy of
        the twin's recording, below 200 Hz and over the full band [dB]; None for a normal one.
    audibility_peak_db: the loudest 2 % of 50 ms frames of that difference below 200 Hz over the
        median frame of the twin [dB]: short impacts show here and not in the mean.
    microphone: kind and distance. seed: what the recording was drawn from.
    sizes: every fault with its size: [rad at the output] for play and notch, 0..1 for the others.
    notch_angle_rad: output angle of the damaged tooth. events_s: times [s] in the recording at
        which the output passes the damaged tooth.
    landings_s: times [s] at which the last stage has crossed its play and lands on the other flank.
    """

    samples: NDArray[np.float32]
    rate_hz: float
    axis: str
    gearbox: str
    motion: str
    labels: frozenset[str]
    size_rad: float | None
    speed_rad_s: float
    payload_kg_m2: float
    period_s: float
    snr_db: float | None
    audibility_low_db: float | None
    audibility_db: float | None
    microphone: str
    seed: int
    audibility_peak_db: float | None = None
    sizes: tuple[tuple[str, float], ...] = ()
    notch_angle_rad: float | None = None
    events_s: tuple[float, ...] = ()
    landings_s: tuple[float, ...] = ()


def rng_of(*what: object) -> np.random.Generator:
    """A generator that depends on nothing but the words and numbers given."""
    return np.random.default_rng([zlib.crc32(str(w).encode()) for w in what])
