"""The generator itself: it obeys mechanics, hides what it claims, and shares no code with the product."""

from __future__ import annotations

import subprocess
import sys
import tomllib
import wave
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import welch

from tests.hidden_effects.bank import CALIBRATION_SEEDS, QUICK_BANK, full_bank
from tests.hidden_effects.generator import EFFECTS, LEVELS, Scenario, draw_recipe, generate, kernel, write
from tests.hidden_effects.generator.comparison import HARMLESS, Recorded, another_day, compare, first_day
from tests.hidden_effects.generator.effect import Draw, Effect
from tests.hidden_effects.generator.joint import KINDS, Joint, draw_joint
from tests.hidden_effects.generator.kernel import SERVO_RATE_HZ, TELEMETRY_RATE_HZ
from tests.hidden_effects.generator.microphone import SOUND_RATE_HZ, fine_angle
from tests.hidden_effects.generator.motion import SETTLE_S, Motion, _move, draw_motion
from tests.hidden_effects.generator.noise import load_encoder
from tests.hidden_effects.generator.plant import Damage, Plant, Run, _links, build_plant, simulate
from tests.hidden_effects.generator.recipe import RECORDED_TWICE
from tests.hidden_effects.generator.recording import Placed, mesh_orders

ROOT = Path(__file__).resolve().parents[2]


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


def test_joint_without_errors_repeats_itself_every_cycle() -> None:
    joint, plant, _ = _drawn(4)
    motion = _to_and_fro(0.8 * joint.top_speed, 3.0)
    cycle = round((2 * len(_move(3.0, 0.8 * joint.top_speed, 0.4)) / SERVO_RATE_HZ + 1.0) * TELEMETRY_RATE_HZ)
    run = simulate(_perfect(plant), motion, 3 * cycle / TELEMETRY_RATE_HZ - SETTLE_S, quantised=False)
    second, third = run.motor_torque[-2 * cycle : -cycle], run.motor_torque[-cycle:]
    assert np.std(third - second) < 2e-3 * np.std(second)


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


def test_springs_in_series_obey_the_law_told_of_their_stage() -> None:
    """An answer speaks of a stage; its elasticity sits in coupling, mesh and shaft."""
    joint, plant, _ = _drawn(6, "two shafts")
    stage, cubic, loop, twist = joint.stages[0], 2e4, 3.0, 4e-3
    rows, _inertias = _links(plant.with_mesh(stage.name, gap=0.0, cubic=cubic, hysteresis=loop))
    part = np.array([stage.stiffness / row[kernel.STIFFNESS] for row in rows])
    gears = np.array([stage.ratio, 1.0, 1.0])  # the coupling is on the motor's side
    shares = part / gears**2
    assert shares.sum() == pytest.approx(1.0)
    for row, share, gear in zip(np.array(rows), shares, gears, strict=True):
        torque = kernel._contact(row, share * gear * twist, 0.0)[0]
        assert torque * gear == pytest.approx(stage.stiffness * twist * (1 + cubic * twist**2))
        assert row[kernel.HYSTERESIS] * gear == pytest.approx(loop)
    widths = [row[kernel.YIELD_TWIST] / gear for row, gear in zip(rows, gears, strict=True)]
    assert widths / shares == pytest.approx([sum(widths)] * len(rows))


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


def test_gravity_is_carried_by_the_motor() -> None:
    joint, plant, _ = _drawn(9, "two shafts")
    motion = _to_and_fro(0.25 * joint.top_speed, 5.0, 1)
    torque = 0.3 * joint.peak_torque * joint.ratio
    good, bad = (
        simulate(p, motion, 8.0, quantised=False)
        for p in (_perfect(plant), replace(_perfect(plant), gravity=(torque, 0.4)))
    )
    steady = np.abs(good.motor_speed) > 0.24 * joint.top_speed * joint.ratio
    change = (bad.motor_torque - good.motor_torque)[steady]
    expected = torque / joint.ratio * np.sin(good.load_angle + 0.4)[steady]
    assert np.corrcoef(change, expected)[0, 1] > 0.97
    assert np.std(change) == pytest.approx(np.std(expected), rel=0.1)


