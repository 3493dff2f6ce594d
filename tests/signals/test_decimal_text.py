"""CSV with nine decimals: what is read back is the rounded number."""

from pathlib import Path

import numpy as np
import pytest

from signals.reading.decimal_text import LARGEST, ROWS, write_decimals


def test_what_is_read_back_is_the_number_to_nine_decimals(tmp_path: Path) -> None:
    """Over all sizes, more rows than are written at once; the largest of them have fewer digits than nine decimals."""
    rng = np.random.default_rng(0)
    sizes = 10.0 ** rng.uniform(-12, 6.5, 2 * ROWS + 7)
    columns = {"a": sizes * rng.choice([-1, 1], sizes.size), "b": np.arange(sizes.size) / 2000, "c": sizes[::-1]}
    write_decimals(columns, tmp_path / "x.csv")
    read = np.genfromtxt(tmp_path / "x.csv", delimiter=",", names=True)
    for name, values in columns.items():
        assert np.array_equal(read[name], np.round(values, 9))


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-1e-10, "0"),
        (-1e-9, "-0.000000001"),
        (-0.5, "-0.5"),
        (10.0, "10"),
        (0.1 + 0.2, "0.3"),
        (1999.9999999999, "2000"),
        (LARGEST, "9200000000.0"),
        (1e300, "1e+300"),
        (float("nan"), "nan"),
    ],
)
def test_numbers_as_text(tmp_path: Path, value: float, text: str) -> None:
    write_decimals({"x": np.array([value])}, tmp_path / "x.csv")
    assert (tmp_path / "x.csv").read_text() == f"x\n{text}\n"
