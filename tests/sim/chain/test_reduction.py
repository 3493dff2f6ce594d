"""The chain against closed forms, the exact engine, and against what physics conserves."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.chain.components import TorqueWave
from sim.chain.integrate import run_chain
from sim.chain.model import (
    Chain,
    ChainError,
    Dent,
    Line,
    Torque,
    with_link,
    with_shaft,
)
from sim.rotational.components import Gearbox, Inertia, Sine
from sim.rotational.components import Torque as TorqueSource
from sim.rotational.drive_train import DriveTrain
from sim.solver import simulate
from tests.sim.axes import three_shafts

PUSH = Torque(amplitude_n_m=8.0, frequency_hz=1.1, phase_rad=0.4)


def paper_train(load: float, d: float, b: float) -> DriveTrain:
    return DriveTrain.series(
        torque=TorqueSource(Sine(amplitude=12, f=0.45)),
        motor=Inertia(J=0.6, phi=0, w=0),
        gear=Gearbox(ratio=100, lossTable=[0, 0.9, 0.9, 0.9, 0.9], c=1e5, d=d, b=b),
        load=Inertia(J=load, phi=0, w=0),
    )


def test_error_falls_with_the_fourth_power_of_the_step() -> None:
    """Through contact, stick, losses, hysteresis and a dent, since every switch is located."""
    chain = three_shafts(
        hysteresis_n_m=5.0,
        hysteresis_rad=2e-3,
        damping_n_m_s_per_rad=400.0,
        errors=(Line(2, 3.0, 2e-4, 0.3),),
        dents=(Dent(2, 0.02, 0.03, 5e-4),),
    )
    chain = with_link(chain, 0, damping_n_m_s_per_rad=3.0)
    chain = with_shaft(chain, 2, gravity_n_m=20.0, gravity_phase_rad=0.2)

    def end(substeps: int) -> np.ndarray:
        run = run_chain(chain, PUSH, 500.0, 401, substeps=substeps)
        return np.concatenate([run.angle_rad[-1], run.speed_rad_s[-1]])

    reference = end(256)
    errors = [float(np.linalg.norm(end(n) - reference)) for n in (2, 4, 8, 16)]
    slopes = np.diff(np.log2(errors))
    assert np.mean(slopes) == pytest.approx(-4.0, abs=0.5), errors


def test_teeth_that_err_or_are_damaged_make_no_energy() -> None:
    """They vary the ratio of the torques as that of the speeds: all else would drive or brake a gear that turns."""
    errors = (Line(1, 11.0, 4e-3, 0.3), Line(2, 30.0, 1.5e-3, 1.0), Line(2, 1.0, 1e-3, 0.0))
    dent = Dent(2, 0.05, 0.03, 1e-3)
    chain = three_shafts(efficiency=(1.0, 1.0), damping_n_m_s_per_rad=0.0, law="elasto", errors=errors, dents=(dent,))
    chain = with_link(chain, 0, damping_n_m_s_per_rad=0.0)
    for k in range(3):
        chain = with_shaft(chain, k, coulomb_n_m=0.0, viscous_n_m_s=0.0)
    start = np.array([0.0, 0.0, 0.0, 12.0, 12.0 / chain.links[0].ratio, 12.0 / chain.ratio])
    run = run_chain(chain, Torque(), 16000.0, 32001, start=start, substeps=8)
    angle = run.angle_rad
    energy = 0.5 * run.speed_rad_s**2 @ np.array([shaft.inertia_kg_m2 for shaft in chain.shafts])
    for k, link in enumerate(chain.links):
        twist = angle[:, k] / link.ratio - angle[:, k + 1]
        for line in link.errors:
            twist -= line.amplitude * np.sin(line.order * angle[:, line.shaft] + line.phase_rad)
        u = (angle[:, 2] - dent.angle_rad) / dent.half_width_rad
        depth = np.where(np.abs(u) < 1, dent.depth_rad * (1 - np.minimum(np.abs(u), 1) ** 2) ** 4, 0.0)
        missing = depth if link.dents else np.zeros_like(depth)
        ahead, back = np.maximum(twist - link.gap_rad / 2 - missing, 0), np.maximum(-twist - link.gap_rad / 2, 0)
        energy += 0.5 * link.stiffness_n_m_per_rad * (ahead**2 + back**2)
    assert np.ptp(depth) > 0.9 * dent.depth_rad
    assert np.ptp(run.force_n_m[:, 1]) > 100.0
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


def test_a_torque_over_time_moves_a_shaft_as_the_same_torque_of_its_motor_does() -> None:
    driven = paper_train(40.0, 1000.0, 1e-3)
    wave = TorqueWave(torque=12.0, frequency=0.45)
    shaken = driven.remove("torque").add("wave", wave, flange="motor.flange_a")
    one, other = (simulate(train, 2.0, 2000.0, engine="chain") for train in (driven, shaken))
    for name in ("motor.phi", "load.phi"):
        assert np.abs(one[name] - other[name]).max() <= 1e-9 * np.ptp(one[name])
    np.testing.assert_allclose(other["wave.tau"], one["torque.tau"], atol=1e-9)


@pytest.mark.parametrize(
    ("chain", "drive", "samples", "words"),
    [
        (three_shafts(), Torque(np.array([0.0, math.nan, 0.0])), 3, "samples_n_m: must be finite"),
        (three_shafts(), Torque(np.zeros(7)), 3, r"of shape \(3,\), got shape \(7,\)"),
        (three_shafts(), PUSH, 10**9, "samples: needs 2 to"),
        (with_shaft(three_shafts(), 1, inertia_kg_m2=-1.0), PUSH, 100, "every inertia > 0"),
        (with_shaft(three_shafts(), 2, gravity_n_m=math.nan), PUSH, 100, "must be finite"),
        (replace(three_shafts(), links=()), PUSH, 100, "a link between each two"),
    ],
)
def test_a_wrong_run_is_refused(chain: Chain, drive: Torque, samples: int, words: str) -> None:
    with pytest.raises(ChainError, match=words):
        run_chain(chain, drive, 1000.0, samples)
