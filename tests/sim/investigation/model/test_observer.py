"""The guided chain against closed forms and against the other engine."""

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import RATE_HZ, swing
from sim.chain.model import Chain, Link, Shaft
from sim.investigation.data.preprocessing import Measurement, prepare
from sim.investigation.model.observer import Nuisance, Observer


def test_one_inertia_needs_its_acceleration_and_friction() -> None:
    t, angle, _, _ = swing()
    m = prepare(RATE_HZ, np.zeros(t.size), angle, None)
    observer = Observer(m, 1.0, 0.3)
    found = observer.predict(Chain((Shaft(0.3, 1.5, 0.02),)), Nuisance()).torque
    moving = np.abs(m.speed) > 5.0
    expected = 0.3 * m.acceleration + 1.5 * np.sign(m.speed) + 0.02 * m.speed
    assert np.abs(found - expected)[moving].max() < 2e-3


def test_the_guide_needs_no_torque_where_the_chain_moves_as_measured() -> None:
    """A stiff chain whose load follows the motor with the elastic lag of its inertia."""
    t, angle, _, acceleration = swing()
    inertia, stiffness, ratio = 2.0, 4e5, 10.0
    load = angle / ratio - inertia * acceleration / ratio / stiffness
    m = prepare(RATE_HZ, np.zeros(t.size), angle, load)
    observer = Observer(m, inertia, 0.01)
    chain = Chain((Shaft(0.01), Shaft(inertia)), (Link(ratio, stiffness, 60.0),))
    observer.learn_noise(chain, Nuisance())
    right = observer.predict(chain, Nuisance())
    wrong = observer.predict(Chain((Shaft(0.01), Shaft(1.2 * inertia)), chain.links), Nuisance())
    inner = slice(500, -500)
    assert np.sqrt(np.mean(right.guide[inner] ** 2)) < 0.1 * np.sqrt(np.mean(wrong.guide[inner] ** 2))
    expected = 0.01 * m.slow_acceleration + inertia * m.slow_acceleration / ratio**2
    assert np.abs(right.torque - expected)[inner].max() < 0.03 * np.abs(expected).max()


@pytest.mark.parametrize("delay", [0.4e-3, 3e-3])
def test_a_late_torque_channel_is_predicted_late(delay: float) -> None:
    t, angle, _, _ = swing()
    m = prepare(RATE_HZ, np.zeros(t.size), angle, None)
    observer = Observer(m, 1.0, 0.3)
    chain = Chain((Shaft(0.3, 0.0, 0.02),))
    early = observer.predict(chain, Nuisance()).torque
    late = observer.predict(chain, Nuisance(torque_delay_s=delay)).torque
    shifted = np.interp(m.time_s - delay, m.time_s, early)
    assert np.abs(late - shifted)[50:-50].max() < 2e-3 * np.abs(early).max()


def _friction_along(angle: np.ndarray, stretch_rad: float, width: float) -> tuple[np.ndarray, Measurement]:
    """Dry friction of 1 N m along a motion of 12 s."""
    m = prepare(RATE_HZ, np.zeros(angle.size), angle, None)
    nuisance = Nuisance(stretch_rad=(stretch_rad, stretch_rad), friction_width=(width, width))
    chain = Chain((Shaft(0.3, 1.0),))
    return Observer(m, 1.0, 0.3).predict(chain, nuisance).torque - 0.3 * m.acceleration, m


