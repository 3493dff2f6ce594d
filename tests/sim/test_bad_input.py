"""Wrong numbers and compositions are refused before any work, with a message that names the parameter."""

from collections.abc import Callable

import numpy as np
import pytest

from sim.errors import ParameterError, SimulationError
from sim.rotational.components import (
    BearingFriction,
    Clutch,
    Constant,
    Damper,
    ElastoBacklash,
    IdealGear,
    Inertia,
    LossyGear,
    Position,
    Sampled,
    Sine,
    Speed,
    Spring,
    SpringDamper,
    Step,
    Torque,
)
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate

NAN = float("nan")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Inertia(J=-1), "Inertia.J: must be > 0 kg.m2, got -1"),
        (lambda: Inertia(J=0), "Inertia.J"),
        (lambda: Inertia(J=NAN), "Inertia.J"),
        (lambda: Inertia(J=1, w=NAN), "Inertia.w"),
        (lambda: Inertia(J=1, a=5), r"Inertia\.a: a start acceleration is not taken.* give phi and w instead"),
        (lambda: SpringDamper(c=1, d=1, a_rel=5), r"SpringDamper\.a_rel: .* give phi_rel and w_rel instead"),
        (lambda: Clutch(fn_max=1, a_rel=0), r"Clutch\.a_rel: a start acceleration is not taken"),
        (lambda: Spring(c=0), "Spring.c: must be > 0 N.m/rad, got 0"),
        (lambda: SpringDamper(c=1, d=-1), "SpringDamper.d"),
        (lambda: Damper(d=float("inf")), "Damper.d"),
        (lambda: ElastoBacklash(c=0, b=1), "ElastoBacklash.c"),
        (lambda: ElastoBacklash(c=1, b=-1e-3), "ElastoBacklash.b"),
        (lambda: ElastoBacklash(c=1, law="hertz"), "ElastoBacklash.law"),  # type: ignore[arg-type]
        (lambda: IdealGear(ratio=0), "IdealGear.ratio: must not be 0"),
        (lambda: LossyGear(ratio=0), "LossyGear.ratio"),
        (lambda: LossyGear(ratio=1, lossTable=[0, 1.2, 1, 0, 0]), r"lossTable\[0\]\[1\]: must be > 0 and <= 1"),
        (lambda: LossyGear(ratio=1, lossTable=[[0, 1, 1, 0]]), "row 0 must have 5 numbers"),
        (lambda: LossyGear(ratio=1, lossTable=[[1, 1, 1, 0, 0], [0, 1, 1, 0, 0]]), "speeds must ascend"),
        (lambda: BearingFriction(tau_pos=[0, -1]), r"BearingFriction.tau_pos\[0\]\[1\]"),
        (lambda: BearingFriction(peak=0.9), "BearingFriction.peak"),
        (lambda: Clutch(fn_max=-1), "Clutch.fn_max"),
        (lambda: Sine(amplitude=NAN, f=1), "Sine.amplitude"),
        (lambda: Sine(amplitude=1, f=0), "Sine.f"),
        (lambda: Sampled(np.array([0.0, NAN]), 8000), "must be finite, got nan at sample 1"),
        (lambda: Sampled(np.zeros(1), 8000), "2 or more samples"),
        (lambda: Torque(12.0), "Torque.tau: must be a signal"),  # type: ignore[arg-type]
        (lambda: Position(Step(1.0), exact=True), "cannot be followed exactly"),
        (lambda: Speed(Step(1.0), exact=True), "cannot be followed exactly"),
    ],
)
def test_a_wrong_parameter_is_named(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        make()


SHAFT = DriveTrain.series(torque=Torque(Constant(1)), shaft=Inertia(J=1))


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (lambda: simulate(SHAFT, 1e9), "duration_s: must be > 0 and <= 1e"),
        (lambda: simulate(SHAFT, -1), "duration_s"),
        (lambda: simulate(SHAFT, NAN), "duration_s"),
        (lambda: simulate(SHAFT, 1, 0), "sample_rate_hz"),
        (lambda: simulate(SHAFT, 1e5, 8000), "duration_s: must be at most"),
        (lambda: simulate(SHAFT, 1, engine="euler"), "engine: must be"),  # type: ignore[arg-type]
        (lambda: simulate(SHAFT.add("loose", Spring(c=1), flange_a="shaft.flange_b"), 1)["spring.tau"], "spring.tau"),
        (lambda: SHAFT["shft"], "did you mean 'shaft'"),
        (lambda: SHAFT.connect("shaft.flange_c", "torque.flange"), "did you mean"),
        (lambda: SHAFT.branch("shaft.flange_b", shaft=Inertia(J=1)), "already a component"),
        (lambda: simulate(SHAFT, 0.1)["shaft.v"], "no channel"),
    ],
)
def test_a_wrong_run_or_composition_is_named(run: Callable[[], object], words: str) -> None:
    with pytest.raises(SimulationError, match=words):
        run()
