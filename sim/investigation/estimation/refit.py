"""Fits taken anew: under noise of their own, from what is described, with other rows, for their numbers."""

from __future__ import annotations

import math

import numpy as np

from sim.investigation.data.preprocessing import MOTION_CUT_HZ, gaussian_kernel
from sim.investigation.estimation.doubts import by_doubts
from sim.investigation.estimation.estimate import Array, Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.whitening import LONG, Noise
from sim.investigation.hypotheses.hypothesis import OVER_SPEED
from sim.investigation.hypotheses.nonparametric import apart
from sim.investigation.model.nominal import MOTOR_RELEASE, MOTOR_STRETCH, MOTOR_STRETCH_RAD, has_links

MOTION_BAND_HZ = 40.0
PLAIN_FITS = 2  # the second by what the first leaves of each channel
FAR_BENT = 2.5  # standard deviations of what is known of a number
LONGER = (10.0, 100.0)  # times the way of a contact: one and two of its deviations, up to a motor ahead of a gear
COUNTS = 0.5  # weight of a row that counts
AT_REST = 1.3  # times the mean square in motion: what is more is not the noise of rows whose friction is known
LEAST_STRETCH_RAD = 1.5e-4  # a micrometre and a half on a centimetre, three steps of an encoder of 17 bits


def calibrate(problem: Problem) -> tuple[Problem, Fit]:
    """Fit what the description has, whitened by what the description itself leaves, then by what the fit leaves."""
    described = problem.fit(iterations=0)
    problem = problem.with_noise(problem.noise_of(described)).with_predictable_rows((), described.values)
    return multistart(*rewhiten(problem, problem.fit(held=described.sensitivities)))


