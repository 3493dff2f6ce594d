"""Columns are told by names and units where these leave no doubt; what is in doubt is asked for by lines of a map."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from signals.columns.channel_map import channel_map_of
from signals.columns.column_names import meaning_of
from signals.columns.recognition import recognise
from signals.columns.units import units_of
from signals.errors import TelemetryError
from signals.telemetry import CHANNELS, TIME, read_telemetry, recognise_columns
from tests.shared_data import shared

ROWS = 150
T = np.arange(ROWS) * 0.01
MOTION = {
    "time_s": T,
    "motor_position_rad": np.sin(T),
    "motor_speed_rad_s": np.cos(T),
    "motor_torque_nm": 0.3 * np.cos(3 * T),
    "load_position_rad": 0.01 * np.sin(T),
}


def of(header: str) -> tuple[dict[str, tuple[object, str]], str]:
    """Column and unit of each channel, by the lines that can be read as they are; and what is asked for."""
    found = recognise([name.strip() for name in header.split("|")])
    lines = "\n".join(line for line in found.map.splitlines() if " = ..." not in line)
    tables = {name: each for name, each in tomllib.loads(lines).items() if isinstance(each, dict)}
    return {name: (each["column"], each["unit"]) for name, each in tables.items()}, found.open


def entries(text: str) -> dict[str, str]:
    """What stands behind the name of each; lines that go on are indented."""
    whole = text.strip().replace("\n    ", " ").splitlines()
    return dict(line.split(" = ", 1) for line in whole)


READ = entries("""
Siemens SINAMICS trace = Zeit [ms] | r62: Drehzahlsollwert nach Filter [1/min] | r63[0]: Drehzahlistwert [1/min] |
    r80: Drehmomentistwert [Nm]
    -> time_s 0 ms, motor_speed_rad_s 2 rpm, motor_torque_nm 3 N.m
KUKA trace = Time [s] | Position_Act_A1 [deg] | Velocity_Act_A1 [deg/s] | Torque_Act_A1 [Nm]
    -> time_s 0 s, motor_position_rad 1 deg, motor_speed_rad_s 2 deg/s, motor_torque_nm 3 N.m
rostopic echo -p, one joint = %time | field.header.seq | field.header.stamp | field.header.frame_id | field.name0 |
    field.position0 | field.velocity0 | field.effort0
    -> time_s 0 ns, motor_position_rad 5 rad, motor_speed_rad_s 6 rad/s, motor_torque_nm 7 N.m
PlotJuggler, JointState of one joint = __time | /joint_states/elbow_joint/position |
    /joint_states/elbow_joint/velocity | /joint_states/elbow_joint/effort
    -> time_s 0 s, motor_position_rad 1 rad, motor_speed_rad_s 2 rad/s, motor_torque_nm 3 N.m
JointState flattened, one joint = t_ns | position[2] | velocity[2] | effort[2]
    -> time_s 0 ns, motor_position_rad 1 rad, motor_speed_rad_s 2 rad/s, motor_torque_nm 3 N.m
Franka, one joint = time [s] | q_0 | dq_0 | tau_J_0 | q_d_0 | dq_d_0 | tau_ext_hat_filtered_0
    -> time_s 0 s, motor_position_rad 1 rad, motor_speed_rad_s 2 rad/s, motor_torque_nm 3 N.m
UR RTDE without current = timestamp | target_q_1 | actual_q_1 | actual_qd_1 | actual_TCP_pose_1 | runtime_state
    -> time_s 0 s, reference_position_rad 1 rad, motor_position_rad 2 rad, motor_speed_rad_s 3 rad/s
dSPACE ControlDesk = time [s] | Model Root/Plant/phi_motor [rad] | Model Root/Plant/torque [Nm]
    -> time_s 0 s, motor_position_rad 1 rad, motor_torque_nm 2 N.m
LabVIEW = Time (s) | Motor Angle (deg) | Motor Torque (Nm) | Load Angle (deg)
    -> time_s 0 s, motor_position_rad 1 deg, motor_torque_nm 2 N.m, load_position_rad 3 deg
DEWESoft = Time (s) | Motor speed (rpm) | Torque (Nm) | Temp (°C) | Power (W)
    -> time_s 0 s, motor_speed_rad_s 1 rpm, motor_torque_nm 2 N.m, temperature_degc 3 degC
a German test bench = t [s] | Motorwinkel [°] | Abtriebswinkel [°] | Motormoment [Nm] | Schleppfehler [°]
    -> time_s 0 s, motor_position_rad 1 deg, load_position_rad 2 deg, motor_torque_nm 3 N.m
