"""A mechanism of the catalogue is considered by what it says of itself, and described as it is found."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import geared, one_body
from signals.telemetry import Telemetry
from sim import mechanisms
from sim.chain.components import TorqueWave
from sim.description.axis import Axis
from sim.description.axis_document import read_axis
from sim.experiment.virtual_measurement import measure
from sim.investigation.data.validation import examine
from sim.investigation.estimation.problem import Problem
from sim.investigation.estimation.whitening import Noise
from sim.investigation.extended_axis import extended_by
from sim.investigation.hypotheses.catalogue import all_terms_of, terms_of
from sim.investigation.hypotheses.generic import terms_of_kind
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.investigate import investigate
from sim.investigation.results import Investigation
from sim.mechanisms.catalogue import with_mechanism
from sim.mechanisms.locations import stage_names, with_error
from sim.mechanisms.mechanism import Measurement, Mechanics, Mechanism, Parameter, Signature
from sim.rotational.drive_train import DriveTrain
from tests.sim.axes import WRIST

BENCH = read_axis(
    {
        "name": "bench",
        "motor": {"inertia_kg_m2": 0.3, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02},
        "load": {"inertia_kg_m2": 0.0},
    }
)
GEARED = read_axis(
    {
        **WRIST,
        "stages": [{**WRIST["stages"][0], "backlash_rad": 2e-5, "transmission_error_rad": 1e-6}],
        "load": {**WRIST["load"], "viscous_friction_n_m_s_per_rad": 3.0},
        "load_encoder": {"error_rad": 1e-5},
    }
)


class Misalignment(Mechanics):
    """Two shafts that are not in line let the driven gear lag twice per turn."""

    name: ClassVar[str] = "misalignment"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("amplitude_rad", "rad", 0.0, 0.01, 1e-4),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size: ClassVar[str] = "amplitude_rad"
    signature: ClassVar[Signature] = Signature("angle", order=2.0)

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return stage_names(axis)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        return with_error(train, place, 2.0, self["amplitude_rad"], self["phase_rad"])


class CyclicDrag(Mechanics):
    """A lubricator brakes the motor and lets it go, in a time of its own."""

    name: ClassVar[str] = "cyclic_drag"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("torque_n_m", "N m", 0.0, 100.0, 0.1),
        Parameter("frequency_hz", "Hz", 0.1, 100.0, 1.0),
        Parameter("phase_rad", "rad", -math.pi, math.pi, 0.0, periodic=True),
    )
    size: ClassVar[str] = "torque_n_m"
    signature: ClassVar[Signature] = Signature("frequency")

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str, ...]:
        return ("motor",)

    def act(self, train: DriveTrain, place: str) -> DriveTrain:
        drag = TorqueWave(self["torque_n_m"], self["frequency_hz"], self["phase_rad"])
        return train.add("drag", drag, flange="motor.flange_a")


class Saturation(Measurement):
    """A current sensor reads large torques too small."""

    name: ClassVar[str] = "saturation"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("bend_per_n2_m2", "1/(N2 m2)", 0.0, 1.0, 1e-5),)
    size: ClassVar[str] = "bend_per_n2_m2"
    signature: ClassVar[Signature] = Signature("recording")

    @classmethod
    def locations(cls, axis: Axis) -> tuple[str | None, ...]:
        return ("motor",)

    def distort(self, telemetry: Telemetry, axis: Axis, seed: int = 0) -> Telemetry:
        torque = telemetry["motor_torque_nm"]
        read = torque * (1.0 - self["bend_per_n2_m2"] * torque**2)
        return replace(telemetry, channels={**telemetry.channels, "motor_torque_nm": read})


@pytest.fixture
def grown(monkeypatch: pytest.MonkeyPatch) -> Mapping[str, type[Mechanism]]:
    """The catalogue with one line more for each of the three."""
    more = MappingProxyType(
        {**mechanisms.MECHANISMS, "misalignment": Misalignment, "cyclic_drag": CyclicDrag, "saturation": Saturation}
    )
    monkeypatch.setattr(mechanisms, "MECHANISMS", more)
    return more


def named(result: Investigation) -> dict[str, float]:
    """Names that are said, and the first number of each."""
    return {f.mechanism: f.parameters[0].value for f in result.findings if f.probability >= 0.5}


def again(result: Investigation, telemetry: Telemetry) -> Investigation:
    """The same data held against the extended axis, as it is stored."""
    return investigate(read_axis(json.loads(json.dumps(result.document()["extended_axis"]))), telemetry)


def misaligned() -> Telemetry:
    hidden = with_mechanism(GEARED, Misalignment("output", {"amplitude_rad": 1.5e-4, "phase_rad": 0.7}))
    ideal, rng = measure(hidden, 8.0).telemetry, np.random.default_rng(1)
    return Telemetry(
        ideal.time_s,
        {
            "motor_torque_nm": ideal["motor_torque_nm"] + 0.02 * rng.standard_normal(ideal.rows),
            "motor_position_rad": ideal["motor_position_rad"] + 1e-5 * rng.standard_normal(ideal.rows),
            "load_position_rad": ideal["load_position_rad"] + 1e-6 * rng.standard_normal(ideal.rows),
        },
    )


@pytest.mark.usefixtures("grown")
def test_a_new_mechanism_of_the_machine_is_named_measured_and_closed() -> None:
    telemetry = misaligned()
    result = investigate(GEARED, telemetry)
    assert named(result) == {"misalignment": pytest.approx(1.5e-4, rel=0.1)}
    finding = result.findings[0]
    assert finding.location == "output"
    assert finding.parameters[1].value == pytest.approx(0.7, abs=0.1)
    assert finding.explanation.startswith("Misalignment at output: two shafts that are not in line")
    assert again(result, telemetry).verdict == "nothing_missing"


@pytest.mark.usefixtures("grown")
def test_a_new_fault_of_the_torque_channel_is_named_measured_and_closed() -> None:
    telemetry = one_body(0.3, 1.0, 0.02, 5)
    read = Saturation("motor", {"bend_per_n2_m2": 4e-5}).distort(telemetry, BENCH)
    result = investigate(BENCH, read)
    assert named(result) == {"saturation": pytest.approx(4e-5, rel=0.1)}
    assert result.findings[0].parameters[0].unit == "1/(N2 m2)"
    assert again(result, read).verdict == "nothing_missing"


@pytest.mark.usefixtures("grown")
def test_a_new_torque_that_comes_in_a_time_of_its_own_is_named_measured_and_closed() -> None:
    """At a frequency that nobody said and that lies among those of the motion."""
    telemetry = one_body(0.3, 1.0, 0.02, 5)
    drag = 0.15 * np.sin(2.0 * np.pi * 1.37 * telemetry.time_s + 0.9)
    braked = replace(telemetry, channels={**telemetry.channels, "motor_torque_nm": telemetry["motor_torque_nm"] - drag})
    result = investigate(BENCH, braked)
    assert named(result) == {"cyclic_drag": pytest.approx(0.15, rel=0.1)}
    _, frequency, phase = result.findings[0].parameters
    assert frequency.value == pytest.approx(1.37, abs=0.002)
    assert phase.value == pytest.approx(0.9, abs=0.1)
    assert again(result, braked).verdict == "nothing_missing"


def problem() -> Problem:
    return Problem(GEARED, examine(GEARED, geared(0.004, 30.0, 4.0, 30e3, 3)).measurement, Noise.flat(0.05, 1.0))


PROBLEM = problem()
WITHOUT = (  # a shaft more, channels that drive the model, or the sound
    "structural_resonance", "encoder_error", "time_delay", "lost_samples",
)  # fmt: skip
TERMS = terms_of(GEARED, PROBLEM.measurement, PROBLEM.chain((), {p.name: p.start for p in PROBLEM.base()}))


def cases() -> Iterator[Term]:
    """One term of every mechanism and place: of the many of a ripple or of hum the first."""
    seen: set[tuple[str, str | None]] = set()
    for term in TERMS:
        if (term.mechanism, term.location) not in seen:
            seen.add((term.mechanism, term.location))
            yield term


@pytest.mark.parametrize("term", tuple(cases()), ids=lambda t: str(t.key))
def test_what_is_found_is_what_the_extended_axis_describes(term: Term) -> None:
    """The same numbers as a term and as a table of the description predict the same torques.

    But for what the description's own model has in their place (play, tooth errors and encoder errors as new, delays).
    """
    described = {p.name: p.start for p in PROBLEM.base()}
    jump = {name: value for column in term.probes[-1] for name, value in column.items()}
    values = {**described, **{p.name: p.start for p in term.parameters}, **jump}
    axis = extended_by(GEARED, values, {(term.mechanism, term.location): term.report(values)})
    other = PROBLEM.of(axis)
    start = {p.name: p.start for p in other.base()}
    found = PROBLEM.raw_residuals((term,), values, weighted=False)
    stored = other.raw_residuals((), {**values, **start}, weighted=False)
    plain = PROBLEM.raw_residuals((), described, weighted=False)
    for with_term, with_entry, without in zip(found, stored, plain, strict=True):
        effect = float(np.std(with_term - without))
        assert float(np.std(with_term - with_entry)) <= 0.02 * effect + 1e-9


@pytest.mark.parametrize("kind", mechanisms.MECHANISMS.values(), ids=mechanisms.MECHANISMS.keys())
def test_each_would_have_terms_by_what_it_says_of_itself(kind: type[Mechanism]) -> None:
    """Numbers that it accepts, and an effect on a chain of its own train or on the torque that is read."""
    m = PROBLEM.measurement
    terms = list(terms_of_kind(kind, GEARED, m))
    assert bool(terms) == (kind.name not in WITHOUT)
    for term in terms[:6]:
        start = {p.name: p.start for p in PROBLEM.base()}
        values = {**start, **{p.name: p.start for p in term.parameters}, **term.probes[-1][0]}
        assert kind(term.location, term.report(values)).values == term.report(values)
        chain = PROBLEM.chain((), start)
        assert term.torque is not None or term.apply(chain, values) != chain
        assert term.torque is None or term.torque(m, values).any()


RATIO_ALONE = read_axis(
    {
        "name": "of a ratio alone",
        "motor": {"inertia_kg_m2": 0.004},
        "stages": [{"name": "output", "ratio": 30.0}],
        "load": {"inertia_kg_m2": 4.0},
        "load_encoder": {"error_rad": 1e-5},
    }
)


def test_what_is_looked_for_in_a_way_of_its_own_is_looked_for() -> None:
    """`own_hypothesis` alone, such as copied from another mechanism, would make it one that nobody looks for."""
    chain = PROBLEM.chain((), {p.name: p.start for p in PROBLEM.base()})
    axes = (GEARED, RATIO_ALONE)
    written = {term.mechanism for axis in axes for term in all_terms_of(axis, PROBLEM.measurement, chain)}
    for kind in mechanisms.MECHANISMS.values():
        otherwise = kind.traits.dent or kind.traits.once or kind.sound or kind.checked
        assert not kind.traits.own_hypothesis or otherwise or kind.name in written, (
            f"{kind.name}: no term, leave own_hypothesis out"
        )


@pytest.mark.parametrize("term", tuple(cases()), ids=lambda t: str(t.key))
def test_numbers_that_a_term_fits_have_the_units_in_which_they_are_said(term: Term) -> None:
    """But for a wave's cosine and sine, and what the fit names otherwise, of the unit of the mechanism's numbers."""
    units = {p.unit for p in mechanisms.MECHANISMS[term.mechanism].parameters}
    assert {p.unit for p in term.parameters} <= units