def _pair(effect: str, **recipe: object) -> tuple[Scenario, Scenario]:
    """Return a scenario with one effect and the same without it."""
    drawn = replace(draw_recipe(21, "sensor", (effect,), "strong", "two shafts", True), sound=False, **recipe)
    return generate(21, drawn, seconds=10.0), generate(21, replace(drawn, effects=()), seconds=10.0)


def _torque(scenario: Scenario) -> np.ndarray:
    assert scenario.telemetry is not None
    return scenario.telemetry["motor_torque_nm"]


def test_torque_offset_is_the_offset() -> None:
    ill, well = _pair("torque_offset")
    assert np.mean(_torque(ill) - _torque(well)) == pytest.approx(ill.hidden[0].size["torque_n_m"], rel=1e-6)


def test_hum_is_a_line_at_its_frequency_as_strong_as_claimed() -> None:
    ill, well = _pair("electrical_hum")
    change = _torque(ill) - _torque(well)
    spectrum = np.abs(np.fft.rfft(change * np.hanning(len(change))))
    frequency = np.argmax(spectrum) / 10.0
    assert frequency == pytest.approx(ill.hidden[0].size["frequency_hz"], abs=0.11)


def test_clipping_cuts_the_share_claimed() -> None:
    ill, _ = _pair("clipping")
    torque = np.abs(_torque(ill))
    assert np.mean(torque == torque.max()) == pytest.approx(0.06, abs=0.002)


def test_lost_samples_are_lost() -> None:
    ill, well = _pair("lost_samples")
    rows = ill.telemetry["time_s"], well.telemetry["time_s"]
    held = np.mean(np.diff(ill.telemetry["motor_position_rad"][: len(rows[0])]) == 0)
    assert len(rows[0]) < 0.95 * len(rows[1]) or held > 0.04


def test_effect_is_as_strong_as_claimed_in_the_recording_itself() -> None:
    drawn = replace(draw_recipe(31, "mechanics", ("gravity_imbalance",), "full", "two shafts", False), sound=False)
    ill, well = generate(31, drawn, seconds=10.0), generate(31, replace(drawn, effects=()), seconds=10.0)
    speed = np.gradient(well.telemetry["motor_position_rad"])
    ramp = np.convolve(np.gradient(speed), np.hanning(40) / 20, "same")
    columns = np.column_stack([ramp, speed, np.tanh(speed / (0.01 * np.max(speed)))])[100:-100]
    change = (_torque(ill) - _torque(well))[100:-100]
    beyond = np.std(change - columns @ np.linalg.lstsq(columns, change, rcond=None)[0])
    # the torque noise itself, which both recordings share: fast, beside the slow torque of the motion
    noise = np.std(np.diff(_torque(well))) / np.sqrt(2)
    assert ill.hidden[0].strength == pytest.approx(1.0, rel=0.05)
    assert beyond > 0.5 * noise


def test_levels_scale_the_size() -> None:
    sizes = [
        generate(41, draw_recipe(41, "mechanics", ("load_dependent_loss",), level, "three shafts", True), seconds=8.0)
        .hidden[0]
        .size["fraction"]
        for level in ("full", "half", "quarter")
    ]
    assert np.array(sizes) / sizes[0] == pytest.approx([1.0, LEVELS["half"], LEVELS["quarter"]])


def test_bearing_knocks_at_its_order() -> None:
    recipe = draw_recipe(51, "mechanics", ("bearing_defect",), "strong", "two shafts", True)
    scenario = generate(51, recipe, seconds=10.0)
    turns = np.interp(
        np.arange(len(scenario.sound)) / 8000,
        scenario.telemetry["time_s"],
        scenario.telemetry["motor_position_rad"] / (2 * np.pi),
    )
    steady = np.abs(np.gradient(turns)) > 0.9 * np.max(np.abs(np.gradient(turns)))
    waves = np.abs(scenario.sound) * steady
    orders = np.arange(1.5, 10.0, 0.01)
    lines = [abs(np.sum(waves * np.exp(-2j * np.pi * order * turns))) for order in orders]
    order = scenario.hidden[0].size["order"]
    peaks = orders[np.argsort(lines)[-5:]]
    assert np.min(np.abs(peaks - order)) < 0.1