letters as in DIN 461 = t / s | n / min-1 | M / N·m | phi / °
    -> time_s 0 s, motor_speed_rad_s 1 rpm, motor_torque_nm 2 N.m, motor_position_rad 3 deg
suffixes = time_us | motor_pos_deg | motorSpeedRPM | output_speed_rad_s | torque_n_m
    -> time_s 0 us, motor_position_rad 1 deg, motor_speed_rad_s 2 rpm, load_speed_rad_s 3 rad/s, motor_torque_nm 4 N.m
suffixes before the number of the axis = time_sec | pos_rad_1 | vel_rad_s_1 | torque_nm_1
    -> time_s 0 s, motor_position_rad 1 rad, motor_speed_rad_s 2 rad/s, motor_torque_nm 3 N.m
a linear axis = t (ms) | actual position [mm] | speed [mm/s] | motor force [N] | set position [mm]
    -> time_s 0 ms, motor_position_rad 1 mm, motor_speed_rad_s 2 mm/s, motor_torque_nm 3 N, reference_position_rad 4
    mm
UR script = timestamp | actual_q_0 | actual_qd_0 | actual_current_0 | actual_current_as_torque_0
    -> time_s 0 s, motor_position_rad 1 rad, motor_speed_rad_s 2 rad/s, motor_torque_nm 4 N.m
ODrive with estimates = t [s] | axis0.pos_estimate | axis0.vel_estimate | axis0.motor.torque_estimate
    -> time_s 0 s, motor_position_rad 1 rev, motor_speed_rad_s 2 rev/s, motor_torque_nm 3 N.m
a torque beside its current = Time [s] | Current [A] | Torque [Nm] | Angle [deg]
    -> time_s 0 s, motor_torque_nm 2 N.m, motor_position_rad 3 deg
savetxt, and what is no axis = # time_s | motor_torque_nm | position [deg] | Load [kg] | T [°C] | robot current [A]
    -> time_s 0 s, motor_torque_nm 1 N.m, motor_position_rad 2 deg
our own names beside others = time_s | motor_torque_nm | pos [deg] | velocity | gripper position [deg]
    -> time_s 0 s, motor_torque_nm 1 N.m, motor_position_rad 2 deg
""")
ASKED = entries("""
TwinCAT Scope = Time [ms] | Axis1.ActPos | Axis1.ActVelo | Axis1.ActTorque
    ?? motor_torque_nm has no unit; motor_position_rad has no unit
    -> time_s Time [ms]; motor_torque_nm Axis1.ActTorque; motor_position_rad Axis1.ActPos
ODrive = time [s] | axis0.encoder.pos_estimate [turn] | axis0.encoder.vel_estimate [turn/s] |
    axis0.motor.current_control.Iq_measured [A]
    ?? motor_torque_nm is a current
    -> motor_position_rad axis0.encoder.pos_estimate [turn]; motor_torque_nm axis0.motor.current_control.Iq_measured
    [A]
UR RTDE = timestamp | target_q_0 | target_q_1 | actual_q_0 | actual_q_1 | actual_qd_0 | actual_qd_1 | actual_current_0
    | actual_current_1
    ?? there are columns of 2 axes; motor_torque_nm is a current
    -> motor_position_rad actual_q_0; motor_torque_nm actual_current_0
UR RTDE with the torque of its model = timestamp | actual_q_1 | actual_qd_1 | target_moment_1
    ?? "target_moment_1" is what the drive was asked for
    -> motor_torque_nm target_moment_1; motor_position_rad actual_q_1
JointState of two joints = __time | /js/elbow_joint/position | /js/wrist_joint/position | /js/elbow_joint/effort |
    /js/wrist_joint/effort
    ?? there are columns of 2 axes
    -> motor_position_rad /js/elbow_joint/position; motor_torque_nm /js/elbow_joint/effort
JointState with a clock of no unit = time | position[2] | velocity[2] | effort[2]
    ?? time_s has no unit
    -> time_s time; motor_torque_nm effort[2]
FANUC = Time (ms) | J1 Position (deg) | J1 Disturbance Torque (%) | J1 Current (A)
    ?? motor_torque_nm is a current
    -> motor_torque_nm J1 Current (A); motor_position_rad J1 Position (deg)
moteus = timestamp | mode | position | velocity | torque | q_curr | d_curr | voltage | temperature
    ?? time_s has no unit; motor_torque_nm has no unit; motor_position_rad has no unit
    -> motor_torque_nm torque; motor_position_rad position
