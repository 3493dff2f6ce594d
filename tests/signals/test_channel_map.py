"""A channel map tells columns, units and layout; the same motion in any dress is the same telemetry."""

import io
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from benchmarks.real_drives.drives import robot
from signals.errors import TelemetryError
from signals.telemetry import Telemetry, read_telemetry
from tests.shared_data import shared

ROWS = 200
TIME = np.arange(ROWS) * 0.01
ANGLE = np.sin(TIME)
SPEED = np.cos(TIME)
TORQUE = 0.3 * np.cos(3 * TIME)
START = datetime(2026, 11, 28, 8, 30, tzinfo=UTC)
BODY = """
[time_s]
column = "t"
unit = "{time}"
[motor_position_rad]
column = "pos (5)"
unit = "{angle}"
{counts}
[motor_speed_rad_s]
column = 3
unit = "{speed}"
[motor_torque_nm]
column = 4
unit = "{torque}"
factor = {factor}
"""


def table(columns: dict[str, np.ndarray | list[str]], delimiter: str = ",", decimal: str = ".", above: str = "") -> str:
    out = io.StringIO()
    out.write(above)
    out.write(delimiter.join(columns) + "\n")
    for row in zip(*columns.values(), strict=True):
        cells = [cell if isinstance(cell, str) else repr(float(cell)).replace(".", decimal) for cell in row]
        out.write(delimiter.join(cells) + "\n")
    return out.getvalue()


def read(path: Path, content: str | bytes, text: str) -> Telemetry:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_telemetry(path, channels=text)


def is_the_motion(found: Telemetry) -> None:
    assert found.time_s == pytest.approx(TIME, abs=1e-6)
    assert found["motor_position_rad"] == pytest.approx(ANGLE, abs=1e-12)
    assert found["motor_speed_rad_s"] == pytest.approx(SPEED, abs=1e-12)
    assert found["motor_torque_nm"] == pytest.approx(TORQUE, abs=1e-12)


@pytest.mark.parametrize("dress", ["milliseconds and degrees", "counts and amperes", "ISO times and per cent"])
@pytest.mark.parametrize(("delimiter", "decimal"), [(",", "."), (";", ","), ("\t", ","), (";", ".")])
def test_one_motion_in_every_dress_is_the_same(tmp_path: Path, dress: str, delimiter: str, decimal: str) -> None:
    counts = ""
    if dress == "milliseconds and degrees":
        columns = {"t": 1e3 * TIME, "pos (5)": np.degrees(ANGLE), "v": SPEED * 30 / np.pi, "i": 1e3 * TORQUE}
        words = {"time": "ms", "angle": "deg", "speed": "rpm", "torque": "mN.m", "factor": "1"}
    elif dress == "counts and amperes":
        columns = {
            "t": 1e6 * TIME,
            "pos (5)": ANGLE * 4096 / (2 * np.pi),
            "v": SPEED / (2 * np.pi),
            "i": -TORQUE / 0.05,
        }
        words = {"time": "us", "angle": "count", "speed": "rev/s", "torque": "A", "factor": "-0.05"}
        counts = "counts_per_rev = 4096"
    else:
        times = [(START + timedelta(seconds=float(t))).isoformat() for t in TIME]
        columns = {"t": times, "pos (5)": ANGLE / (2 * np.pi), "v": np.degrees(SPEED), "i": TORQUE / 9.84e-5}
        words = {"time": "iso8601", "angle": "rev", "speed": "deg/s", "torque": "%", "factor": "9.84e-5"}
    is_the_motion(read(tmp_path / "t.csv", table(columns, delimiter, decimal), BODY.format(counts=counts, **words)))