def test_same_seed_same_data_and_another_seed_other_data() -> None:
    first, again, other = (generate(seed, seconds=4.0) for seed in (61, 61, 68))
    assert first.axis == again.axis
    assert first.answer() == again.answer()
    assert all(np.array_equal(first.telemetry[name], again.telemetry[name]) for name in first.telemetry)
    assert first.axis != other.axis


def test_description_is_near_the_truth_and_omits_what_is_hidden() -> None:
    scenario = generate(71, draw_recipe(71, "null", (), "full", "three shafts", True), seconds=3.0)
    axis = tomllib.loads(scenario.axis)
    assert axis["schema"] == "gearcase-axis/1"
    assert axis["motor"]["inertia_kg_m2"] == pytest.approx(scenario.joint.motor_inertia, rel=0.06)
    assert axis["load"]["inertia_kg_m2"] == pytest.approx(scenario.joint.load_inertia, rel=0.06)
    assert [s["name"] for s in axis["stages"]] == ["transfer", "output"]
    missing = generate(
        71, draw_recipe(71, "mechanics", ("viscous_friction",), "full", "three shafts", True), seconds=8.0
    )
    axis = tomllib.loads(missing.axis)
    assert axis["motor"]["viscous_friction_n_m_s_per_rad"] == 0
    assert axis["load"]["viscous_friction_n_m_s_per_rad"] == 0


