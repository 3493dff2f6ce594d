"""The generator itself: it obeys mechanics, hides what it claims, and shares no code with the product."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.hidden_effects.generator import EFFECTS, Scenario, draw_recipe, generate
from benchmarks.hidden_effects.generator.effect import Draw, Effect
from benchmarks.hidden_effects.generator.joint import KINDS, Joint, draw_joint
from benchmarks.hidden_effects.generator.kernel import SERVO_RATE_HZ, TELEMETRY_RATE_HZ
from benchmarks.hidden_effects.generator.motion import Motion, _move, draw_motion
from benchmarks.hidden_effects.generator.plant import Damage, Plant, Run, build_plant, simulate


def _drawn(seed: int, kind: str = "three shafts") -> tuple[Joint, Plant, Motion]:
    rng = np.random.default_rng(seed)
    joint = draw_joint(rng, kind)
    return joint, build_plant(rng, joint), draw_motion(rng, joint.top_speed, 8.0)


def _to_and_fro(speed: float, reach: float, times: int = 3) -> Motion:
    """Return the same move there and back, over and over, with rests."""
    rest = np.zeros(SERVO_RATE_HZ // 2)
    there = _move(reach, speed, 0.4)
    velocity = np.concatenate([rest, *([there, rest, -there, rest] * times), np.zeros(3 * SERVO_RATE_HZ)])
    place = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]))]) / SERVO_RATE_HZ
    return Motion(np.vstack([place, velocity, np.gradient(velocity) * SERVO_RATE_HZ]), 0.0, reach)


def _perfect(plant: Plant) -> Plant:
    """Return the plant without tooth errors and losses of the meshes."""
    return replace(plant, meshes=tuple(replace(m, driver=(), driven=(), loss=0.0) for m in plant.meshes))


def _at_output(name: str, draw: Draw) -> Effect:
    """Draw an effect until it sits at the output gear."""
    return next(effect for effect in iter(lambda: EFFECTS[name](draw), None) if effect.location == "output")


def _twist(run: Run, joint: Joint) -> np.ndarray:
    return run.load_angle - run.motor_angle / joint.ratio


def _cruises(run: Run, joint: Joint, direction: int) -> np.ndarray:
    """Return where the motor runs steadily in one direction for a while before and after."""
    steady = np.abs(direction * run.motor_speed / (joint.top_speed * joint.ratio) - 0.8) < 0.02
    window = TELEMETRY_RATE_HZ // 2
    return np.convolve(steady, np.ones(window), "same") > window - 0.5


@pytest.mark.parametrize("kind", KINDS)
def test_energy_is_conserved(kind: str) -> None:
    _, plant, motion = _drawn(3, kind)
    motor, outer, friction, links, stored = simulate(plant, motion, 8.0).energy
    assert motor + outer - friction - links == pytest.approx(stored, abs=1e-3 * motor)
    assert friction > 0
    assert links > 0


@pytest.mark.parametrize("kind", KINDS)
def test_steady_motion_needs_the_torque_of_friction(kind: str) -> None:
    joint, plant, _ = _drawn(5, kind)
    run = simulate(_perfect(plant), _to_and_fro(0.8 * joint.top_speed, 6.0, 2), 8.0, quantised=False)
    wanted = joint.coulomb_at_motor + joint.viscous_at_motor * 0.8 * joint.top_speed * joint.ratio
    for direction in (1, -1):
        assert direction * run.motor_torque[_cruises(run, joint, direction)].mean() == pytest.approx(wanted, rel=0.01)


def test_lost_motion_grows_by_the_backlash() -> None:
    joint, plant, _ = _drawn(6)
    motion = _to_and_fro(0.8 * joint.top_speed, 6.0, 2)

    def lost(gap: float) -> float:
        run = simulate(_perfect(plant).with_mesh("output", gap=gap), motion, 8.0, quantised=False)
        twist = _twist(run, joint)
        return float(twist[_cruises(run, joint, -1)].mean() - twist[_cruises(run, joint, 1)].mean())

    assert lost(1.1e-3) - lost(1e-4) == pytest.approx(1e-3, rel=0.02)


@pytest.mark.parametrize("flank", [1, -1])
@pytest.mark.parametrize("rectangular", [True, False])
def test_damaged_tooth_acts_at_its_angle_on_its_flank_only(flank: int, rectangular: bool) -> None:
    joint, plant, _ = _drawn(7)
    motion = _to_and_fro(0.8 * joint.top_speed, 6.0, 2)
    pitch = 2 * np.pi / joint.stage("output").driven_teeth
    damaged = plant.with_mesh("output", damage=Damage(3.0, pitch, 2e-4, flank, rectangular))
    good, bad = (simulate(p, motion, 8.0, quantised=False) for p in (plant, damaged))
    change = np.abs(_twist(bad, joint) - _twist(good, joint))
    near = np.abs(good.load_angle - 3.0) < pitch / 2
    felt, unfelt = (_cruises(good, joint, side * flank) for side in (1, -1))
    assert change[felt & near].max() > 5e-5
    assert change[unfelt & near].max() < 1e-5
    assert change[felt & (good.load_angle * flank < 3.0 * flank - pitch)].max() < 1e-5


def test_eccentricity_moves_the_load_by_its_amplitude() -> None:
    joint, plant, _ = _drawn(8)
    motion = _to_and_fro(0.8 * joint.top_speed, 2 * np.pi, 2)
    effect = _at_output("eccentricity", Draw(np.random.default_rng(1), joint, motion, True))
    good, bad = (simulate(p, motion, 8.0, quantised=False) for p in (plant, effect.act(plant, 5e-4)))
    change, angle = _twist(bad, joint) - _twist(good, joint), good.load_angle
    waves = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)])[_cruises(good, joint, 1)]
    found = np.linalg.lstsq(waves, change[_cruises(good, joint, 1)], rcond=None)[0]
    assert np.hypot(found[0], found[1]) == pytest.approx(5e-4, rel=0.05)


def test_same_seed_same_data_and_another_seed_other_data() -> None:
    first, again, other = (generate(seed, seconds=4.0) for seed in (61, 61, 68))
    assert first.axis == again.axis
    assert first.answer() == again.answer()
    assert all(np.array_equal(first.telemetry[name], again.telemetry[name]) for name in first.telemetry)
    assert first.axis != other.axis


def _with_and_without(*effects: str) -> tuple[Scenario, Scenario]:
    """Return a scenario of two recordings with effects, and the same joint on the same days without them."""
    drawn = draw_recipe(151, "several", effects, "strong", "two shafts", True)
    drawn = replace(drawn, reference=True, noise="stationary")
    return generate(151, drawn, seconds=10.0), generate(151, replace(drawn, effects=()), seconds=10.0)


def test_two_recordings_hide_the_same_effect_of_the_same_size() -> None:
    ill, well = _with_and_without("gravity_imbalance")
    (hidden,) = ill.hidden
    phases = []
    for with_it, without in (
        (ill.telemetry, well.telemetry),
        (ill.second_telemetry, well.second_telemetry),
    ):
        angle = without["load_position_rad"]
        waves = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])
        change = with_it["motor_torque_nm"] - without["motor_torque_nm"]
        found = np.linalg.lstsq(waves, change, rcond=None)[0]
        assert ill.joint.ratio * np.hypot(found[0], found[1]) == pytest.approx(hidden.size["torque_n_m"], rel=0.1)
        phases.append(np.arctan2(found[1], found[0]))
    assert np.cos(phases[1] - phases[0]) > 0.99