PLAIN = BODY.format(time="s", angle="rad", speed="rad/s", torque="N.m", factor="1", counts="")
COLUMNS = {"t": TIME, "pos (5)": ANGLE, "v": SPEED, "i": TORQUE}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_a_preamble_and_a_row_of_units_are_no_values(tmp_path: Path, encoding: str) -> None:
    above = "Date:;2026-11-28\nFirmware:;0x0120;0x6150\n\nTemperatur [°C]:;21,5\n"
    lines = table(COLUMNS, ";", ",", above).splitlines()
    lines.insert(5, "s;rad;rad/s;N m")
    is_the_motion(read(tmp_path / "t.csv", "\r\n".join([*lines, ""]).encode(encoding), PLAIN))


def test_what_is_skipped_gives_no_names(tmp_path: Path) -> None:
    """However alike the rows above are: they have as many cells, and the names are as short as units."""
    content = table(COLUMNS, above="a,b,c,d\n1,2,3,4\n\ne,f,g,h\n")
    is_the_motion(read(tmp_path / "t.csv", content, PLAIN))
    is_the_motion(read(tmp_path / "t.csv", content, "skip_rows = 4\n" + PLAIN))


def test_without_a_header_and_without_a_clock(tmp_path: Path) -> None:
    text = PLAIN.replace('column = "t"\nunit = "s"', 'unit = "sample"\nrate_hz = 100').replace('"pos (5)"', "2")
    content = table(COLUMNS).partition("\n")[2]
    is_the_motion(read(tmp_path / "t.csv", content, text))
    is_the_motion(read(tmp_path / "t.csv", content, "header = false\n" + text))


def test_rows_in_which_a_channel_has_not_begun_are_left_out(tmp_path: Path) -> None:
    late = ANGLE.copy()
    late[:50] = np.nan
    found = read(tmp_path / "t.csv", table({**COLUMNS, "pos (5)": late}), PLAIN)
    assert found.rows == ROWS - 50
    assert found["motor_position_rad"] == pytest.approx(ANGLE[50:])
    assert not found.lost


def test_a_parquet_table_has_its_own_types(tmp_path: Path) -> None:
    times = pa.array([START + timedelta(seconds=float(t)) for t in TIME], pa.timestamp("us", tz="UTC"))
    parquet.write_table(pa.table({**COLUMNS, "t": times}), tmp_path / "t.parquet")
    is_the_motion(read_telemetry(tmp_path / "t.parquet", channels=PLAIN.replace('unit = "s"', 'unit = "iso8601"', 1)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('column = "t"', 'column = "clock"'), 'column = "clock" is not in the table; it has t, pos (5), v, i'),
        (("column = 4", "column = 9"), "[motor_torque_nm] column = 9; the table has 4 columns"),
        (('unit = "N.m"\nfactor = 1', 'unit = "A"'), "[motor_torque_nm] unit = 'A' needs factor (N m per unit)"),
        (('unit = "rad"', 'unit = "count"'), "[motor_position_rad] unit = 'count' needs counts_per_rev"),
        (('unit = "rad/s"', 'unit = "knots"'), "[motor_speed_rad_s] unit = 'knots' is not known; there are rad/s"),
        (('unit = "N.m"', 'unit = "mA"'), 'write unit = "A", with the factor in N m per mA'),
        (('unit = "rad/s"', 'unit = "1/min"'), '; write unit = "rpm"'),
        (("[motor_torque_nm]", "[torque]"), "[torque] is no channel; there are"),
        (("factor = 1", "factor = 0"), "factor = 0 has to be a number other than 0"),
        (("[time_s]", 'schema = "other/2"\n[time_s]'), 'write schema = "gearcase-channels/1"'),
        (("[time_s]", "skip_rows = true\n[time_s]"), "skip_rows = True; write it as skip_rows = 14"),
        (("[time_s]", "[time_s"), "this is no TOML"),
    ],
)
def test_a_wrong_line_of_a_map_is_named_with_what_would_be_right(
    tmp_path: Path, change: tuple[str, str], words: str
) -> None:
    with pytest.raises(TelemetryError) as refused:
        read(tmp_path / "t.csv", table(COLUMNS), PLAIN.replace(*change, 1))
    assert words in str(refused.value)