def _ramp(t: np.ndarray, first: float, last: float) -> np.ndarray:
    """0 before `first`, 1 after `last`, without a jump of acceleration."""
    u = np.clip((t - first) / (last - first), 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def test_friction_gives_way_before_it_turns_its_sign() -> None:
    """After a reversal Dahl's friction of 1 N m is 1 - 2 exp(-way / stretch), however fast."""
    t = np.arange(12000) / RATE_HZ
    friction, m = _friction_along(40.0 * _ramp(t, 1.0, 4.0) - 4e-3 * _ramp(t, 6.0, 11.0), 2e-3, 1e-9)
    back = m.time_s > 5.0
    way = 40.0 - m.slow_angle[back]
    assert friction[back] == pytest.approx(2.0 * np.exp(-way / 2e-3) - 1.0, abs=2e-3)


def test_what_friction_holds_at_rest_is_let_go() -> None:
    """By exp(-width / stretch * time)."""
    t = np.arange(12000) / RATE_HZ
    friction, m = _friction_along(40.0 * _ramp(t, 1.0, 4.0), 2e-3, 3e-5)
    rest = m.time_s > 4.5
    rate = 3e-5 * float(np.abs(m.speed).max()) / 2e-3
    held = np.log(friction[rest])
    assert np.polyfit(m.time_s[rest], held, 1)[0] == pytest.approx(-rate, rel=1e-3)


def test_a_load_that_is_let_go_swings_at_its_own_frequency() -> None:
    """Torque of its spring at the motor: that of an oscillator that starts at rest, ahead by one angle."""
    inertia, stiffness, ratio, damping, ahead = 2.0, 8e3, 10.0, 5.0, 1e-3
    t = np.arange(4000) / RATE_HZ
    m = prepare(RATE_HZ, np.zeros(t.size), 50.0 * t, None)
    chain = Chain((Shaft(0.01), Shaft(inertia)), (Link(ratio, stiffness, damping),))
    observer = Observer(m, inertia, 0.01)
    swung = observer.predict(chain, Nuisance(start=(ahead, 0.0))).torque - observer.predict(chain, Nuisance()).torque
    since = m.time_s - m.time_s[0]
    decay = 0.5 * damping / inertia
    own = np.sqrt(stiffness / inertia - decay**2)
    behind = -ahead * np.exp(-decay * since) * (np.cos(own * since) + decay / own * np.sin(own * since))
    rate = ahead * np.exp(-decay * since) * (own + decay**2 / own) * np.sin(own * since)
    expected = (stiffness * behind + damping * rate) / ratio
    assert np.abs(swung - expected).max() < 1e-3 * np.abs(expected).max()


def test_a_load_that_starts_with_the_motor_does_not_swing() -> None:
    """Under constant acceleration the spring holds what the inertia needs, from the first sample on."""
    inertia, stiffness, ratio, acceleration = 2.0, 8e3, 10.0, 30.0
    t = np.arange(3000) / RATE_HZ
    m = prepare(RATE_HZ, np.zeros(t.size), 5.0 * t + 0.5 * acceleration * t**2, None)
    chain = Chain((Shaft(0.01), Shaft(inertia)), (Link(ratio, stiffness, 5.0),))
    torque = Observer(m, inertia, 0.01).predict(chain, Nuisance()).torque
    assert torque == pytest.approx((0.01 + inertia / ratio**2) * acceleration, rel=2e-3)


@pytest.mark.parametrize("braking", [False, True])
@pytest.mark.parametrize("behind", [0.0, 1.0])
def test_losses_before_or_behind_the_spring_ask_the_motor_for_the_same_and_twist_it_otherwise(
    behind: float, braking: bool
) -> None:
    """A mesh of 0.9 takes a tenth of the power: behind the spring that turns it further, or less where it brakes."""
    inertia, stiffness, ratio, efficiency = 2.0, 8e3, 10.0, 0.9
    change = -20.0 if braking else 20.0
    t = np.arange(3000) / RATE_HZ
    m = prepare(RATE_HZ, np.zeros(t.size), 100.0 * t + 0.5 * change * t**2, None)
    chain = Chain((Shaft(0.0), Shaft(inertia)), (Link(ratio, stiffness, 20.0, efficiency=(efficiency, efficiency)),))
    split = (1.0 - behind, behind) if braking else (behind, 1.0 - behind)
    told = Observer(m, inertia, 0.0).predict(chain, Nuisance(loss_split=split))
    needed, kept = inertia * change / ratio, efficiency if braking else 1.0 / efficiency
    still = slice(2000, 2800)  # it has swung until then
    assert told.torque[still] == pytest.approx(needed / ratio * kept, rel=2e-3)
    twist = m.slow_angle[still] / ratio - told.load_angle[still]
    assert twist == pytest.approx(needed / stiffness * (kept if behind else 1.0), rel=2e-3)


@pytest.mark.parametrize("error_rad", [(1e-4, 0.0, 0.0, 0.0), (0.0, 0.0, 3e-5, -4e-5)])
def test_a_known_error_of_the_load_encoder_is_taken_out_in_angle_and_speed(error_rad: tuple[float, ...]) -> None:
    t, angle, _, acceleration = swing()
    inertia, stiffness, ratio = 2.0, 4e5, 10.0
    load = angle / ratio - inertia * acceleration / ratio / stiffness
    read = load + np.array(error_rad) @ [wave(k * load) for k in (1, 2) for wave in (np.sin, np.cos)]
    chain = Chain((Shaft(0.01), Shaft(inertia)), (Link(ratio, stiffness, 60.0),))

    def guide(encoder: np.ndarray, nuisance: Nuisance) -> np.ndarray:
        observer = Observer(prepare(RATE_HZ, np.zeros(t.size), angle, encoder), inertia, 0.01)
        observer.learn_noise(chain, nuisance)
        return observer.predict(chain, nuisance).guide[500:-500]

    true, wrong = guide(load, Nuisance()), guide(read, Nuisance())
    mended = guide(read, Nuisance(load_error_rad=error_rad))
    assert np.std(mended - true) < 0.01 * np.std(wrong - true)


def test_a_load_encoder_that_is_late_is_read_as_what_it_was_late_for() -> None:
    """Not by its speed alone: half the square of 4 ms times the acceleration would be left."""
    t, angle, _, acceleration = swing()
    inertia, stiffness, ratio = 2.0, 4e5, 10.0
    load = angle / ratio - inertia * acceleration / ratio / stiffness
    chain = Chain((Shaft(0.01), Shaft(inertia)), (Link(ratio, stiffness, 60.0),))

    def guide(encoder: np.ndarray, nuisance: Nuisance) -> np.ndarray:
        observer = Observer(prepare(RATE_HZ, np.zeros(t.size), angle, encoder), inertia, 0.01)
        observer.learn_noise(chain, nuisance)
        return observer.predict(chain, nuisance).guide[500:-500]

    true, late = guide(load, Nuisance()), guide(np.interp(t - 4e-3, t, load), Nuisance())
    mended = guide(np.interp(t - 4e-3, t, load), Nuisance(load_delay_s=4e-3))
    assert np.std(mended - true) < 1e-3 * np.std(late - true)


def test_torque_that_the_load_is_known_to_ask_for_is_that_of_gravity_in_the_chain() -> None:
    """Whoever computes the weight of the load, the motor has to give the same."""
    t, angle, _, _ = swing()
    ratio, inertia = 10.0, 2.0
    weight = 40.0 * np.sin(angle / ratio + 0.3)
    light = Chain((Shaft(0.01), Shaft(inertia)), (Link(ratio, 4e5, 60.0),))
    heavy = Chain((Shaft(0.01), Shaft(inertia, gravity_n_m=40.0, gravity_phase_rad=0.3)), light.links)
    load = angle / ratio
    for encoder in (None, load):
        told = []
        for chain, known in ((light, weight), (heavy, None)):
            m = prepare(RATE_HZ, np.zeros(t.size), angle, encoder, known_torque=known)
            told.append(Observer(m, inertia, 0.01).predict(chain, Nuisance()))
        assert np.abs(told[0].torque - told[1].torque)[200:-200].max() < 0.01 * 40.0 / ratio
        assert np.abs(told[0].guide - told[1].guide)[200:-200].max() < 0.01 * 40.0
