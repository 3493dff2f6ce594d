"""Several recordings of one axis: which show a fault, where they contradict, whether they are of one axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from casebase.signals.recording import Recording
from sim.discrepancy.acoustic.coverage import WORDS
from sim.discrepancy.acoustic.evidence import AcousticFinding, log_ratio, probability
from sim.discrepancy.acoustic.faults import SHOWN

PLACES = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
LEVELS_APART_DB = 12.0  # thirty recordings: those of one gearbox within 8 dB, five gearboxes up to 20 dB apart
ALONE = 0.5  # probability from which a recording by itself would name a fault


def names_of(sounds: Sequence[Recording]) -> tuple[str, ...]:
    """What to call each recording: by its name where all have one of their own, else by its place."""
    own = tuple(sound.name for sound in sounds)
    if all(own) and len(set(own)) == len(own):
        return own
    return tuple(f"the {PLACES[i]}" if i < len(PLACES) else f"number {i + 1}" for i in range(len(sounds)))


def without_copies(sounds: Sequence[Recording]) -> tuple[tuple[Recording, ...], tuple[str, ...]]:
    """Every recording once, and a remark where one was given more than once: that is no more evidence."""
    kept = tuple({sound.sha256: sound for sound in reversed(sounds)}.values())[::-1]
    if len(kept) == len(sounds):
        return kept, ()
    return kept, (f"Copies count once: {len(kept)} of {len(sounds)} recordings are left.",)


def with_recordings(heard: AcousticFinding, names: Sequence[str]) -> AcousticFinding:
    """Say in which recordings the evidence of a finding is, where there are several."""
    if len(names) < 2:
        return heard
    shown, silent, closed = _divided(heard, names)
    said = [f"Heard in {len(shown)} of {len(names)} recordings: {_listed(shown)}." if shown else
            f"Hardly heard in any of {len(names)} recordings by itself."]  # fmt: skip
    if silent:
        said.append(f"Not heard in {_listed(silent)}.")
    if closed:
        said.append(f"Could not be looked for in {_listed(closed)}.")
    return replace(heard, explanation=" ".join([heard.explanation, *said]))


def contradictions(machine: Sequence[AcousticFinding], names: Sequence[str]) -> tuple[str, ...]:
    """Where one recording by itself would name a fault and another speaks against it."""
    out = []
    for heard in machine:
        alone = [name for name, p in zip(names, heard.p_values, strict=True)
                 if p is not None and probability([p]) >= ALONE]  # fmt: skip
        against = [name for name, p in zip(names, heard.p_values, strict=True) if p is not None and log_ratio(p) < 0.0]
        if alone and against:
            taken = "" if heard.probability >= ALONE else ", and all together do not name it"
            out.append(
                f"The recordings contradict each other: {WORDS[heard.mechanism]} would be named by {_listed(alone)} "
                f"alone, but is not heard in {_listed(against)}{taken}. If they are of different axes, or of before "
                "and after a repair, investigate them one by one."
            )
    return tuple(out)


def strangers(sounds: Sequence[Recording], names: Sequence[str]) -> tuple[str, ...]:
    """Remarks where recordings differ so plainly that they may not be of one axis and one microphone."""
    out = []
    rates = [sound.sample_rate_hz for sound in sounds]
    if max(rates) > min(rates):
        told = ", ".join(f"{name} {rate:.0f} Hz" for name, rate in zip(names, rates, strict=True))
        out.append(f"The recordings differ in sample rate ({told}): are they all of this axis?")
    levels = [_level_db(sound) for sound in sounds]
    if max(levels) - min(levels) > LEVELS_APART_DB:
        quiet, loud = levels.index(min(levels)), levels.index(max(levels))
        told = f"from {levels[quiet]:.0f} dB of full scale ({names[quiet]}) to {levels[loud]:.0f} dB ({names[loud]})"
        out.append(f"The recordings differ in level, {told}: are they all of this axis and microphone?")
    return tuple(out)


def _divided(heard: AcousticFinding, names: Sequence[str]) -> tuple[list[str], list[str], list[str]]:
    """Names of the recordings that show it, that do not, and in which it could not be looked for."""
    known = list(zip(names, heard.p_values, strict=True))
    shown = [name for name, p in known if p is not None and p < SHOWN]
    return shown, [name for name, p in known if p is not None and p >= SHOWN], [name for name, p in known if p is None]


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _level_db(sound: Recording) -> float:
    values = sound.samples.astype(np.float64)
    return 10.0 * math.log10(max(float(np.mean((values - values.mean()) ** 2)), 1e-12))