def test_files_are_what_a_technician_hands_over(tmp_path: Path) -> None:
    recipe = replace(
        draw_recipe(81, "null", (), "full", "three shafts", True), sound=True, reference=True, speed_channel=False
    )
    write(generate(81, recipe, seconds=3.0), tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["axis.toml", "sound.wav", "telemetry.csv"]
    lines = (tmp_path / "telemetry.csv").read_text().splitlines()
    assert lines[0] == "time_s,reference_position_rad,motor_torque_nm,motor_position_rad,load_position_rad"
    assert len(lines) == 6001
    with wave.open(str(tmp_path / "sound.wav")) as sound:
        assert (sound.getframerate(), sound.getnchannels(), sound.getsampwidth()) == (8000, 1, 2)
        assert sound.getnframes() == 24_000


def test_nothing_is_simulated_beyond_the_end_of_its_motion() -> None:
    recipe = replace(draw_recipe(81, "null", (), "full", "three shafts", True), sound=True)
    one, two = (generate(81, recipe, seconds=3.0).sound for _ in range(2))
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(one, two)
    _, plant, motion = _drawn(1)
    with pytest.raises(ValueError, match="ends before"):
        simulate(plant, motion, 30.0)


def _two_days(seed: int, *effects: str, level: float = 1.0) -> tuple[Joint, Recorded, Recorded, list[Placed]]:
    rng = np.random.default_rng(seed)
    joint = draw_joint(rng, "three shafts")
    return joint, *compare(rng, joint, effects, level, 16.0)


def _growth_db(as_new: Recorded, now: Recorded, order: float) -> float:
    """Return by how much the line at `order` per turn of the motor has grown beside the loudness of all [dB]."""
    levels = []
    for day in (as_new, now):
        angle = fine_angle(day.motor_angle)
        speed = np.abs(np.gradient(angle))
        wave = day.sound * np.exp(-1j * order * angle)
        slow = uniform_filter1d(wave.real, 800) + 1j * uniform_filter1d(wave.imag, 800)
        levels.append(np.sqrt(np.mean(np.abs(slow[speed > 0.5 * speed.max()]) ** 2)))
    _, ratio = _spectra_db(as_new, now)
    return float(20 * np.log10(levels[1] / levels[0]) - np.median(ratio))


def _spectra_db(as_new: Recorded, now: Recorded) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies [Hz] above the fan's and how much louder they are now [dB]."""
    frequency, then = welch(as_new.sound, SOUND_RATE_HZ, nperseg=1024)
    ratio = 10 * np.log10(welch(now.sound, SOUND_RATE_HZ, nperseg=1024)[1] / then)
    return frequency[frequency > 200], ratio[frequency > 200]


def _outstanding_db(joint: Joint, as_new: Recorded, now: Recorded) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies [Hz] at which no mesh line stays, which another pace would move, and what stands out [dB]."""
    frequency, ratio = _spectra_db(as_new, now)
    width, free = frequency[1] - frequency[0], np.ones(len(frequency), dtype=bool)
    for day in (as_new, now):
        turns_hz = np.abs(np.gradient(day.motor_angle))[::20] * TELEMETRY_RATE_HZ / (2 * np.pi)
        for order in mesh_orders(joint):
            for harmonic in (1, 2, 3):
                line = harmonic * order * turns_hz
                stays = [np.mean(np.abs(line - middle) < 3 * width) > 0.05 for middle in frequency]
                free &= ~np.array(stays)
    return frequency[free], (ratio - median_filter(ratio, 101, mode="nearest"))[free]


@pytest.mark.parametrize(("seed", "level"), [(101, 1.0), (102, 1 / 3), (103, 1 / 3)])
def test_lines_of_the_worn_mesh_grow_by_its_error_and_those_of_the_other_stay(seed: int, level: float) -> None:
    joint, as_new, now, (placed,) = _two_days(seed, "mesh_error", level=level)
    assert placed.amplitude == pytest.approx(10 * level)
    for stage, order in zip(joint.stages, mesh_orders(joint), strict=True):
        grown = np.mean([_growth_db(as_new, now, harmonic * order) for harmonic in (1, 2, 3)])
        expected = 20 * np.log10(placed.amplitude) if stage.name == placed.effect.scored_location else 0.0
        assert grown == pytest.approx(expected, abs=5.0)


@pytest.mark.parametrize("seed", [111, 112, 113])
def test_something_loose_rings_at_its_frequency(seed: int) -> None:
    joint, as_new, now, (placed,) = _two_days(seed, "structural_resonance")
    frequency, outstanding = _outstanding_db(joint, as_new, now)
    assert frequency[np.argmax(outstanding)] == pytest.approx(placed.effect.size(1.0)["frequency_hz"], rel=0.03)


@pytest.mark.parametrize("seed", [121, 122, 123])
def test_two_days_in_good_order_differ_in_neither(seed: int) -> None:
    joint, as_new, now, placed = _two_days(seed)
    assert placed == []
    assert (now.sound.shape, now.motor_angle.shape) == (as_new.sound.shape, as_new.motor_angle.shape)
    assert np.std(now.motor_angle - as_new.motor_angle) > 1.0
    for order in mesh_orders(joint):
        assert abs(np.mean([_growth_db(as_new, now, harmonic * order) for harmonic in (1, 2, 3)])) < 6.0
    assert np.max(_outstanding_db(joint, as_new, now)[1]) < 8.0


def test_a_day_differs_by_what_a_workshop_allows() -> None:
    rng = np.random.default_rng(131)
    first = first_day(rng, draw_joint(rng, "three shafts"))
    for harmless in (None, *HARMLESS):
        later = another_day(rng, first, harmless)
        assert abs(later.pace - 1) <= 0.02
        assert (later.payload > 1.1) == (harmless == "heavier payload")
        gain = 20 * abs(np.log10(later.microphone.loudness / first.microphone.loudness))
        assert (gain > 10) == (harmless == "other gain")
        quieter = 20 * np.log10(first.microphone.noise_ratio / later.microphone.noise_ratio)
        assert (quieter >= 10) == (harmless == "quieter workshop")
        np.testing.assert_array_equal(later.microphone.modes[:, :2], first.microphone.modes[:, :2])


def test_two_sounds_and_no_telemetry_are_handed_over(tmp_path: Path) -> None:
    scenario = generate(141, draw_recipe(141, "sound compared", ("mesh_error",), "half"), seconds=3.0)
    write(scenario, tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["as_new.wav", "axis.toml", "sound.wav"]
    with wave.open(str(tmp_path / "sound.wav")) as sound, wave.open(str(tmp_path / "as_new.wav")) as as_new:
        assert sound.getparams() == as_new.getparams()
        assert sound.getnframes() == 24_000
    (hidden,) = scenario.hidden
    assert f'name = "{hidden.location}"' in scenario.axis
    assert (hidden.strength, hidden.size) == (0.5, {})
    again = generate(141, draw_recipe(141, "sound compared null"), seconds=3.0)
    assert (again.hidden, again.verdict) == ((), "nothing_missing")


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


def test_two_recordings_differ_in_motion_and_noise_and_not_in_the_joint() -> None:
    scenario, again = (generate(152, draw_recipe(152, "several null"), seconds=3.0) for _ in range(2))
    assert (scenario.hidden, scenario.verdict) == ((), "nothing_missing")
    first, second = scenario.telemetry, scenario.second_telemetry
    assert list(first) == list(second)
    assert np.std(first["motor_position_rad"] - second["motor_position_rad"]) > 1.0
    fast = [np.diff(day["motor_torque_nm"], 2) for day in (first, second)]
    assert abs(np.corrcoef(*fast)[0, 1]) < 0.1
    assert all(np.array_equal(second[name], again.second_telemetry[name]) for name in second)


def test_an_encoder_errs_alike_in_every_recording() -> None:
    angle = np.linspace(0, 2 * np.pi, 2000)
    monday, friday = (
        load_encoder(np.random.default_rng(day), np.random.default_rng(7), angle, 1e-3, (0.0, 0.0), 1e-5)
        for day in (1, 2)
    )
    assert np.std(monday - angle) > 1e-4
    assert 1e-5 < np.std(monday - friday) < 2e-5


def test_two_recordings_and_no_sound_are_handed_over(tmp_path: Path) -> None:
    scenario = generate(153, draw_recipe(153, "several null"), seconds=3.0)
    write(scenario, tmp_path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["axis.toml", "telemetry.csv", "telemetry_2.csv"]
    one, two = ((tmp_path / name).read_text().splitlines() for name in ("telemetry.csv", "telemetry_2.csv"))
    assert (one[0], len(one)) == (two[0], len(two))
    assert one[1:] != two[1:]


def test_several_recordings_come_last_in_the_bank() -> None:
    bank = full_bank()
    assert {entry.group for entry in bank[-36:]} == {"several", "several null"}
    several = [(entry.effects, entry.level) for entry in bank[-36:] if entry.group == "several"]
    assert len(several) == 24
    assert set(several) == {((name,), level) for name in RECORDED_TWICE for level in ("third", "quarter")}
    assert all(several.count(what) == 2 for what in several)
    assert not any(entry.group.startswith("several") for entry in bank[:-36])


def test_every_mechanism_can_be_hidden_and_seeds_are_kept_apart() -> None:
    bank = full_bank()
    assert {name for entry in bank for name in entry.effects} == set(EFFECTS)
    assert sum(bool(entry.effects) for entry in bank) >= 300
    assert sum(not entry.effects for entry in bank) >= 100
    seeds = [entry.seed for entry in (*bank, *QUICK_BANK)]
    assert len(set(seeds)) == len(seeds)
    assert min(seeds) > max(CALIBRATION_SEEDS)


def test_generator_loads_nothing_of_the_product() -> None:
    check = "import sys, tests.hidden_effects.generator; print([m for m in sys.modules if m.split('.')[0] in P])"
    done = subprocess.run(
        [sys.executable, "-c", "P = {'app', 'casebase', 'sim'}; " + check],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "[]"