def test_channels_under_their_own_names_need_no_map_in_any_layout(tmp_path: Path) -> None:
    own = {"time_s": TIME, "motor_position_rad": ANGLE, "motor_speed_rad_s": SPEED, "motor_torque_nm": TORQUE}
    for number, (delimiter, decimal) in enumerate(((";", ","), ("\t", "."))):
        path = tmp_path / f"{number}.csv"
        path.write_text(table(own, delimiter, decimal, "exported by hand\n"))
        is_the_motion(read_telemetry(path))


def of_drives(*parts: str) -> Path:
    return shared("data", "drives", *parts)


def test_a_robots_log_is_read_as_it_is() -> None:
    """31 columns without names, current in A; what it says in the channels' units stands beside it."""
    found, known = (
        read_telemetry(of_drives("ur10e", "joint1_as_logged.csv"), channels=robot(1)),
        read_telemetry(of_drives("ur10e", "joint1.csv")),
    )
    assert found.sample_rate_hz == pytest.approx(100.0, rel=0.25)
    place = int(np.argmin(np.abs(found["motor_position_rad"] - known["motor_position_rad"][0])))
    assert place >= 0
    assert np.ptp(found["motor_torque_nm"]) == pytest.approx(np.ptp(known["motor_torque_nm"]), rel=0.2)


@pytest.mark.parametrize(
    ("format_", "zone"),
    [
        ("%d.%m.%Y %H:%M:%S,%f", UTC),
        ("%m/%d/%Y %I:%M:%S.%f %p", UTC),
        ("%H:%M:%S.%f", UTC),
        ("%I:%M:%S.%f0 %p", UTC),
        ("%d.%m.%Y %H:%M:%S.%f %z", ZoneInfo("Europe/Berlin")),
    ],
)
def test_stamps_of_any_format_are_times_over_midnight_and_the_end_of_summer_time(
    tmp_path: Path, format_: str, zone: tzinfo
) -> None:
    start = datetime(2026, 10, 25, 0, 59, 59, tzinfo=UTC) - timedelta(hours=0 if format_.endswith("z") else 1)
    stamps = [(start + timedelta(seconds=float(t))).astimezone(zone).strftime(format_) for t in TIME]
    columns = {"t": stamps, "pos (5)": ANGLE, "v": SPEED, "m": TORQUE}
    asked = format_.replace("%f0", "%f")  # seven digits, as .NET writes them
    body = BODY.format(time="format", angle="rad", counts="", speed="rad/s", torque="N.m", factor=1.0)
    body = body.replace('unit = "format"', f'unit = "format"\nformat = "{asked}"')
    is_the_motion(read(tmp_path / "log.csv", table(columns, ";", ","), body))


def test_no_map_is_offered_that_cannot_read_the_file(tmp_path: Path) -> None:
    stamps = [(START + timedelta(seconds=float(t))).strftime("%d.%m.%Y %H:%M:%S") for t in TIME]
    path = tmp_path / "log.csv"
    path.write_text(table({"Zeit": stamps, "position": ANGLE, "current": TORQUE}))
    with pytest.raises(TelemetryError, match=r'no number in row 2.*unit = "format", format = ') as refused:
        read_telemetry(path)
    assert "these lines are a channel map" not in str(refused.value)


def test_units_stand_below_some_names_and_names_below_others(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    above = "Axis1\nTime,Analog 1,Analog 2\nms,motor position [deg],Torque [Nm]\n"
    path.write_text(above + table({"1": 1e3 * TIME, "2": np.degrees(ANGLE), "3": TORQUE}).partition("\n")[2])
    found = read_telemetry(path)
    assert found.time_s == pytest.approx(TIME)
    assert found["motor_position_rad"] == pytest.approx(ANGLE)
    assert found["motor_torque_nm"] == pytest.approx(TORQUE)
