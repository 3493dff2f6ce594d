"""A robot's channel map with lists is one map a joint."""

import pytest

from signals.columns.channel_map import channel_map_of
from signals.columns.joint_maps import joint_maps
from signals.errors import TelemetryError

JOINTS = ["a", "b", "c"]
TOML = """
schema = "gearcase-channels/1"
header = false
[time_s]
column = 1
unit = "ms"
[motor_position_rad]
column = [2, 3, 4]
unit = ["deg", "rad", "deg"]
[motor_torque_nm]
column = [5, 6, 7]
unit = "A"
factor = [1.5, -2.5, 3.5]
"""
JSON = """{"schema": "gearcase-channels/1", "header": false, "time_s": {"column": 1, "unit": "ms"},
"motor_position_rad": {"column": [2, 3, 4], "unit": ["deg", "rad", "deg"]},
"motor_torque_nm": {"column": [5, 6, 7], "unit": "A", "factor": [1.5, -2.5, 3.5]}}"""


@pytest.mark.parametrize("text", [TOML, JSON])
def test_each_joint_takes_its_own_of_each_list(text: str) -> None:
    maps = [channel_map_of(one) for one in joint_maps(text, JOINTS)]
    assert [one.sources["motor_position_rad"].column for one in maps] == [2, 3, 4]
    assert [one.sources["motor_torque_nm"].scale for one in maps] == [1.5, -2.5, 3.5]
    assert maps[1].sources["motor_position_rad"].scale == 1.0
    assert all(one.sources["time_s"].column == 1 for one in maps)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "column = [2, 3, 4]",
            "column = [2, 3]",
            "column has 2 entries; the robot has 3 logged joints, in this order: a, b, c",
        ),
        ("factor = [1.5, -2.5, 3.5]", "factor = [1.5]", "[motor_torque_nm] factor has 1 entries; the robot has 3"),
        ("column = [2, 3, 4]", "column = 2", "column = 2 is one column for 3 joints; write a list"),
        ("column = 1", "column = ", "channel map: "),
    ],
)
def test_lists_that_do_not_fit_are_refused(old: str, new: str, said: str) -> None:
    with pytest.raises(TelemetryError) as refused:
        joint_maps(TOML.replace(old, new), JOINTS)
    assert said in str(refused.value)


def test_a_clock_is_one_for_all_joints() -> None:
    (first, *_) = joint_maps(TOML.replace("column = 1", "column = [1, 2, 3]"), JOINTS)
    with pytest.raises(TelemetryError, match="time_s"):
        channel_map_of(first)
