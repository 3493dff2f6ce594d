"""What the extension gains on rows that the fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from sim.chain.model import Array
from sim.investigation.data.preprocessing import Bridge
from sim.investigation.estimation.doubts import by_doubts
from sim.investigation.estimation.estimate import Fit, Refits
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.nominal import MOTOR_RELEASE, MOTOR_STRETCH, START
from sim.investigation.results import Gain

FOLDS, BLOCKS = 4, 16
CUT_HZ = 40.0
Rows = NDArray[np.bool_]


def gains(problem: Problem, base: Fit, fit: Fit, terms: Sequence[Term]) -> tuple[Gain, ...]:
    """Per channel, of the rows that count: at rest dry friction holds what it likes, and no model tells what. Folds are
    quarters of them in blocks of time, each predicted from the others.

    The state in which the record begins is known by its first rows alone, the speed and the way over which dry friction
    turns by its reversals, which are few, and times of what happens once by the rows around them: all are kept.

    Before: the description as it is given or calibrated, whichever leaves less of the torque; numbers that a fit bends
    to stand for something missing may be worse than any data sheet. After: numbers of `fit`, by `terms` alone, and with
    what the other rows say of the known torque, if that leaves less. A number of the description that a term of `fit`
    stands for (an offset, a delay) is as described where that term is not in.
    """
    m = problem.measurement
    folds = _folds(m.weight)
    given = problem.raw_residuals((), {p.name: p.start for p in base.parameters}, weighted=False)
    freed = [t for t in fit.terms if t.named]
    before, _ = _held_out(problem, base, base.terms, freed, folds)
    after, corrected = _held_out(problem, fit, terms, freed, folds)
    over = Bridge.over(m.valid <= 0.5)

    def left(one: tuple[Array, Array]) -> float:
        return _rms(_motion_band(over.across(one[0]), m.rate_hz)[m.weight > 0.5])

    before, after = min(given, before, key=left), min(after, corrected, key=left)
    out = []
    names = [("motor_torque_nm", "N m")] + ([("load_torque_nm", "N m")] if before[1].size else [])
    for index, (channel, unit) in enumerate(names):
        a, b = before[index], after[index]
        rate = m.rate_hz / (1 if index == 0 else m.load_stride)
        settle = int(0.1 * rate)
        trusted = (m.valid if index == 0 else m.load_valid[:: m.load_stride]) > 0.5
        over = Bridge.over(~trusted)
        trusted[:settle] = False
        if index == 0 and np.any(trusted & (m.counts > 0.5)):
            trusted &= m.counts > 0.5
        a, b = (_motion_band(over.across(values), rate)[trusted] for values in (a, b))
        told = _significant(a, b)
        out.append(Gain(channel, unit, _rms(a), _rms(b), told, _rms(m.torque[trusted]) if index == 0 else 0.0))
    return tuple(out)


def _folds(weight: Array) -> list[Rows]:
    """Rows of each fold: blocks of as many rows that count in each, dealt out one after the other."""
    gone = np.cumsum(weight)
    edges = np.searchsorted(gone, np.linspace(0.0, float(gone[-1]), BLOCKS + 1)[1:-1])
    block = np.searchsorted(edges, np.arange(weight.size), side="right")
    return [block % FOLDS == fold for fold in range(FOLDS)]


def _motion_band(values: Array, rate_hz: float) -> Array:
    """Below 40 Hz (Butterworth of order 4, forth and back): what decimation to 100 Hz leaves in the literature."""
    if rate_hz < 2.5 * CUT_HZ:
        return values
    return np.asarray(sosfiltfilt(butter(4, CUT_HZ, fs=rate_hz, output="sos"), values))


def _held_out(
    problem: Problem, fit: Fit, terms: Sequence[Term], freed: Sequence[Term], folds: Sequence[Rows]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """What is left of unseen rows of both channels [N m]; the same once corrected by what others say of the doubts."""
    m = problem.measurement
    reported = {t.key for t in terms}
    given = problem.numbers()
    as_described = {n: given.get(n, 0.0) for t in freed if t.key not in reported for n in t.replaces if n in fit.values}
    torque, corrected = np.zeros(m.samples), np.zeros(m.samples)
    guide = np.zeros((m.samples + m.load_stride - 1) // m.load_stride if problem.guided else 0)
    times = (name for t in fit.terms if t.traits.once for name in t.shape)
    refits = Refits.of(fit, (*START, MOTOR_RELEASE, MOTOR_STRETCH, *times))
    for unseen in folds:
        at_load = unseen[:: m.load_stride][: guide.size]
        values = without(fit, refits, np.concatenate([unseen, at_load])) | as_described
        a, b = problem.raw_residuals(terms, values, weighted=False)
        expected = by_doubts(m, problem.noise, a, unseen) if terms else np.zeros(m.samples)
        torque[unseen], corrected[unseen] = a[unseen], (a - expected)[unseen]
        guide[at_load] = b[at_load]
    return (torque, guide), (corrected, guide)


def without(fit: Fit, refits: Refits, left_out: NDArray[np.bool_]) -> dict[str, float]:
    """Numbers of the fit to all rows but `left_out`, within what is allowed."""
    steps = refits.steps(refits.jacobian[left_out], fit.residual[left_out])
    moving = [p for p, moves in zip(fit.parameters, refits.moving, strict=True) if moves]
    moved = {p.name: fit.values[p.name] + s * p.step for p, s in zip(moving, steps, strict=True)}
    return {**fit.values, **{p.name: float(np.clip(moved[p.name], p.low, p.high)) for p in moving}}


def _significant(before: Array, after: Array, blocks: int = 20) -> bool:
    """Whether the drop of the squares is beyond twice its standard error over blocks."""
    size = before.size // blocks
    if size == 0:
        return False
    drop = (before**2 - after**2)[: size * blocks].reshape(blocks, size).mean(axis=1)
    return bool(drop.mean() > 2.0 * drop.std(ddof=1) / np.sqrt(blocks))


def _rms(values: Array | Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
