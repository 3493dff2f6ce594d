"""Whether a term is worth its place: what it must bring, how large it must be, on which rows it must hold."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from sim.investigation.estimation.estimate import Fit
from sim.investigation.hypotheses.hypothesis import Key, Term, traits_of
from sim.investigation.search.held_out_blocks import BLOCKS, advantage, gain_elsewhere, paired
from sim.mechanisms.mechanism import LEAST_GAIN

BENDING = 7.0  # gain over what the description is bent by more with a term: less, and the term stands for another
QUIET = 0.5  # of the rows: the least squares of which that is a share, where there is hardly any noise
PENALTY_OF_SCAN = 8.0  # nats, for all places along the wheels at which a dent was looked for
ROWS_OF_A_HALF_CYCLE = 50.0  # of what acts over whole strokes, for one that says something of its own
LEAST_T = 1.5
LEAST_SHARE_ELSEWHERE = 0.33  # of a gain, on rows not seen
AGAINST = 0.1  # of a gain, which unseen rows by themselves may lose
LARGEST_LOSS = 3.0  # times the median over blocks
LEAST_EFFECT = 2.0  # standard deviations
TEMPERATURE = 0.3  # model errors make the residual less informative than its whitened length says


def penalty(term: Term, rows: int) -> float:
    """Nats that a term must pay: half a log of the rows for each number, and for the places it was looked for.

    Nothing for what every axis has: a description without friction is one that leaves it out. Nor for numbers of the
    description that the term only sets free, nor for those of a usual size: what they deviate from it costs squares.
    """
    if term.traits.in_every_axis:
        return 0.0
    looks = PENALTY_OF_SCAN if term.traits.dent else math.log(max(len(term.probes), term.among, 1) + 1.0)
    telling = rows / ROWS_OF_A_HALF_CYCLE if term.traits.over_strokes else rows
    own = sum(p.name not in term.replaces and math.isinf(p.spread) for p in term.parameters)
    return 0.5 * own * math.log(max(telling, 2.0)) + looks


def evidence(term: Term, gain: float, rows: int) -> float:
    """Tempered log odds that the term belongs to the model."""
    return TEMPERATURE * (0.5 * gain - penalty(term, rows))


def least_gain(term: Term) -> float:
    """Drop of the whitened sum of squares below which a term is not looked at."""
    return term.traits.least_gain


def exceeds_model_error(term: Term, gain: float, fit: Fit) -> bool:
    """Whether a gain is more than what the form of a model differs from any axis."""
    return gain >= max(form_gain(term, fit), least_gain(term) * max(1.0, fit.misfit / fit.residual.size))


def form_gain(term: Term, fit: Fit) -> float:
    """Whitened squares that a term may gain because no model has quite the form of an axis: less says nothing."""
    share = term.traits.least_share if term.least_share is None else term.least_share
    return share * max(fit.misfit, QUIET * fit.residual.size) * least_gain(term) / LEAST_GAIN


def shifts_prior(term: Term, less: Fit, more: Fit, gain: float) -> bool:
    """Whether a term bends the description further, for what it gains: a cause that was missing lets it go back.

    Friction that was left out brings numbers of its own, which are known beforehand only roughly.
    """
    return not term.traits.in_every_axis and gain < BENDING * (more.prior_penalty - less.prior_penalty)


def is_relevant(term: Term, far: float) -> bool:
    """Whether a term `far` beyond as new is worth a place: it matters, or nothing always fitted stands for it."""
    return far > LEAST_EFFECT or (far > -math.inf and term.as_new_too)


def is_model_error(term: Term, gain: float, entered: Mapping[Key, float]) -> bool:
    """Whether a mechanism explains so little beside another that it is the error of the other's form.

    Two laws of a spring (gap, bend, loop, dent) or of friction leave each other's errors of form behind. `entered`:
    what each term gained when it came in; later, with what stands for its errors beside it, taking it away says far
    too much.
    """
    return any(gain < form_share(term.mechanism, key.mechanism) * brought for key, brought in entered.items())


def form_share(mechanism: str, other: str) -> float:
    """Share of the gain of `other` below which `mechanism` is the error of its form.

    What every axis has, or what is known beforehand, is that of its like only.
    """
    own, its = traits_of(mechanism), traits_of(other)
    shares = [law.share for law in own.laws & its.laws]
    if own.in_every_axis or own.known_within_a_little:
        return max(shares, default=0.0)
    return max(its.form_left, own.form_of_any, own.damping if its.erring_teeth else 0.0, *shares)


def predicts_unseen_rows(term: Term, less: Fit, more: Fit) -> bool:
    """Whether the model with `term` predicts better what it has not seen.

    By 1.5 standard errors and 2.6 to one in sum, both of signed roots, as in `paired`; or, where an effect acts in a
    few blocks only (low speed, large twist, a tooth that is passed once, both ends of a drift), by a third of what it
    gains on the same blocks where they are seen. A loss counts as three typical blocks at most: it may be the linear
    refit that fails without that block. What never rests acts in all of them. That the description goes back to what
    is known counts as well, but not against the rows: where they are predicted worse, it is no reason for a term. For
    what every model has a number of, known beforehand, it is the reason, and for friction that was left out; of that a
    third of any gain is enough.
    """
    drop = advantage(less, more)
    root = np.sign(drop) * np.sqrt(np.abs(drop))
    even = paired(drop) > LEAST_T and float(root.sum()) > 0.45 * float(np.abs(root).sum())
    if term.traits.restless:
        return even
    kept = float(np.maximum(drop, -LARGEST_LOSS * np.median(np.abs(drop))).sum())
    fitted = gain_elsewhere(less, more)
    relief = drop.size / BLOCKS * (less.prior_penalty - more.prior_penalty)
    if not (term.traits.like_an_offset or term.traits.in_every_axis) and kept - relief < -AGAINST * fitted:
        return False
    least = 0.0 if term.traits.in_every_axis else least_gain(term)
    return even or (fitted > least and kept > LEAST_SHARE_ELSEWHERE * fitted)
