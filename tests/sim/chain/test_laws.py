"""Laws that the simulation and the observer share."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sim.chain.model import Dent
from sim.chain.rows import dent_rows
from sim.laws import dents, friction, spring


@pytest.mark.parametrize("slip", [-1.0, -0.4, -0.01, 0.0, 0.01, 0.4, 1.0])
def test_friction_never_drives(slip: float) -> None:
    """However much it differs by direction, and however little of it is held."""
    torque = friction(5.0, 0.2, 0.3, 0.1, 1.0, 2.0, 1.5, 0.0, 0.0, slip, 0.0)
    assert torque * slip > 0.0 or torque == slip == 0.0
    speed = 4.0 * slip
    assert friction(5.0, 0.2, 0.3, 0.1, 1.0, 2.0, 1.5, 0.0, speed, slip, 0.0) * speed >= 0.0


def test_sliding_friction_is_that_of_its_direction() -> None:
    both = (5.0, 2.0, 0.3, 0.1, 0.0, 1.0, 2.0, 0.01)
    assert friction(*both, 10.0, 1.0, 3.0) == pytest.approx((5.0 + 0.3 * 10.0) * 1.03)
    assert friction(*both, -10.0, -1.0, 3.0) == pytest.approx(-(2.0 + 0.1 * 10.0) * 1.03)


def test_a_spring_that_hardens_is_the_slope_of_its_energy() -> None:
    x, step = np.linspace(-2e-3, 2e-3, 5), 1e-8

    def energy(at: np.ndarray) -> np.ndarray:
        return np.asarray(1e5 * (at**2 / 2 + 3e4 * at**4 / 4))

    slope = (energy(x + step) - energy(x - step)) / (2.0 * step)
    assert [spring(float(at), 1e5, 3e4) for at in x] == pytest.approx(slope, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("flank", [1, -1])
@pytest.mark.parametrize("form", [2.0, 7.5])
def test_the_slope_of_a_dent_is_that_of_its_depth(form: float, flank: int) -> None:
    (row,) = dent_rows([Dent(1, 0.4, 0.1, 1e-3, flank, form)])
    step = 1e-7

    def at(angle: float, side: float = float(flank)) -> tuple[float, float, float]:
        return dents(list(row), 0, len(row), side, 0, [0.0, angle], 0)

    for angle in (0.31, 0.36, 0.44, 0.4 + 2.0 * math.pi + 0.09):
        slope = (at(angle + step)[0] - at(angle - step)[0]) / (2.0 * step)
        assert at(angle)[1:] == pytest.approx((0.0, slope), rel=1e-5)
    assert at(0.4) == pytest.approx((1e-3, 0.0, 0.0))
    assert at(0.51) == at(0.4, -float(flank)) == (0.0, 0.0, 0.0)


def test_what_is_compiled_follows_a_law_that_has_changed(tmp_path: Path) -> None:
    """numba's cache sees changes of the file of a function alone, not of what that calls."""
    laws = Path(__file__).parents[3] / "sim" / "laws.py"
    (tmp_path / "caller.py").write_text(
        "from numba import njit\n"
        "import laws\n"
        "law = njit(laws.spring)\n"
        "@njit(cache=True)\n"
        "@laws.keyed\n"
        "def twisted(x): return law(x, 2.0, 0.0)\n"
        "print(twisted(3.0), sum(twisted.stats.cache_hits.values()))\n"
    )
    told = []
    for stiffness in ("stiffness", "stiffness", "5.0 * stiffness"):
        changed = laws.read_text().replace("return stiffness *", f"return {stiffness} *")
        (tmp_path / "laws.py").write_text(changed)
        done = subprocess.run([sys.executable, "caller.py"], cwd=tmp_path, capture_output=True, text=True, check=True)
        told.append(done.stdout.split())
    assert told == [["6.0", "0"], ["6.0", "1"], ["30.0", "0"]]
