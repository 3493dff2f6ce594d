"""A gearbox from its first recording to its last: a fault that grows, while motion, payload and microphone change."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.field_bank.gearboxes import SMALLEST_RAD, Motion, Recording, Unit, draw_motion, make_units, record
from benchmarks.field_bank.sounds import Floats, Rng, band

RECORDINGS = 40
SMALLEST_SHARE, LARGEST_SHARE = 0.1, 10.0
"""Size of the fault in the first and the last recording, over one that is barely audible."""
NONE_RAD = 1e-12
CHANGED_FROM = 25
"""From this recording on another good gearbox is in the axis, or the microphone stands elsewhere."""
EXCHANGED, MOVED = "exchanged", "moved"
BANDS_HZ = ((12.0, 200.0), (200.0, 3600.0))


@dataclass(frozen=True)
class Heard:
    """One recording, and how far the strikes of its fault stand above everything else, peak over peak [1]."""

    recording: Recording
    ratio: float


def sizes(label: str, count: int = RECORDINGS) -> Floats:
    """Return the size of the fault in each recording, shape (count,) [rad]."""
    if label in ("normal", EXCHANGED, MOVED):
        return np.zeros(count)
    return np.asarray(SMALLEST_RAD * np.geomspace(SMALLEST_SHARE, LARGEST_SHARE, count))


def life(label: str, seed: int, count: int = RECORDINGS) -> Iterator[Heard]:
    """Yield the recordings of one gearbox in the order in which they were made."""
    rng = np.random.default_rng([seed, 77])
    first = make_units(rng, 1)[0]
    program = draw_motion(rng)
    later = {EXCHANGED: another_of_its_type, MOVED: microphone_moved}
    unit_later = later[label](first, np.random.default_rng([seed, 79])) if label in later else first
    label = "normal" if label in later else label
    for number, size in enumerate(sizes(label, count)):
        unit = first if number < CHANGED_FROM else unit_later
        one = np.random.default_rng([seed, 78, number])
        placed, motion, payload = microphone_at_another_place(unit, one), overridden(program, one), one.uniform(20, 50)
        drawn = one.integers(2**31)

        def made(size_rad: float) -> Recording:
            again = np.random.default_rng(drawn)  # noqa: B023  used at once
            return record(placed, label, again, motion=motion, payload=payload, size_rad=size_rad)  # noqa: B023

        if label == "normal":
            yield Heard(record(placed, label, np.random.default_rng(drawn), motion=motion, payload=payload), 0.0)
            continue
        found, without = made(float(size)), made(NONE_RAD)
        yield Heard(found, peak_ratio(found, without))


def peak_ratio(found: Recording, without: Recording) -> float:
    """Return peak of what the fault adds over the peak of the rest, in the band where that is larger [1]."""
    rate = found.sound.rate
    added, rest = found.sound.samples - without.sound.samples, without.sound.samples
    return max(
        float(np.max(np.abs(band(added, rate, low, high))) / np.max(np.abs(band(rest, rate, low, high))))
        for low, high in BANDS_HZ
    )


def overridden(program: Motion, rng: Rng) -> Motion:
    """Return the same path at another speed override, 70 to 100 %, started anywhere."""
    share = rng.uniform(0.7, 1.0)
    return replace(
        program,
        period_s=program.dwell_s * 2 + (program.period_s - 2 * program.dwell_s) / share,
        ramp_s=program.ramp_s / share,
        speed_rad_s=program.speed_rad_s * share,
        start_s=rng.uniform(0, program.period_s),
    )


def microphone_at_another_place(unit: Unit, rng: Rng) -> Unit:
    """Return the same gearbox heard from elsewhere: 2 dB a mode, 3 dB of room and other sounds, 4 dB of gain."""

    def decibel(spread: float) -> float:
        return float(10 ** (spread * rng.standard_normal() / 20))

    return replace(
        unit,
        modes=tuple((hz, tau, gain * decibel(2.0)) for hz, tau, gain in unit.modes),
        close_db=unit.close_db + 3.0 * float(rng.standard_normal()),
        fan_gain=unit.fan_gain * decibel(3.0),
        room_gain=unit.room_gain * decibel(3.0),
        level=unit.level * decibel(4.0),
    )


def another_of_its_type(unit: Unit, rng: Rng) -> Unit:
    """Return another gearbox as `make_units` draws those of one axis type; arm, room and microphone stay.

    Two of one type differ by the square root of two more than one from its type.
    """

    def drawn(value: float, spread: float) -> float:
        return value * float(1 + spread * np.sqrt(2) * rng.standard_normal())

    modes = []
    for hz, _, gain in unit.modes:
        there, quality = drawn(hz, 0.05), float(rng.uniform(7, 25))
        modes.append((there, quality / np.pi / there, gain * float(10 ** (0.2 * np.sqrt(2) * rng.standard_normal()))))
    return replace(
        unit,
        name=f"{unit.name} after",
        modes=tuple(modes),
        mesh_gain=float(rng.uniform(0.4, 1.6)),
        tilt=float(rng.uniform(0.0, 0.5)),
        jerk_gain=float(rng.uniform(0.2, 1.6)),
        friction_n_m=float(rng.uniform(8, 25)),
        imbalance_n_m=float(rng.uniform(0, 12)),
        flank=1 if rng.random() < 0.5 else -1,
    )


def microphone_moved(unit: Unit, rng: Rng) -> Unit:
    """Return the same gearbox heard from another place for good: as far as two recordings, and as far again."""
    return microphone_at_another_place(microphone_at_another_place(unit, rng), rng)


def heard_from(sizes_rad: Floats, ratios: Floats) -> float:
    """Return the size at which the strikes become the loudest of the cycle [rad], by a power law through all."""
    slope, offset = np.polyfit(np.log(sizes_rad), np.log(ratios), 1)
    return float(np.exp(-offset / slope))