def rewhiten(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Take the noise from the residual of `fit`, fit again."""
    anew = problem.with_reestimated_noise(fit).with_predictable_rows(fit.terms, fit.values)
    same = (anew.measurement.predictable == problem.measurement.predictable).all()  # one may be a single 1 for all rows
    held = fit.sensitivities if same else {}  # those of rows that did not count are not known
    return anew, anew.fit(fit.terms, fit.values, held=held, to_end=True)


def multistart(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Where a fit bends what is described, one from there and its noise, if it bends less and is likelier.

    Numbers that stood for a mechanism before it came in make noise of what they get wrong, and that keeps them there.
    Begins at the description; then with those alone put back that are bent far: one number that the description has
    wrong is found, and others need not stand for it on the way. Where friction came in that the description leaves out,
    also at plain least squares in the band of the motion: noise taken without that friction holds it, and a fit that
    leaves it to the noise stays there.
    """
    problem, fit = _slid(problem, fit)
    if fit.prior_penalty <= BENT:
        return problem, fit
    near = {p.name: fit.values[p.name] for p in fit.parameters if p.deviation(fit.values) < FAR_BENT}
    begun = [(problem, problem.fit(fit.terms, start, iterations=0)) for start in (fit.own, near)]
    if any(t.traits.in_every_axis for t in fit.terms):
        begun.append(plainly(problem, fit))
    for first, less in begun:
        anew, more = rewhiten(first, less)
        anew, more = rewhiten(anew, more)
        if more.prior_penalty < fit.prior_penalty and anew.neg2_log_posterior(more) < problem.neg2_log_posterior(fit):
            return anew, more
    return problem, fit


def _slid(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """The same, or likelier with friction of a joint that builds up over a way ten or a hundred times as long: one that
    is passed within a row has no slope that would lead to another."""
    if MOTOR_STRETCH not in fit.values or not problem.measurement.doubts.size:
        return problem, fit
    longer = [math.log(times * MOTOR_STRETCH_RAD) for times in LONGER]
    anew = problem.best(fit.terms, [({**fit.values, MOTOR_STRETCH: way}, {}) for way in longer])
    if anew is None or fit.cost - anew.cost < problem.memory.least_drop:
        return problem, fit
    return rewhiten(problem, anew)


def plainly(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """The terms of `fit` by least squares in the band of the motion, every frequency of it alike; of both channels what
    is left counts as one unit."""
    more = fit
    for _ in range(PLAIN_FITS):
        problem = problem.with_noise(noise_in_band(problem, more))
        more = problem.fit(more.terms, more.values, to_end=True)
    return problem, more


def noise_in_band(problem: Problem, fit: Fit) -> Noise:
    """As loud as what `fit` leaves in the band of the motion, and white in it."""
    m = problem.measurement
    taps = []
    left = problem.raw_residuals(fit.terms, fit.values)
    rates = (m.rate_hz, m.rate_hz / m.load_stride)
    for values, weight, rate_hz in zip(left, (m.weight, m.load_weight[:: m.load_stride]), rates, strict=True):
        kernel = gaussian_kernel(min(MOTION_CUT_HZ, 0.1 * rate_hz), rate_hz, 0)
        level = _level(np.asarray(np.convolve(values, kernel, "same"), np.float64), weight) if values.size else 0.0
        taps.append(kernel / level if level else np.ones(1))
    return Noise(taps[0], taps[1])


def _level(values: Array, weight: Array) -> float:
    """Deviation in the rows that count."""
    counts = weight > COUNTS
    return float(np.std(values[counts] if counts.any() else values))


def all_rows(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """With those in which teeth rattle, where play and dents show."""
    problem = problem.with_all_rows().with_reestimated_noise(fit)
    return problem, problem.fit(fit.terms, fit.values, to_end=True)


def with_slow_noise(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Rows at rest, where they tell, and slow noise; what friction holds at rest is fitted before noise is taken.

    A contact that gives way by less than the motor's encoder sees, and holds on within a thousandth of the largest
    speed, holds whatever it likes: rows at rest say nothing. Nor do they where more is left at rest than in motion:
    friction that sticks for good holds by what the servo did before.
    """
    problem = problem.remembering(LONG)
    resting = problem.resting(fit)
    if resting.measurement.rests:
        more = resting.fit(fit.terms, fit.values, held=fit.sensitivities, to_end=True)
        resting, more = rewhiten(resting, more)
        holds_on = math.exp(more.values[MOTOR_STRETCH]) > LEAST_STRETCH_RAD or more.values[MOTOR_RELEASE] > 0.0
        if holds_on and _left_at_rest(resting, more) < AT_REST:
            return resting, more
    return rewhiten(problem, fit)


def _left_at_rest(problem: Problem, fit: Fit) -> float:
    """Mean square of the whitened torque in rows at rest over that in motion [1]."""
    m = problem.measurement
    speed = np.abs(m.speed)
    slow = speed < m.standstill * float(speed.max())
    square, used = fit.residual[: m.samples] ** 2, m.weight > COUNTS
    at_rest, in_motion = square[used & slow], square[used & ~slow]
    return float(at_rest.mean() / in_motion.mean()) if at_rest.size and in_motion.size else 1.0


def final_fit(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """Last fit, whose numbers of friction share nothing with curves over the speed.

    With gears, of curves without what friction is. Of one stiff body by plain least squares in the band of its motion,
    without curves: a body has little else. Whitened rows weigh most what is fast, where a body's model is least true to
    its form; the least squares of the band in which torque is predicted are what its numbers are for.
    """
    if has_links(problem.axis):
        return problem, _apart(problem, fit)
    terms = tuple(t for t in fit.terms if t.mechanism != OVER_SPEED)
    plain = fit if len(terms) == len(fit.terms) else problem.fit(terms, fit.values)
    torque, _ = problem.raw_residuals(terms, plain.values)
    m = problem.measurement
    kernel = gaussian_kernel(MOTION_BAND_HZ, m.rate_hz, 0)
    torque = torque - m.across(by_doubts(m, problem.noise, torque))
    left = _level(np.asarray(np.convolve(torque, kernel, "same"), np.float64), m.weight)
    noise = Noise(kernel / max(left, 1e-300), np.ones(1)).with_inflated_prior(m.wrong_ways, m.awake)
    in_band = problem.with_noise(noise)
    return in_band, in_band.fit(terms, plain.values, held=plain.sensitivities)


def _apart(problem: Problem, fit: Fit) -> Fit:
    """`fit` with curves over the speed that share nothing with the numbers of friction."""
    curves = {t.key: apart(t, problem.measurement) for t in fit.terms if t.mechanism == OVER_SPEED}
    if not curves:
        return fit
    own = {p.name for t in curves.values() for p in t.parameters}
    start = {name: 0.0 if name in own else value for name, value in fit.values.items()}
    return problem.fit([curves.get(t.key, t) for t in fit.terms], start, to_end=True)


BENT = 60.0  # squared deviations of what is described from what the fit makes of it
