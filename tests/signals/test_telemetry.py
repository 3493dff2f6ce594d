"""Telemetry tables are read as they are, or refused with the row and what would be right."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from signals.errors import TelemetryError
from signals.telemetry import MOST_COLUMNS, TelemetryLimits, check_telemetry, read_telemetry

ROWS = 400
TIME = np.arange(ROWS) * 0.0005
TORQUE = np.sin(TIME * 30) * 1.2345678901234567


def columns(**more: object) -> dict[str, object]:
    return {"time_s": TIME, "motor_torque_nm": TORQUE} | more


def write_csv(path: Path, table: dict[str, object]) -> Path:
    lines = [",".join(table)]
    lines += [",".join(str(cell) for cell in row) for row in zip(*table.values(), strict=True)]  # type: ignore[call-overload]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_csv_and_parquet_give_the_same_telemetry_to_the_last_digit(tmp_path: Path) -> None:
    written = write_csv(tmp_path / "t.csv", columns(note=["a"] * ROWS, load_position_rad=TIME * 2))
    parquet.write_table(pa.table(columns(note=["a"] * ROWS, load_position_rad=TIME * 2)), tmp_path / "t.parquet")
    for path in (written, tmp_path / "t.parquet"):
        telemetry = read_telemetry(path)
        np.testing.assert_array_equal(telemetry.time_s, TIME)
        np.testing.assert_array_equal(telemetry["motor_torque_nm"], TORQUE)
        assert telemetry.units() == {"motor_torque_nm": "N m", "load_position_rad": "rad"}
        assert telemetry.ignored == ("note",)
        assert not telemetry.lost
        assert telemetry.sample_rate_hz == pytest.approx(2000)
        assert telemetry.rows == ROWS
        assert "shaft_torque_nm" not in telemetry


def test_a_few_missing_values_are_filled_and_told(tmp_path: Path) -> None:
    torque: list[object] = list(TORQUE)
    torque[5], torque[200], torque[201] = "", "nan", ""
    telemetry = read_telemetry(write_csv(tmp_path / "t.csv", columns(motor_torque_nm=torque)))
    assert np.flatnonzero(telemetry.lost["motor_torque_nm"]).tolist() == [5, 200, 201]
    assert telemetry["motor_torque_nm"][5] == pytest.approx((TORQUE[4] + TORQUE[6]) / 2)
    assert np.isfinite(telemetry["motor_torque_nm"]).all()


def test_a_gap_in_the_clock_stays_a_gap(tmp_path: Path) -> None:
    whole = np.r_[0:150, 170:ROWS]
    table = {"time_s": TIME[whole], "motor_torque_nm": TORQUE[whole]}
    telemetry = read_telemetry(write_csv(tmp_path / "t.csv", table))
    assert telemetry.interval_s == pytest.approx(0.0005)
    assert np.diff(telemetry.time_s).max() == pytest.approx(21 * 0.0005)


def broken(name: str) -> dict[str, object]:
    time, torque = TIME.copy(), list(TORQUE)
    if name == "backwards":
        time[100] = time[98]
    if name == "no time":
        time[7] = np.nan
    if name == "infinite":
        torque[3] = np.inf
    if name == "mostly missing":
        torque[: ROWS // 5] = [np.nan] * (ROWS // 5)
    if name == "words":
        torque[9] = "off"  # type: ignore[call-overload]
    return {"time_s": time, "motor_torque_nm": torque}


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("backwards", r"does not run forwards: 0\.0495 s in row 100, then 0\.049 s"),
        ("no time", "row 8"),
        ("infinite", "motor_torque_nm is infinite in row 4"),
        ("mostly missing", "80 of 400"),
        ("words", "motor_torque_nm holds something that is no number"),
    ],
)
def test_broken_columns_are_named_with_their_row(tmp_path: Path, name: str, words: str) -> None:
    with pytest.raises(TelemetryError, match=words):
        read_telemetry(write_csv(tmp_path / "t.csv", broken(name)))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"time_s,motor_torque_nm\n", "0 rows"),
        (b"time_s,motor_torque_nm\n0,1\n0.1,2\n", "2 rows are too few"),
        (b"t,motor_torque_nm\n0,1\n", "time_s has no unit.* The table has t \\(0 to 0\\), motor_torque_nm"),
        (b"time_s,torque\n0,1\n", "motor_torque_nm has no unit"),
        (b"time_s,note\n0,1\n", "no column says which channel it is"),
        (b"time_s,motor_torque_nm,motor_torque_nm\n" + b"".join(b"%d,1,1\n" % i for i in range(200)), "twice"),
        (b"time_s,motor_torque_nm\n0,1,2\n", "not a CSV table"),
        (b"PAR1" + bytes(40), "Parquet"),
        (b"\xff\xfe\x00\x01" * 50, "."),
    ],
)
def test_what_is_no_telemetry_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "t"
    path.write_bytes(content)
    with pytest.raises(TelemetryError, match=words):
        read_telemetry(path)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_only_so_many_values_are_read_and_of_known_columns_alone(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"t.{kind}"
    more = {f"column {number}": [0.5] * ROWS for number in range(20)}
    if kind == "csv":
        write_csv(path, columns(**more))
    else:
        parquet.write_table(pa.table(columns(**more)), path)
    assert read_telemetry(path, TelemetryLimits(cells=2 * ROWS)).ignored == tuple(more)
    for read in (read_telemetry, check_telemetry):
        with pytest.raises(TelemetryError, match="at most 799 values are read"):
            read(path, TelemetryLimits(cells=2 * ROWS - 1))


def test_a_table_of_more_columns_than_any_log_has_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("time_s,motor_torque_nm," + ",".join(map(str, range(MOST_COLUMNS))) + "\n")
    with pytest.raises(TelemetryError, match="10002 columns"):
        read_telemetry(path)


def test_reading_that_takes_too_long_or_too_much_is_given_up_and_the_next_is_not(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "t.csv", columns())
    for limits, words in (
        (TelemetryLimits(seconds=0.0), "more time than allowed"),
        (TelemetryLimits(memory_bytes=1 << 20), "given up"),
    ):
        with pytest.raises(TelemetryError, match=words):
            read_telemetry(path, limits)
        assert read_telemetry(path).rows == ROWS


@pytest.mark.parametrize(("start", "words"), [(b"RIFF\x24\x00\x00\x00WAVE", "WAV"), (b"\x01\x00\xff", "binary")])
def test_a_binary_file_is_called_so_without_its_bytes(tmp_path: Path, start: bytes, words: str) -> None:
    path = tmp_path / "telemetry.csv"
    path.write_bytes(start + bytes(range(256)) * 20)
    with pytest.raises(TelemetryError, match=words) as refused:
        read_telemetry(path)
    assert str(refused.value).isprintable()
