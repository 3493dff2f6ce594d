"""Several recordings of one axis: which show a fault, and where they contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from signals.recording import Recording
from sim.investigation.acoustic.coverage import WORDS
from sim.investigation.acoustic.evidence import AcousticFinding, log_ratio, probability
from sim.investigation.acoustic.faults import SHOWN

PLACES = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
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
    known = list(zip(names, heard.p_values, strict=True))
    shown = [name for name, p in known if p is not None and p < SHOWN]
    silent = [name for name, p in known if p is not None and p >= SHOWN]
    closed = [name for name, p in known if p is None]
    said = f"Heard in {len(shown)} of {len(names)} recordings{': ' if shown else ''}{_listed(shown)}."
    said += f" Not heard in {_listed(silent)}." if silent else ""
    said += f" Could not be looked for in {_listed(closed)}." if closed else ""
    return replace(heard, explanation=f"{heard.explanation} {said}")


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


def _listed(names: Sequence[str]) -> str:
    return " and ".join([part for part in (", ".join(names[:-1]), *names[-1:]) if part])
