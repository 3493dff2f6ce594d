"""A slip of the pen by 1000 is refused or remarked on by its entry; a data sheet that is wrong by two passes."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.harness.telemetry_of import geared
from signals.telemetry import Telemetry
from sim.description.axis_document import read_axis
from sim.investigation.data.validation import DataCheck, InvestigationError, examine

SHEET: dict[str, dict[str, float]] = {
    "motor": {
        "inertia_kg_m2": 0.15,
        "coulomb_friction_n_m": 1.0,
        "viscous_friction_n_m_s_per_rad": 0.02,
        "torque_limit_n_m": 150.0,
        "speed_limit_rad_s": 100.0,
    },
    "output": {
        "stiffness_n_m_per_rad": 1e4,
        "damping_n_m_s_per_rad": 20.0,
        "mesh_efficiency": 0.97,
        "backlash_rad": 2e-5,
        "transmission_error_rad": 2e-5,
    },
    "load": {"inertia_kg_m2": 15.0, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.5},
    "load_encoder": {"error_rad": 2e-5},
}
GOOD = geared(0.15, 10.0, 15.0, 1e4, 1)


def data_check(
    table: str = "motor", key: str = "inertia_kg_m2", factor: float = 1.0, telemetry: Telemetry = GOOD
) -> DataCheck:
    sheet = copy.deepcopy(SHEET)
    sheet[table][key] *= factor
    output = sheet.pop("output")
    return examine(read_axis({**sheet, "stages": [{"name": "output", "ratio": 10, **output}]}), telemetry)


def said(table: str, key: str, factor: float) -> str:
    try:
        return " ".join(data_check(table, key, factor).remarks)
    except InvestigationError as error:
        return str(error)


@pytest.mark.parametrize(
    ("table", "key", "factor"),
    [
        ("motor", "inertia_kg_m2", 1e3),
        ("motor", "inertia_kg_m2", 1e-3),
        ("motor", "coulomb_friction_n_m", 1e3),
        ("motor", "viscous_friction_n_m_s_per_rad", 1e3),
        ("motor", "viscous_friction_n_m_s_per_rad", 1e-3),
        ("motor", "torque_limit_n_m", 1e-3),
        ("motor", "speed_limit_rad_s", 1e-3),
        ("output", "stiffness_n_m_per_rad", 1e3),
        ("output", "stiffness_n_m_per_rad", 1e-3),
        ("output", "backlash_rad", 1e3),
        ("load", "inertia_kg_m2", 1e3),
        ("load", "inertia_kg_m2", 1e-3),
        ("load", "coulomb_friction_n_m", 1e4),
        ("load", "viscous_friction_n_m_s_per_rad", 1e4),
        ("load_encoder", "error_rad", 1e3),
    ],
)
def test_a_number_that_is_wrong_by_1000_is_spoken_of_by_its_entry(table: str, key: str, factor: float) -> None:
    assert key in said(table, key, factor)


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize(
    ("table", "key"), [(table, key) for table, keys in SHEET.items() for key in keys if key != "mesh_efficiency"]
)
def test_a_data_sheet_that_is_wrong_by_two_passes(table: str, key: str, factor: float) -> None:
    assert said(table, key, factor) == ""


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        ({"motor_position_rad": 1e3}, "motor_position_rad is in mrad"),
        ({"load_position_rad": 1e3}, "load_position_rad is in mrad"),
        ({"load_position_rad": 1e-3}, "load_position_rad is too small by 1000"),
        ({"load_position_rad": 180 / np.pi}, "load_position_rad is in degrees"),
        ({"motor_position_rad": 1e3, "load_position_rad": 1e3}, "are they in mrad"),
        ({"motor_torque_nm": 1e3}, "is it in N mm"),
        ({"motor_torque_nm": 1e-3}, "is it in kN m"),
    ],
)
def test_a_channel_in_another_unit_is_named(channels: dict[str, float], words: str) -> None:
    scaled = {name: factor * GOOD[name] for name, factor in channels.items()}
    with pytest.raises(InvestigationError, match=words):
        data_check(telemetry=replace(GOOD, channels={**GOOD.channels, **scaled}))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("motor_torque_nm", "motor_position_rad"),
        ("motor_torque_nm", "reference_position_rad"),
        ("motor_position_rad", "load_position_rad"),
    ],
)
def test_swapped_channels_are_both_named(one: str, other: str) -> None:
    swapped = {**GOOD.channels, one: GOOD[other], other: GOOD[one]}
    with pytest.raises(InvestigationError, match="swapped") as refused:
        data_check(telemetry=replace(GOOD, channels=swapped))
    assert one in str(refused.value)
    assert other in str(refused.value)


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0])
def test_an_angle_that_is_cut_at_each_turn_is_to_be_unwrapped(turn: float) -> None:
    angle = np.mod(GOOD["motor_position_rad"] * turn / (2 * np.pi), turn)
    with pytest.raises(InvestigationError, match="unwrap"):
        data_check(telemetry=replace(GOOD, channels={**GOOD.channels, "motor_position_rad": angle}))


@pytest.mark.parametrize(("stiffness", "refused"), [(4e4, False), (8e4, False), (4e7, True)])
def test_a_coupling_without_gears_is_held_against_both_encoders(stiffness: float, refused: bool) -> None:
    direct = read_axis(
        {
            "motor": {"inertia_kg_m2": 0.15, "coulomb_friction_n_m": 1.0, "viscous_friction_n_m_s_per_rad": 0.02},
            "transmission": {"stiffness_n_m_per_rad": stiffness},
            "load": {"inertia_kg_m2": 0.5},
        }
    )
    telemetry = geared(0.15, 1.0, 0.5, 4e4, 3)
    if refused:
        with pytest.raises(InvestigationError, match="transmission"):
            examine(direct, telemetry)
    else:
        assert examine(direct, telemetry).faults == ()


def test_a_load_that_reads_zero_for_a_while_is_not_wrapped() -> None:
    """From nearly one turn down to zero and up again is a jump of nearly 2 pi, but not of 2 pi."""
    load = GOOD["load_position_rad"]
    load = 6.2 * (load - load.min()) / np.ptp(load)
    load[2000:2100] = 0.0
    top = int(np.argmax(load))
    load[top : top + 50] = 0.0
    with pytest.raises(InvestigationError) as refused:  # the ratio is no longer right
        data_check(telemetry=replace(GOOD, channels={**GOOD.channels, "load_position_rad": load}))
    assert "wrapped" not in str(refused.value)


def test_what_encoders_differ_by_over_the_angle_is_no_soft_spring() -> None:
    """To and fro the load accelerates most at the ends of its way, and an error over its angle seems to twist it."""
    output = {"name": "output", "ratio": 10, "stiffness_n_m_per_rad": 1e5}
    axis = read_axis({"motor": SHEET["motor"], "stages": [output], "load": SHEET["load"]})
    stiff = geared(0.15, 10.0, 15.0, 1e5, 1)
    turned = stiff["load_position_rad"]
    twist = stiff["motor_position_rad"] / 10.0 - turned
    way = turned - turned.mean()
    load = turned + 50.0 * np.std(twist) * way / np.std(way)
    examine(axis, replace(stiff, channels={**stiff.channels, "load_position_rad": load}))
    with pytest.raises(InvestigationError, match="wrong by far"):
        examine(axis, geared(0.15, 10.0, 15.0, 5e3, 1))
