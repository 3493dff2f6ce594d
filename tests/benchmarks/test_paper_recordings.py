"""The paper's figures: when notch and play are heard, and what the window does."""

import numpy as np
import pytest

from benchmarks.paper_recordings import NOTCH_S, REVOLUTION_S, behind_the_play, scenario, trace_of
from benchmarks.paper_sound import begins
from benchmarks.paper_torque import SECONDS, bound, shaft_torques, trace, varied
from signals.crest import WINDOW_S


def test_the_notch_is_met_once_a_turn_in_one_direction_as_in_figure_6() -> None:
    found = trace_of(scenario("notch", 0))
    first, second = sorted(found.middle_s[np.argsort(found.values)[-2:]])
    assert first == pytest.approx(NOTCH_S, abs=WINDOW_S)
    assert second == pytest.approx(NOTCH_S + REVOLUTION_S, abs=WINDOW_S)


def test_play_is_heard_where_a_stroke_begins_once_the_friction_acts_behind_it() -> None:
    play = scenario("play", 0)
    assert not begins(trace_of(play))
    assert begins(trace_of(behind_the_play(play)))


def test_the_mean_of_the_torques_trace_rises_with_the_window_and_stays_below_its_bound() -> None:
    torque = shaft_torques(varied(40.0, 0.5))[1]
    means = [trace(torque, window_s).mean for window_s in (0.1, 0.2, 0.5, SECONDS)]
    assert means == sorted(means)
    assert means[0] < bound(0.1)
    assert means[-1] == trace(torque, 0.1).largest
