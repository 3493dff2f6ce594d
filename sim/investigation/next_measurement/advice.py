"""What an investigation leaves open, and the next measurement in words, as the simulation of both sides tells it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import make_interp_spline

from sim.chain.integrate import run_chain
from sim.chain.model import Array, Chain, Servo, Shaft, with_shaft
from sim.description.axis import Axis
from sim.description.transmission import compliance
from sim.errors import RunError, SimulationError
from sim.investigation.assessment.calibration import WEIGHTS
from sim.investigation.assessment.posterior import against_rivals, existence, is_close
from sim.investigation.data.preprocessing import SLOW_ANGLE_CUT_HZ, SLOW_DIRECT_ANGLE_CUT_HZ, Measurement, prepare
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.whitening import Noise
from sim.investigation.hypotheses.catalogue import all_terms_of
from sim.investigation.hypotheses.hypothesis import ENCODER_ERROR, Term
from sim.investigation.model.known_mechanisms import in_chain
from sim.investigation.model.nominal import has_links, locked_mode_hz, nuisance_of
from sim.investigation.model.observer import delayed
from sim.investigation.model.parameters import Owner
from sim.investigation.next_measurement.plans import PLANS, REPEAT, Plan, Present
from sim.investigation.parallel import each
from sim.investigation.report.formatting import named, number, words_of
from sim.investigation.report.maintenance_actions import SURE
from sim.investigation.results import Difference, MeasurementUtility, digits
from sim.investigation.search.comparison import Model

if TYPE_CHECKING:
    from sim.investigation.results import Finding
    from sim.investigation.search.search import Selection

SEPARATES = 20.0  # squares that a rival must leave beyond the truth: what any mechanism must take away to be named
ENOUGH = 10.0 * SEPARATES
STEPS = 2  # of a fit
FINER = 4  # times the rate of the recording, at which the servo works
STIFF_RAD_S, LEAST_RAD_S, UNLIMITED = 300.0, 60.0, 1e9
ENCODER_RAD = 2.0 * math.pi / 2**20 / math.sqrt(12.0)  # noise of an encoder of 20 bits, as one would add
BINS = (0.0, 0.1, 0.3, 0.6, 1.0)  # of the top speed, by which it is said where two predictions differ
ONE_WAY = 0.5  # mean over root mean square, from which a difference has a sign


def separation_of_rivals(
    problem: Problem, fit: Fit, model: Model, rivals: Mapping[str, Model], name: str
) -> tuple[MeasurementUtility, ...]:
    """Of every measurement that can be simulated what it would tell of a model, by its name, and the rivals by theirs.

    The most for its effort first. `fit`: the present one, whose noise is taken for that of the next measurement.
    """
    present = Present(problem.axis, problem.measurement)
    noise = _noise_of(problem, fit)
    plans = [p for p in (REPEAT, *PLANS) if p.applies(present)]
    moved = [(plan, angle) for plan in plans if (angle := plan.motion(present)) is not None and present.moves(angle)]
    apart = each(lambda p: _apart(problem, noise, *p, model, rivals), moved)
    found = [_as_long(told, present, angle) for (_, angle), told in zip(moved, apart, strict=True)]
    again = next((f for (plan, _), f in zip(moved, found, strict=True) if plan is REPEAT), {})
    out = []
    for (plan, angle), told in zip(moved, found, strict=True):
        worth = sum(min(separation, ENOUGH) for separation, _ in told.values()) / plan.effort
        for rival, (separation, difference) in told.items():
            repeat = again[rival][0] if rival in again else 0.0
            text = plan.says(present, angle)
            out.append(MeasurementUtility(text, (name, rival), separation, repeat, plan.effort, worth, difference))
    return tuple(sorted(out, key=lambda t: (-digits(t.worth), -digits(t.separation), t.text, t.between)))


Apart = dict[str, tuple[float, Difference]]


def _as_long(told: Apart, present: Present, angle: Array) -> Apart:
    """The same of a recording as long as it is to be, whose squares add up."""
    times = present.seconds * present.rate_hz / angle.size
    return {rival: (times * separation, difference) for rival, (separation, difference) in told.items()}


def _apart(
    problem: Problem, noise: Noise, plan: Plan, angle: Array, model: Model, rivals: Mapping[str, Model]
) -> Apart:
    """How far each rival is told from the model; empty where one of them cannot be simulated like this."""
    out: Apart = {}
    try:
        true = _Simulated(problem, noise, plan, angle, model)
        for name, rival in rivals.items():
            out[name] = true.against(rival)
            if rival.terms == tuple(t for t in model.terms if t in rival.terms):
                continue  # the model holds the rival, and leaves nothing of its data
            separation, difference = _Simulated(problem, noise, plan, angle, rival).against(model)
            if separation < out[name][0]:
                out[name] = separation, replace(difference, more=-difference.more)
    except SimulationError:
        return {}
    return out


class _Simulated:
    """A measurement that a model has made, and that model fitted to it."""

    def __init__(self, problem: Problem, noise: Noise, plan: Plan, angle: Array, true: Model) -> None:
        axis = in_chain(problem.axis)
        axis = replace(axis, load=replace(axis.load, inertia_kg_m2=plan.payload * axis.load.inertia_kg_m2))
        true, self.plan, self.recorded = _with_payload(plan, true), plan, problem
        m = simulated(problem, true, angle, guided=problem.guided or plan.load_encoder)
        self.problem = Problem(axis, m, noise, problem.memory)
        chain, hits = self.problem.chain(true.terms, true.values), self.problem.has_contact_loss(true.terms)
        self.problem.observer.learn_noise(chain, nuisance_of(true.values), has_contact_loss=hits)
        self.own = self.problem.fit(true.terms, anew(problem, true), STEPS)

    def against(self, rival: Model) -> tuple[float, Difference]:
        """What a rival leaves of it beyond what the true model leaves, in units of the latter, and where."""
        numbers = anew(self.recorded, _with_payload(self.plan, rival))
        own, other = self.own, self.problem.fit(rival.terms, numbers, STEPS)
        loud = max(1.0, own.misfit / own.residual.size)
        return max(0.0, other.cost - own.cost) / loud, _difference(self.problem, own, other)


def anew(problem: Problem, model: Model) -> dict[str, float]:
    """Numbers of a model of a problem in another recording: what belongs to one motion alone is 0."""
    own = {p.name for p in problem.parameters(model.terms) if p.owner is Owner.MOTION}
    return {name: 0.0 if name in own else value for name, value in model.values.items()}


def _with_payload(plan: Plan, model: Model) -> Model:
    name = "load.inertia_kg_m2"
    changed = {name: plan.payload * model.values[name]} if name in model.values else {}
    return replace(model, values={**model.values, **changed})


def simulated(problem: Problem, model: Model, angle: Array, *, guided: bool) -> Measurement:
    """What would be measured of a model whose motor moves along `angle` [rad], without noise.

    Raises SimulationError where that cannot be.
    """
    m, values, rate = problem.measurement, anew(problem, model), problem.measurement.rate_hz
    nuisance = nuisance_of(values)
    modelled = problem.chain(model.terms, values)
    chain = _as_simulated(modelled)
    run = run_chain(chain, servo_along(problem.axis, chain, angle, rate), FINER * rate, FINER * (angle.size - 1) + 1)
    motor, load = run.angle_rad[::FINER, 0], run.angle_rad[::FINER, -1]
    torque = run.motor_torque_n_m[::FINER] + _pushing(modelled.shafts[0], run.speed_rad_s[::FINER, 0])
    if not np.isfinite(run.angle_rad).all() or not np.isfinite(torque).all():
        raise RunError("the axis leaves all bounds under the servo that was chosen for it")
    if float(np.abs(torque).max()) >= problem.axis.motor.torque_limit_n_m:
        raise RunError("the motion asks for more torque than the motor has")
    sine, cosine = (values.get(name, 0.0) for name in ENCODER_ERROR)
    load = load + sine * np.sin(load) + cosine * np.cos(load)
    late_s = nuisance.torque_delay_s, nuisance.load_delay_s
    torque, load = (delayed(x, s * rate) if s else x for x, s in zip((torque, load), late_s, strict=True))
    cut = SLOW_ANGLE_CUT_HZ if problem.axis.stages else SLOW_DIRECT_ANGLE_CUT_HZ
    out = prepare(rate, torque, motor, load if guided else None, slow_angle_cut_hz=cut)
    out = replace(out, standstill=m.standstill, rests=m.rests)
    beside = [term.torque(out, values) for term in model.terms if term.torque is not None]
    return replace(out, torque=np.asarray(out.torque + sum(beside)))


def servo_along(axis: Axis, chain: Chain, angle: Array, rate_hz: float) -> Servo:
    """A servo that takes the motor along `angle` [rad], tuned by `motion_profile` unless the axis says how."""
    curve = make_interp_spline(np.arange(angle.size) / rate_hz, angle, k=5)
    time = np.arange(FINER * (angle.size - 1) + 1) / (FINER * rate_hz)
    reflected = np.cumprod([1.0, *(link.ratio for link in chain.links)])
    inertia = sum(shaft.inertia_kg_m2 / ratio**2 for shaft, ratio in zip(chain.shafts, reflected, strict=True))
    lowest = 2.0 * math.pi * locked_mode_hz(axis) if chain.links else STIFF_RAD_S
    bandwidth = axis.servo.speed_bandwidth_rad_s or max(LEAST_RAD_S, lowest / 3.0)
    return Servo(
        np.stack([curve(time), curve(time, 1), inertia * curve(time, 2)]),
        axis.servo.position_gain_per_s or bandwidth / 6.0,
        inertia * bandwidth,
        axis.servo.integral_time_s or 4.0 / bandwidth,
        min(axis.motor.speed_limit_rad_s, UNLIMITED),
        min(axis.motor.torque_limit_n_m, UNLIMITED),
    )


def _as_simulated(chain: Chain) -> Chain:
    """Without friction that pushes."""
    motor = chain.shafts[0]
    frictions = ("coulomb_n_m", "viscous_n_m_s", "coulomb_backward_n_m", "viscous_backward_n_m_s")
    return with_shaft(chain, 0, **{k: max(v, 0.0) for k in frictions if (v := getattr(motor, k)) is not None})


def _pushing(motor: Shaft, speed: Array) -> Array:
    """What friction below zero asks of the motor [N m]: no machine has it, but models of one direction alone may."""
    forward = min(motor.coulomb_n_m, 0.0), min(motor.viscous_n_m_s, 0.0)
    coulomb, viscous = motor.coulomb_backward_n_m, motor.viscous_backward_n_m_s
    backward = (
        forward[0] if coulomb is None else min(coulomb, 0.0),
        forward[1] if viscous is None else min(viscous, 0.0),
    )
    level, slope = (np.where(speed < 0.0, b, f) for f, b in zip(forward, backward, strict=True))
    return np.asarray(level * np.sign(speed) + slope * speed)


def _noise_of(problem: Problem, fit: Fit) -> Noise:
    """The present noise, at all times as loud as the present fit leaves it in the middle of its blocks.

    Of an encoder at the load that is not there yet: what one of 20 bits adds, and what shakes the motor's torque.
    """
    noise, m = problem.noise, problem.measurement
    torque, guide = fit.residual[: fit.torque_rows], fit.residual[fit.torque_rows :]
    level = _loud(noise.torque_level, torque, m.weight)
    if problem.guided:
        weight = m.load_weight[:: m.load_stride]
        return Noise(noise.torque, noise.guide, level, _loud(noise.guide_level, guide, weight))
    if not has_links(problem.axis):
        return Noise(noise.torque, noise.guide, level)
    raw, _ = problem.raw_residuals(fit.terms, fit.values)
    shaken = _rms(raw, m.weight) * problem.axis.ratio
    added = Noise.flat(1.0, math.hypot(ENCODER_RAD / compliance(problem.axis), shaken))
    return replace(added, torque=noise.torque, torque_level=level)


def _loud(level: Array, residual: Array, weight: Array) -> Array:
    return np.full(1, float(np.median(level)) * max(1.0, _rms(residual, weight)))


def _rms(values: Array, weight: Array) -> float:
    """Root mean square of the rows that count."""
    return math.sqrt(float(np.sum(weight * values**2)) / max(float(np.sum(weight)), 1.0))


def _difference(problem: Problem, own: Fit, other: Fit) -> Difference:
    """Where the two predictions differ most, in the channel in which that tells most."""
    m, rows = problem.measurement, problem.measurement.samples
    gained = other.residual**2 - own.residual**2
    at_motor = not problem.guided or float(np.sum(gained[:rows])) >= float(np.sum(gained[rows:]))
    channel, stride = ("motor_torque_nm", 1) if at_motor else ("load_torque_nm", m.load_stride)
    left, least = (problem.raw_residuals(f.terms, f.values)[0 if at_motor else 1] for f in (other, own))
    speed = m.slow_speed[::stride] / problem.axis.ratio
    counts = (m.weight if at_motor else m.load_weight)[::stride] > 0.5
    top = float(np.abs(speed).max())
    parts = []
    for low, high in pairwise(BINS):
        inside = (np.abs(speed) >= low * top) & (np.abs(speed) <= high * top) & counts
        along = (left - least)[inside] * np.sign(speed[inside])
        size = math.sqrt(float(np.mean(along**2))) if along.size else 0.0
        way = float(np.mean(along)) if along.size else 0.0
        more = int(math.copysign(1.0, way)) if at_motor and abs(way) > ONE_WAY * size > 0.0 else 0
        parts.append(Difference(channel, size, low * top, high * top, more))
    return max(parts, key=lambda part: part.torque_n_m)


NOTHING = "nothing"
MOST_RIVALS = 2  # at once: the closest
LARGEST = 100.0  # times as clear: beyond, nobody counts


def simulated_advice(selection: Selection, findings: Sequence[Finding]) -> tuple[MeasurementUtility, ...]:
    """What each measurement would tell of what is least sure, the best first; empty where nothing is open."""
    said = {(f.mechanism, f.location): f for f in findings}
    told = {t.key: f for t in selection.found if (f := said.get((t.mechanism, t.location)))}
    for term in sorted((t for t in selection.found if t.key in told), key=lambda t: told[t.key].probability):
        rivals = {} if term.load_torque else _rivals(selection, term, told[term.key])
        if rivals:
            name, model = named(term.mechanism, term.location), selection.standings[term.key].model
            return separation_of_rivals(selection.problem, selection.fit, model, rivals, name)
    return ()


def _rivals(selection: Selection, term: Term, finding: Finding) -> dict[str, Model]:
    """What `term` is to be told from, by name; empty where it is sure, or where that was not fitted."""
    standing = selection.standings[term.key]
    tried = sorted(
        (
            (t, named(other.mechanism, other.location), other, model)
            for (other, t), model in zip(standing.rivals, standing.instead, strict=True)
            if other.load_torque is None
        ),
        key=lambda one: one[:2],
    )
    alike = {
        name: model
        for t, name, other, model in tried
        if is_close(t) or other.mechanism in finding.indistinguishable_from
    }
    if finding.lacks:
        alike |= _the_same(selection, term, finding)
    if alike or finding.indistinguishable_from or finding.probability >= SURE or finding.evidence is None:
        return dict(list(alike.items())[:MOST_RIVALS])
    exists = 1.0 / (1.0 + math.exp(-existence(finding.evidence)))
    if tried and against_rivals(finding.evidence.rivals, WEIGHTS.overdispersion) < exists:
        return {tried[0][1]: tried[0][3]}
    rest = tuple(t for t in standing.model.terms if t.key != term.key)
    without = selection.problem.best(rest, [(standing.model.values, {})], to_end=False)
    return {NOTHING: Model.of(without)} if without else {}


def _the_same(selection: Selection, term: Term, finding: Finding) -> dict[str, Model]:
    """Models with what this record cannot tell from `term` in its place: nobody looked for it, since it is the same."""
    problem, standing = selection.problem, selection.standings[term.key]
    rest = tuple(t for t in standing.model.terms if t.key != term.key)
    present = problem.chain(standing.model.terms, standing.model.values)
    out: dict[str, Model] = {}
    for other in all_terms_of(problem.axis, problem.measurement, present):
        name = named(other.mechanism, other.location)
        if other.mechanism in finding.indistinguishable_from and name not in out:
            fit = problem.best((*rest, other), [(standing.model.values, {})], to_end=False)
            out |= {name: Model.of(fit)} if fit else {}
    return out


def in_words(told: Sequence[MeasurementUtility]) -> str:
    """The best measurement and what it would show; empty where none tells the two causes apart."""
    if not told or told[0].separation < SEPARATES:
        return ""
    best, difference = told[0], told[0].difference
    first, second = best.between if difference.more >= 0 else best.between[::-1]
    size = f"{number(difference.torque_n_m)} N m"
    above = f"from {number(difference.low)} to" if difference.low else "below"
    where = f"{above} {number(difference.high)} rad/s of the load"
    if difference.more:
        shows = f"{_with(first)} still needs {size} more motor torque than one {_with(second)}, most {where}"
    else:
        apart = f"still differ by {size} in the {words_of(difference.channel)}"
        shows = f"{_with(first)} and one {_with(second)} {apart}, most {where}"
    doing = f"{best.text}, with all channels logged."
    return f"{doing} By simulation, with all numbers fitted, an axis {shows}. {_clearer(best)}"


def _with(name: str) -> str:
    return "without it" if name == NOTHING else f"with {name}"


def _clearer(best: MeasurementUtility) -> str:
    """How much more it tells than a repeat."""
    if best.text.startswith(f"{REPEAT.text}, for"):
        return "The same motion is enough: more of it tells them apart."
    times = best.separation / max(best.repeat, 1.0)
    said = f"over {LARGEST:.0f}" if times > LARGEST else f"{times:.2g}"
    return f"That tells them apart {said} times as clearly as a repeat of the present motion."
