"""A trial begins where the revision is: what a slider stands for is replaced, never added."""

from dataclasses import replace

import numpy as np

from app.web.pages.model import SLIDERS
from app.web.trial import Trial, besides, perform, starts
from sim.description.axis import Axis, MechanismEntry
from sim.description.axis_document import parse_axis, read_axis
from tests.web.conftest import AXIS

PLAIN = read_axis(parse_axis(AXIS))
WORN = replace(
    PLAIN,
    mechanisms=(
        MechanismEntry("tooth_damage", "output", {"angle_rad": 0.7, "depth_rad": 0.0004, "flank": -1.0}),
        MechanismEntry("backlash", "output", {"gap_rad": 0.0009}),
        MechanismEntry("backlash", "transfer", {"gap_rad": 0.002}),
    ),
)


def trial(axis: Axis, **moved: float) -> Trial:
    return Trial(axis, {**{slider.name: slider.start for slider in SLIDERS}, **starts(axis), **moved})


def test_sliders_begin_at_the_play_and_the_notch_of_the_revision() -> None:
    assert starts(WORN) == {"gap_mrad": 0.9, "notch_mrad": 0.4}
    assert starts(PLAIN) == {"gap_mrad": 0.0, "notch_mrad": 0.0}
    assert [entry.location for entry in besides(WORN)] == ["transfer"]


def test_taking_play_and_notch_away_leaves_what_never_had_them() -> None:
    """Bit for bit: nothing of what a slider stands for stays behind, and what has no slider stays."""
    never = replace(PLAIN, mechanisms=besides(WORN))
    without = perform(trial(WORN, gap_mrad=0.0, notch_mrad=0.0))
    assert np.array_equal(without, perform(trial(never)))
    assert not np.array_equal(without, perform(trial(WORN)))