VESC = ms_today | input_voltage | temp_mos_max | temp_mos_1 | temp_motor | current_motor | current_in | d_axis_current
    | q_axis_current | erpm | duty_cycle | amp_hours_used | tachometer
    ?? motor_torque_nm is a current; motor_speed_rad_s is electrical
    -> time_s ms_today; motor_torque_nm current_motor; motor_speed_rad_s erpm
Dynamixel = Time (ms) | Present Position | Present Velocity | Present Load
    ?? motor_torque_nm is a share of a torque; motor_position_rad has no unit
    -> motor_torque_nm Present Load; motor_position_rad Present Position
Yaskawa = Time[ms] | Feedback Speed[min-1] | Torque Reference[%]
    ?? "Torque Reference[%]" is what the drive was asked for
    -> motor_speed_rad_s Feedback Speed[min-1]; motor_torque_nm Torque Reference[%]
Simulink = time | theta_m | theta_l | tau_m
    ?? there are columns of 2 axes; time_s has no unit; motor_position_rad has no unit
    -> motor_position_rad theta_m; motor_torque_nm tau_m
an encoder in counts = t [s] | Position actual value (0x6064) [inc] | Torque (mNm)
    ?? motor_position_rad is in counts
    -> motor_position_rad Position actual value (0x6064) [inc]; motor_torque_nm Torque (mNm)
a gear's input = Time [s] | Input speed [rpm] | Output speed [rpm] | Input torque [Nm]
    ?? "Input torque [Nm]" leaves the side open; "Input speed [rpm]" leaves the side open
    -> motor_speed_rad_s Input speed [rpm]; load_speed_rad_s Output speed [rpm]
another current than the joint's = timestamp | actual_q_1 | actual_qd_1 | actual_current_1 | actual_robot_current |
    actual_main_voltage
    ?? motor_torque_nm is a current
    -> motor_position_rad actual_q_1; motor_torque_nm actual_current_1
a current that may be the axis' = t [s] | elbow angle [deg] | motor current [A]
    ?? of one axis is not said; motor_torque_nm is a current
    -> motor_position_rad elbow angle [deg]; motor_torque_nm motor current [A]
a unit that is none here = t [s] | angle [deg] | Torque [Ncm]
    ?? of one axis is not said; motor_torque_nm has no unit
    -> motor_torque_nm Torque [Ncm]
two torques = t [s] | angle [rad] | motor torque [Nm] | Torque [Nm]
    ?? motor_torque_nm could be each of "motor torque [Nm]", "Torque [Nm]"
    -> motor_torque_nm motor torque [Nm]
other things than channels = time [s] | position error [deg] | velocity limit [rpm] | acceleration [rad/s^2] | phase
    current [A]
    ?? no column says which channel it is
    -> time_s time [s]
two things that may be one axis = time [s] | crank angle [deg] | brake torque [Nm]
    ?? whether "crank angle [deg]", "brake torque [Nm]" are of one axis is not said
    -> motor_position_rad crank angle [deg]; motor_torque_nm brake torque [Nm]
