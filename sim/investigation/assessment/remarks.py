"""Remarks about a fit: what the numbers cannot be trusted with, and which rows did not count."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from sim.description.axis import Axis
from sim.investigation.assessment.misfit import UNREACHED
from sim.investigation.data.excitation import Excitation, lacking_at
from sim.investigation.estimation.estimate import Fit
from sim.investigation.estimation.problem import Problem
from sim.investigation.hypotheses.identifiability import highest_order, passed_slowly, passing_hz, shown
from sim.investigation.model.parameters import Owner
from sim.investigation.report.formatting import named, percent
from sim.investigation.results import Gain, Limit
from sim.mechanisms import MECHANISMS
from sim.mechanisms.mechanism import Need

SOLID = ("kg m2", "N m/rad")  # units of inertia and stiffness, in which no data sheet is far wrong


def misfit_remarks(fit: Fit, gained: Sequence[Gain], unknown: Collection[str]) -> tuple[Limit, ...]:
    """Why the numbers of the last fit are not to be trusted, if anything says so; `unknown`: those nobody gave."""
    out = []
    torque = gained[0]
    measured, left = torque.rms_measured, torque.rms_after
    if left > UNREACHED * measured:
        out.append(
            f"The model does not fit the measurement: of {measured:.3g} {torque.unit} rms torque in motion, "
            f"{left:.3g} are unexplained. Check the description, the units and signs of the channels, and "
            "what happened during the record before you use any of these numbers."
        )
    at_limit = [
        p
        for p, limit in zip(fit.parameters, fit.at_limit, strict=True)
        if limit and p.owner is Owner.DESCRIPTION and p.unit in SOLID
    ]
    bent = [f"{p.name} {p.expected:.3g} -> {fit.values[p.name]:.3g}" for p in at_limit if p.name not in unknown]
    if bent:
        out.append(
            f"To explain the data the description would have to be wrong by a factor of 2.5: {', '.join(bent)}. "
            "Either the description is of another axis, or something is missing that no mechanism explains."
        )
    extreme = [f"{p.name} {fit.values[p.name]:.3g} {p.unit}" for p in at_limit if p.name in unknown]
    if extreme:
        out.append(
            f"The data ask for an extreme value of what the description leaves open: {', '.join(extreme)}, where the "
            "search ended. Use no such value, and doubt the sizes found: check ratio, load, and units of the channels."
        )
    return tuple(map(Limit, out))


def description_remarks(problem: Problem, fit: Fit) -> tuple[Limit, ...]:
    """Numbers of the description that were taken for wrong."""
    wrong = [
        f"{p.name} {p.expected:.3g} -> {fit.values[p.name]:.3g}" for p in fit.parameters if p.name in problem.doubts
    ]
    if not wrong:
        return ()
    told = (
        f"The data contradict the description: {', '.join(wrong)}. Either these values are wrong there, or something "
        "is missing that is too weak to be named. Check these values first."
    )
    return (Limit(told),)


def shown_remark(axis: Axis, e: Excitation) -> str:
    """What can be found in such a record and what cannot, said before anything is looked for."""
    said = shown(axis, e)
    fastest = highest_order(e)
    reach = f" (at the usual speed up to {fastest} times per turn of the motor)" if fastest else ""
    of_any_order = {name for name, kind in MECHANISMS.items() if kind.traits.identified_by == "order"}
    found = [named(name) + _at(places) + reach * (name in of_any_order) for name, places in said.found.items()]
    out = [
        f"{e.rate_hz:.4g} rows per second for {e.seconds:.3g} s of {'two encoders' if e.at_load else 'one encoder'} "
        f"can show: {', '.join(found)}."
    ]
    hidden = [
        f"{', '.join(named(name) + _at(places) for name, places in those.items())} (needs {need.value})"
        for need, those in said.hidden.items()
    ]
    if hidden:
        out.append(f"They cannot show: {'; '.join(hidden)}.")
    return " ".join([*out, *_passing_teeth(axis, e)])


def _at(places: Sequence[str]) -> str:
    return f" at {' and '.join(places)}" if places else ""


def _passing_teeth(axis: Axis, e: Excitation) -> list[str]:
    """Where teeth pass faster than every second row at the usual speed: how fast, and in how many rows they do not."""
    if not e.speed.size:
        return []
    pace, half, out = float(np.median(np.abs(e.speed))), 0.5 * e.rate_hz, []
    for stage in axis.stages:
        passing = passing_hz(axis, stage.name) * pace
        if passing >= half:
            slow = percent(passed_slowly(axis, e, stage.name) / e.speed.size)
            out.append(
                f"Teeth of {stage.name} pass {passing:.3g} times per second at the usual speed, more than half the "
                f"rate: {slow} of the rows in motion are slow enough for them."
            )
    return out


def excitation_remarks(e: Excitation) -> tuple[str, ...]:
    """What the motion of the record does not show, and what to record."""
    out = []
    for need in sorted(lacking_at(e.speed), key=list(Need).index):
        alike = [named(name) for name, kind in MECHANISMS.items() if need in kind.needs]
        unseen = [named(name) for name, kind in MECHANISMS.items() if need in kind.shown_by]
        also = f" It shows no {' and no '.join(unseen)}." if unseen else ""
        out.append(
            f"This record has no {need.value}: in it {', '.join(alike[:-1])} and {alike[-1]} are the same torque, and "
            f"look the same.{also} Record {need.value}."
        )
    return tuple(out)


def standstill_remarks(problem: Problem) -> tuple[str, ...]:
    """Which rows did not count, if any."""
    m = problem.measurement
    if m.rests and not problem.guided:
        return ()
    slowest = m.standstill * float(np.abs(m.speed).max())
    where = " at the load" if m.rests else ""
    told = f"Rows in which the motor turns slower than {slowest:.2g} rad/s do not count{where}"
    return (f"{told}: at rest dry friction takes any torque up to its limit.",)


def contact_loss_remarks(problem: Problem) -> tuple[str, ...]:
    """In how many rows teeth rattle, if in any."""
    lost = 1.0 - float(problem.measurement.predictable.mean())
    if lost == 0.0:
        return ()
    return (
        f"In {100.0 * lost:.2g} % of the rows nothing presses the teeth together, and they rattle within the backlash "
        "of a new gear. Their torque is not predictable there, so these rows do not count. A load that always pulls "
        "one way presses the teeth together.",
    )
