"""Plans fill the space, grow without changing, and repeat; faults in them are heard."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sim.acoustics.audibility import JUST_HEARD, perform_fault
from sim.description.axis import MechanismEntry, Motion
from sim.errors import ParameterError
from sim.experiment.design_of_experiments import DEPTH_RAD, GAP_RAD, LABELS, around, labels, plan
from sim.experiment.paper_axis import PAPER_AXIS
from sim.experiment.scenario import LOUDEST, scenario_of, travel_rad
from sim.experiment.specimen import Specimen
from sim.mechanisms import MECHANISMS


def test_a_longer_plan_contains_the_shorter_one() -> None:
    short, long = plan(PAPER_AXIS, {"play": 5}, 3), plan(PAPER_AXIS, {"play": 12}, 3)
    assert long[:5] == short


def test_sizes_fill_their_range_evenly() -> None:
    for label, span in (("play", GAP_RAD), ("notch", DEPTH_RAD)):
        sizes = [each.size for each in plan(PAPER_AXIS, {label: 64}) if each.size is not None]
        place = np.log(np.array(sizes) / span.low) / np.log(span.high / span.low)
        counts, _ = np.histogram(place, bins=8, range=(0.0, 1.0))
        assert counts.sum() == 64
        assert counts.min() >= 6, "every eighth of the range holds about eight of 64 points"


def test_normal_cases_have_no_fault_and_both_flanks_are_notched() -> None:
    planned = plan(PAPER_AXIS, {"normal": 4, "notch": 32})
    assert all(each.mechanism is None for each in planned[:4])
    flanks = [each.mechanism.parameters["flank"] for each in planned[4:] if each.mechanism]
    assert 10 < sum(flank > 0 for flank in flanks) < 22


def test_a_fault_of_the_description_is_no_part_of_a_normal_case() -> None:
    """An axis whose extended description was accepted has its play written in it; what else was found stays."""
    play = MechanismEntry("backlash", PAPER_AXIS.stages[-1].name, {"gap_rad": 0.0012})
    hum = MechanismEntry("electrical_hum", None, MECHANISMS["electrical_hum"](None).entry().parameters)
    worn = replace(PAPER_AXIS, mechanisms=(play, hum))
    normal, played = plan(worn, {"normal": 1, "play": 1})
    assert [each.name for each in normal.scenario.axis.mechanisms] == ["electrical_hum"]
    assert [each.name for each in played.scenario.axis.mechanisms] == ["electrical_hum", "backlash"]


def test_no_drawn_difference_of_friction_drives_the_axis() -> None:
    motor = replace(PAPER_AXIS.motor, coulomb_friction_n_m=0.05)
    sizes = set()
    for each in plan(replace(PAPER_AXIS, motor=motor), {"friction_asymmetry": 16}):
        scenario = each.scenario
        scenario.specimen.train(scenario.specimen.built(scenario.axis, scenario.payload_kg_m2))
        sizes.add(each.size)
    assert len(sizes) > 8


def test_a_plan_is_about_the_motion_that_is_described() -> None:
    for motion in (Motion(4.2, 2.7, 0.3, 0.1), Motion(9.0, 1.0, 0.8, 0.5), Motion(1.4, 1.0, 0.1, 0.01)):
        axis = replace(PAPER_AXIS, motion=motion)
        for each in plan(axis, {"notch": 8}, operation=around(axis)):
            drawn = each.scenario.axis.motion
            assert 0.75 <= travel_rad(drawn) / travel_rad(motion) <= 1.1
            assert 0.75 <= drawn.acceleration_time_s / motion.acceleration_time_s <= 1.1
            assert 0.75 <= drawn.dwell_s / motion.dwell_s <= 1.1
    assert around(replace(PAPER_AXIS, motion=Motion())) == ()


def test_an_unknown_label_is_refused_with_the_nearest() -> None:
    with pytest.raises(ParameterError, match="notch"):
        plan(PAPER_AXIS, {"notsh": 1})


def test_a_scenario_survives_json_and_sounds_the_same() -> None:
    scenario = plan(PAPER_AXIS, {"notch": 1}, duration_s=1.0)[0].scenario
    again = scenario_of(json.loads(json.dumps(scenario.to_mapping())))
    np.testing.assert_array_equal(scenario.perform(), again.perform())


def test_a_notch_is_passed_by_its_flank_only() -> None:
    """Damage on the flank that carries no torque while moving one way is silent that way: the other flank hears it."""
    planned = plan(PAPER_AXIS, {"notch": 1}, duration_s=2.0)[0]
    entry = planned.mechanism
    assert entry is not None
    base = replace(planned.scenario, axis=replace(planned.scenario.axis, mechanisms=()), specimen=Specimen(5, 0.0))
    torque = f"{PAPER_AXIS.stages[-1].name}.tau"
    healthy = -base.simulate()[torque]
    ways = []
    for flank in (1.0, -1.0):
        damaged = replace(entry, parameters={**entry.parameters, "flank": flank, "depth_rad": 3e-4})
        run = replace(base, axis=replace(base.axis, mechanisms=(damaged,))).simulate()
        hit = np.abs(-run[torque] - healthy)
        first = int(np.argmax(hit > 0.2 * hit.max()))
        ways.append(np.sign(healthy[first]))
    assert ways == [1.0, -1.0]


def test_a_planned_fault_is_heard() -> None:
    for label in ("play", "notch"):
        planned = plan(PAPER_AXIS, {label: 2}, 5, duration_s=4.0)[1]
        heard = perform_fault(planned.scenario)
        assert heard.ratio > 0.5 * JUST_HEARD
        louder = replace(planned.scenario, microphone=replace(planned.scenario.microphone, rubbing_n_m=1e3))
        assert perform_fault(louder).scenario.microphone.rubbing_n_m < 1e3, "what would drown is heard from nearer"


@pytest.mark.parametrize("label", [name for name in labels() if name not in LABELS])
def test_every_other_mechanism_that_is_heard_can_be_planned_and_changes_the_sound(label: str) -> None:
    planned = plan(PAPER_AXIS, {label: 1}, duration_s=1.0)[0]
    entry, scenario = planned.mechanism, planned.scenario
    assert entry is not None
    assert (entry.name, planned.size) == (label, entry.parameters[MECHANISMS[label].size])
    healthy = replace(scenario, axis=replace(scenario.axis, mechanisms=()))
    assert not np.array_equal(scenario.perform(), healthy.perform())


def test_what_no_microphone_hears_is_not_planned() -> None:
    with pytest.raises(ParameterError, match="cannot be generated"):
        plan(PAPER_AXIS, {"encoder_error": 1})


def test_the_loudest_moment_keeps_head_room_and_the_gain_says_so() -> None:
    scenario = plan(PAPER_AXIS, {"normal": 1}, duration_s=1.0)[0].scenario
    loud = replace(scenario, microphone=replace(scenario.microphone, gain=100 * scenario.microphone.gain))
    set_by_hand, sound = loud.with_head_room(loud.perform())
    assert np.abs(sound).max() == pytest.approx(LOUDEST)
    np.testing.assert_allclose(set_by_hand.perform(), sound, rtol=1e-4, atol=1e-6)
    assert scenario.with_head_room(0.1 * sound)[0] == scenario