""")


@pytest.mark.parametrize("maker", READ)
def test_names_and_units_tell_the_channels(maker: str) -> None:
    header, wanted = READ[maker].split(" -> ")
    names = [name.strip() for name in header.split("|")]
    told = (each.split(" ") for each in wanted.split(", "))
    assert of(header) == ({channel: (names[int(place)], unit) for channel, place, unit in told}, "")


@pytest.mark.parametrize("maker", ASKED)
def test_what_names_and_units_leave_in_doubt_is_asked_for(maker: str) -> None:
    header, doubts, columns = re.split(r" \?\? | -> ", ASKED[maker])
    found = recognise([name.strip() for name in header.split("|")])
    assert [doubt for doubt in doubts.split("; ") if doubt not in found.open] == []
    assert found.open.count("; ") == doubts.count("; ")
    for channel, column in (each.split(" ", 1) for each in columns.split("; ")):
        assert re.search(rf'^{channel} = {{column = "{re.escape(column)}", unit = ', found.map, re.MULTILINE), found.map


@pytest.mark.parametrize("channel", [TIME, *CHANNELS])
def test_a_channel_is_told_by_its_own_name_and_by_every_unit(channel: str) -> None:
    meaning = meaning_of(channel)
    assert meaning is not None
    assert (meaning.channel, meaning.is_sure) == (channel, True)
    bare = channel.removesuffix(
        {"N m": "_nm", "rad": "_rad", "rad/s": "_rad_s", "Cel": "_degc"}.get(CHANNELS.get(channel, ""), "_s")
    )
    for unit in units_of(channel):
        if unit not in ("iso8601", "format", "sample"):
            said = meaning_of(f"{bare.replace('_', ' ')} [{unit}]")
            assert said is not None
            assert (said.channel, said.unit) == (channel, unit)


def written(columns: dict[str, np.ndarray], units: str = "") -> str:
    rows = "".join(",".join(repr(float(value)) for value in row) + "\n" for row in zip(*columns.values(), strict=True))
    return ",".join(f'"{name}"' for name in columns) + "\n" + (units + "\n" if units else "") + rows


OTHERWISE = {
    "Time [ms]": 1e3 * T,
    "Motor position (deg)": np.degrees(MOTION["motor_position_rad"]),
    "speed in rpm": MOTION["motor_speed_rad_s"] * 30 / np.pi,
    "torque_mNm": 1e3 * MOTION["motor_torque_nm"],
    "link-side angle [mrad]": 1e3 * MOTION["load_position_rad"],
    "desired position": MOTION["motor_position_rad"],
}


@pytest.mark.parametrize("kind", ["names", "a row of units", "parquet", "text beside"])
def test_what_is_read_without_a_map_is_what_the_map_that_it_amounts_to_reads(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "t"
    if kind == "parquet":
        parquet.write_table(pa.table(OTHERWISE), path)
    elif kind == "a row of units":
        columns = dict(
            zip(["", "position", "speed", "torque", "output angle", "goal angle"], OTHERWISE.values(), strict=True)
        )
        path.write_text(written(columns, "ms,°,1/min,mNm,mrad,"))
    else:
        text = written(OTHERWISE)
        path.write_text(
            "".join(f"{line},{'state' if line[0] == chr(34) else 'on'}\n" for line in text.splitlines())
            if kind == "text beside"
            else text
        )
    found = read_telemetry(path)
    by_map = read_telemetry(path, channels=found.recognised)
    for name, values in MOTION.items():
        for read in (found, by_map):
            assert (read.time_s if name == TIME else read[name]) == pytest.approx(values, abs=1e-9)
    assert set(found.channels) == set(by_map.channels) == set(MOTION) - {TIME}
    assert recognise_columns(path).map == found.recognised
    assert len(found.ignored) == (2 if kind == "text beside" else 1)  # the desired position has no unit
    assert "# reference_position_rad = {" in found.recognised
    assert by_map.recognised == ""


def test_a_column_is_shown_with_its_course_and_whether_it_moves(tmp_path: Path) -> None:
    noise = np.random.default_rng(3).normal(-1.5, 1e-4, 400)
    rows = zip(np.arange(400), 3 * np.sin(np.arange(400) / 30), noise, ["on"] * 400, strict=True)
    (tmp_path / "log.csv").write_text("".join(f"{t};{q:.6f};{other:.4f};{word}\n" for t, q, other, word in rows))
    clock, moving, resting, text = recognise_columns(tmp_path / "log.csv").columns
    assert (clock["rises"], moving["moves"], resting["moves"], "y" in text) == (True, True, False, False)
    assert (moving["low"], moving["high"]) == pytest.approx((-3.0, 3.0), abs=1e-2)
    assert (min(moving["y"]), max(moving["y"]), clock["first"]) == (0.0, 1.0, [0.0, 1.0, 2.0])


@pytest.mark.parametrize(("behind_names", "behind_values"), [(";", ""), ("", ";"), (";", ";")])
def test_a_delimiter_behind_the_last_column_is_no_column(tmp_path: Path, behind_names: str, behind_values: str) -> None:
    rows = "".join(f"{k};{k / 50}{behind_values}\n".replace(".", ",") for k in range(ROWS))
    (tmp_path / "t.csv").write_text(f"exported by hand\nZeit [ms];Drehmoment [Nm]{behind_names}\n{rows}")
    found = read_telemetry(tmp_path / "t.csv")
    assert found.interval_s == pytest.approx(0.001)
    assert found["motor_torque_nm"][-1] == pytest.approx((ROWS - 1) / 50)


def test_iso_times_are_told_by_their_values(tmp_path: Path) -> None:
    rows = "".join(f"2026-11-28T08:30:{k // 100:02d}.{k % 100:02d}0Z,{k / 50}\n" for k in range(ROWS))
    (tmp_path / "t.csv").write_text("Datum,angle [deg]\n" + rows)
    found = read_telemetry(tmp_path / "t.csv")
    assert found.time_s == pytest.approx(T, abs=1e-6)
    assert 'time_s = {column = "Datum", unit = "iso8601"}' in found.recognised


def test_a_table_of_our_own_names_is_read_as_ever(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(written({**MOTION, "position": T, "load": T, "axis 2 torque": T}))
    found = read_telemetry(tmp_path / "t.csv")
    assert found.recognised == ""
    assert found.ignored == ("position", "load", "axis 2 torque")


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ('say "torque" [Nm]', r'"say \"torque\" [Nm]"'),
        ("drive\\torque [Nm]", r'"drive\\torque [Nm]"'),
        ("torque\u200b [Nm]", "2"),
        ("torque" + 60 * " " + "[Nm]", "2"),
        ("", "2"),
    ],
)
def test_a_name_stands_in_a_map_so_that_it_is_found_again(name: str, shown: str) -> None:
    """By its number where it is empty, too long to read, or has what nobody sees."""
    found = recognise(["t [s]", name], ["", "" if name else "Nm"])
    assert f"motor_torque_nm = {{column = {shown}, " in found.map
    column = channel_map_of(found.map).sources["motor_torque_nm"].column
    assert column in (name, 2)


def refused(path: Path) -> str:
    """The lines of a map in the refusal of a table."""
    with pytest.raises(TelemetryError) as error:
        read_telemetry(path)
    return str(error.value).partition("\n")[2]


def filled(lines: str, constants: dict[str, list[str]]) -> str:
    """The lines with what was asked for: by channel, what stands for its dots, in their order."""
    out = []
    for line in lines.splitlines():
        mended = line.partition("  #")[0]
        for value in constants.get(mended.partition(" ")[0], ()):
            mended = re.sub(r'"?\.\.\."?', value, mended, count=1)
        out.append(mended)
    return "\n".join(out)


UR10E = {"time_s": ["1", '"s"'], "motor_position_rad": ["2", '"rad"'], "motor_torque_nm": ["14", '"A", factor = 10.0']}


@pytest.mark.parametrize(
    ("file", "constants"),
    [
        ("ur10e/joint1_as_logged.csv", UR10E),
        ("../robots/ur10e/harmonics_20s.csv", UR10E),
        ("tro/drive1/as_logged/200.csv", {"motor_torque_nm": ["9.84e-5"]}),
        ("tro/drive2/as_logged/steady_n100.csv", {"motor_torque_nm": ["9.84e-5"]}),
        (
            "odrive_winch/up1_1kg_as_logged.csv",
            {"time_s": ['"s"'], "motor_position_rad": ['"rev"'], "motor_torque_nm": ["0.055133"]},
        ),
        (
            "robonine/motor_telemetry_single.csv",
            {"motor_position_rad": ['"count", counts_per_rev = 4096'], "motor_torque_nm": ["0.002"]},
        ),
    ],
)
def test_the_lines_of_a_refusal_read_the_table_once_the_constants_are_in(
    file: str, constants: dict[str, list[str]]
) -> None:
    path = shared("data", "drives", *file.split("/"))
    found = read_telemetry(path, channels=filled(refused(path), constants))
    assert set(found.channels) >= {*constants} - {TIME}
    assert found.rows >= 100


def test_axes_in_one_file_are_called_as_their_columns_begin() -> None:
    """Or by what tells them apart, where that stands behind; the lines of each can be read as they are."""
    header = ["t [s]", *(f"ODrive {k} {what}" for k in (0, 1) for what in ("Position [turns]", "Torque [Nm]"))]
    found = recognise(header)
    assert "(ODrive 0, ODrive 1)" in found.open
    lines = found.map.splitlines()
    other = [line.removeprefix("# ") for line in lines[lines.index("# of the axis ODrive 1 instead:") + 1 :]]
    chosen = channel_map_of("\n".join([*lines[:2], *other])).sources
    assert chosen["motor_torque_nm"].column == "ODrive 1 Torque [Nm]"
    assert "(0, 1)" in recognise(["timestamp", "actual_q_0", "actual_qd_0", "actual_q_1", "actual_qd_1"]).open


def test_blanks_may_stand_between_columns(tmp_path: Path) -> None:
    """As the recorder of a Universal Robot writes them."""
    rows = "".join(f"{k / 100} {np.sin(k / 100)} {k / 50}\n" for k in range(ROWS))
    (tmp_path / "t.csv").write_text("timestamp actual_q_0 actual_current_as_torque_0\n" + rows)
    found = read_telemetry(tmp_path / "t.csv")
    assert found["motor_position_rad"] == pytest.approx(MOTION["motor_position_rad"])
    assert found["motor_torque_nm"][-1] == pytest.approx((ROWS - 1) / 50)
