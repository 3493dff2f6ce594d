"""Whether a term is worth its place: what it must bring, how large it must be, on which rows it must hold."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from sim.discrepancy.estimation.estimate import Fit
from sim.discrepancy.hypotheses.friction import LEFT_OUT
from sim.discrepancy.hypotheses.hypothesis import Term
from sim.discrepancy.hypotheses.nonparametric import AS_NEW, ERROR_OVER_ANGLE, FIXED, OVER_ANGLE, OVER_SPEED
from sim.discrepancy.search.blocked_cross_validation import BLOCKS, advantage, gain_elsewhere, paired

FORM_SHARE = 0.015  # of another's gain: what any law leaves of its form
LEAVES = {  # the same of laws that leave more or less
    "backlash": 0.06, "tooth_damage": 0.06,  # teeth that hit
    OVER_SPEED: 0.2, OVER_ANGLE: 0.2,  # a curve stands for a law that has no name
    "structural_resonance": 0.2,  # it is driven by the load as it was measured, noise and all
    "electrical_hum": 0.0,  # a sine in the current has no other form
}  # fmt: skip
DELAY_SHARE = 0.1  # a shift in time has the shape of what most errors of form leave
LAWS = (  # of one part of the machine, and the share of another's gain below which one is the error of its form
    (frozenset({"backlash", "tooth_damage", "stiffness_hardening", "hysteresis"}), 0.1),
    (frozenset({"stribeck_friction", "load_dependent_loss", "friction_asymmetry"}), 0.35),
    (frozenset({"hysteresis", "stribeck_friction", "load_dependent_loss", "friction_asymmetry"}), 0.1),
    (frozenset({"torque_offset", "friction_asymmetry"}), 0.1),  # they differ at rest
    (frozenset({"mesh_error", "torque_ripple"}), 0.05),
    (frozenset({"mesh_error", "tooth_damage"}), 0.05),
    (frozenset({"eccentricity", "tooth_damage"}), 0.05),
    (frozenset({"kinematic_error", "torque_ripple"}), 0.1),
    (frozenset({"eccentricity", "torque_ripple"}), 0.1),  # an error of teeth also varies the ratio of the torques
)
DAMPING = {"hysteresis": 0.4, "load_dependent_loss": 0.1}  # of what erring teeth gain: less damps what they shake
OF_STRAIN = {  # what must be gained over what the description is bent by beyond chance
    "tooth_damage": 1.1, "stiffness_hardening": 1.1, "hysteresis": 1.1, "torque_offset": 0.4,
}  # fmt: skip
BENDING = 7.0  # gain over what the description is bent by more with a term: less, and the term stands for another
ERRORS = ("mesh_error", "eccentricity", "kinematic_error", AS_NEW)  # every new axis has them, if small
CONSTANT = ("torque_offset",)  # known beforehand within a little: what it gains over that is no error of a form
LIKE_AN_OFFSET = ("friction_asymmetry",)  # the same torque while anything moves, and every model has an offset
LEAST_SHARE = 0.0006  # of the squared residual: what the form of a model differs from any real axis
LEAST_SHARES = {  # of what bends to much
    f"{OVER_SPEED}@motor": 0.003, f"{OVER_SPEED}@load": 0.002, OVER_ANGLE: 0.002, FIXED: 0.002, ERROR_OVER_ANGLE: 0.002,
    "structural_resonance": 0.003, "hysteresis": 0.001, "stiffness_hardening": 0.0007, "tooth_damage": 0.004,
}  # fmt: skip
QUIET = 0.5  # of the rows: the least squares of which that is a share, where there is hardly any noise
LEAST_GAIN = 20.0  # whitened squares: the same for a short record, and what a screened term must promise
LEAST_GAINS = {  # of what nothing else bends to: 110 new axes promise it 2, 14, 7, 7, 24, 15 and 14 squares at most
    "coulomb_friction": 13.0, "viscous_friction": 13.0, "torque_offset": 10.0,
    "stribeck_friction": 15.0, "friction_asymmetry": 18.0, "time_delay": 13.0,
    "load_dependent_loss": 20.0, "gravity_imbalance": 16.0, "friction_drift": 16.0,
}  # fmt: skip
OVER_STROKES = ("torque_offset", "stribeck_friction", "friction_asymmetry", "load_dependent_loss")
STROKE_ROWS = 50.0  # of theirs, for one that says something of its own: they act over whole strokes
RESTLESS = (FIXED, "electrical_hum", "gravity_imbalance", "torque_offset")  # gain in all blocks
HOLDS_T = 1.5
KEPT_SHARE = 0.33  # of a gain, on rows not seen
MUCH = {"backlash": 0.02, "tooth_damage": 0.2}  # of the squared residual
AGAINST = 0.1  # of a gain, which unseen rows by themselves may lose
LARGEST_LOSS = 3.0  # times the median over blocks
BEYOND = 2.0  # standard deviations
TEMPERATURE = 0.3  # model errors make the residual less informative than its whitened length says


def penalty(term: Term, rows: int) -> float:
    """Nats that a term must pay: half a log of the rows for each number, and for the places it was looked for.

    Nothing for what every axis has: a description without friction is one that leaves it out. Nor for numbers of the
    description that the term only sets free, nor for those of a usual size: what they deviate from it costs squares.
    """
    if term.mechanism in LEFT_OUT:
        return 0.0
    looks = 8.0 if term.mechanism == "tooth_damage" else math.log(max(len(term.probes), term.among, 1) + 1.0)
    telling = rows / STROKE_ROWS if term.mechanism in OVER_STROKES else rows
    own = sum(p.name not in term.replaces and math.isinf(p.spread) for p in term.parameters)
    return 0.5 * own * math.log(max(telling, 2.0)) + looks


def evidence(term: Term, gain: float, rows: int) -> float:
    """Tempered log odds that the term belongs to the model."""
    return TEMPERATURE * (0.5 * gain - penalty(term, rows))


def least_gain(term: Term) -> float:
    """Drop of the whitened sum of squares below which a term is not looked at."""
    return LEAST_GAINS.get(term.mechanism, LEAST_GAIN)


def matters(term: Term, gain: float, fit: Fit) -> bool:
    """Whether a gain is more than what the form of a model differs from any axis.

    Laws of a spring bend to whatever is missing, and so does the description beside them: where it is bent by as much,
    something else is. An offset is a number of the description itself, and where all are bent, so is it.
    """
    if gain < OF_STRAIN.get(term.mechanism, 0.0) * (fit.prior_penalty - len(fit.parameters)):
        return False
    return gain >= max(form_gain(term, fit), least_gain(term) * max(1.0, fit.misfit / fit.residual.size))


def form_gain(term: Term, fit: Fit) -> float:
    """Whitened squares that a term may gain because no model has quite the form of an axis: less says nothing."""
    share = LEAST_SHARES.get(term.key, LEAST_SHARES.get(term.mechanism, LEAST_SHARE))
    return share * max(fit.misfit, QUIET * fit.residual.size) * least_gain(term) / LEAST_GAIN


def shifts_prior(term: Term, less: Fit, more: Fit, gain: float) -> bool:
    """Whether a term bends the description further, for what it gains: a cause that was missing lets it go back.

    Friction that was left out brings numbers of its own, which are known beforehand only roughly.
    """
    return term.mechanism not in LEFT_OUT and gain < BENDING * (more.prior_penalty - less.prior_penalty)


def wanted(term: Term, far: float) -> bool:
    """Whether a term `far` beyond as new is worth a place: it matters, or nothing always fitted stands for it.

    Play stands for itself: what is always fitted ends below where a gap begins to matter.
    """
    always = term.mechanism == "backlash" or (term.mechanism in ERRORS and not term.replaces)
    return far > BEYOND or (far > -math.inf and always)


def is_model_error(term: Term, gain: float, entered: Mapping[str, float]) -> bool:
    """Whether a mechanism explains so little beside another that it is the error of the other's form.

    Two laws of a spring (gap, bend, loop, dent) or of friction leave each other's errors of form behind. `entered`:
    what each term gained when it came in; later, with what stands for its errors beside it, taking it away says far
    too much.
    """
    return any(gain < form_share(term.mechanism, key.split("@")[0]) * brought for key, brought in entered.items())


def form_share(mechanism: str, other: str) -> float:
    """Share of the gain of `other` below which `mechanism` is the error of its form.

    What every axis has, or what is known beforehand, is that of its like only.
    """
    shares = [share for laws, share in LAWS if {mechanism, other} <= laws]
    if mechanism in LEFT_OUT + CONSTANT:
        return max(shares, default=0.0)
    if mechanism == "time_delay":
        shares.append(DELAY_SHARE)
    if other in ERRORS[:-1] and mechanism in DAMPING:
        shares.append(DAMPING[mechanism])
    return max([LEAVES.get(other, FORM_SHARE), *shares])


def needs_no_trial(term: Term, gain: float, fit: Fit) -> bool:
    """Whether so much is explained that unseen rows need not be asked: where teeth hit, a linear refit says little."""
    return gain > MUCH.get(term.mechanism, math.inf) * fit.misfit


def holds(term: Term, less: Fit, more: Fit) -> bool:
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
    even = paired(drop) > HOLDS_T and float(root.sum()) > 0.45 * float(np.abs(root).sum())
    if term.mechanism in RESTLESS:
        return even
    kept = float(np.maximum(drop, -LARGEST_LOSS * np.median(np.abs(drop))).sum())
    fitted = gain_elsewhere(less, more)
    relief = drop.size / BLOCKS * (less.prior_penalty - more.prior_penalty)
    if term.mechanism not in LIKE_AN_OFFSET + LEFT_OUT and kept - relief < -AGAINST * fitted:
        return False
    least = 0.0 if term.mechanism in LEFT_OUT else least_gain(term)
    return even or (fitted > least and kept > KEPT_SHARE * fitted)
