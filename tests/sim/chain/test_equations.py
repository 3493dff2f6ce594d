"""A run of the chain whose kernel does not obey the laws is an error, and an honest one is not."""

from __future__ import annotations

import types
from collections.abc import Iterator
from pathlib import Path

import numba
import numpy as np
import pytest

import sim.chain
from sim.chain import kernel
from sim.chain.integrate import run_chain
from sim.chain.model import Dent, Line, Servo, with_shaft
from sim.chain.motion_profile import back_and_forth
from sim.errors import RunError
from tests.sim.axes import three_shafts

STUCK = "w[MARGIN + m] = _friction(s, 0.0, 1.0, t, p) + ahead"
WRONG = {
    "friction": ("load - _friction(s, speed, float(way), t, p)", "load - 0.99 * _friction(s, speed, float(way), t, p)"),
    "contact": ("    spring = _spring(x, c, p[a + CUBIC])", "    spring = _spring(x, 1.001 * c, p[a + CUBIC])"),
    "loss": ("_law_of_losses(load, way, drives,", "_law_of_losses(load, way, not drives,"),
    "dent": ("x = side * x - p[a + HALF] - depth", "x = side * x - p[a + HALF] - 0.9 * depth"),
    "lever of an error": ("w[ASKS + k] -= slope", "w[ASKS + k] += slope"),
    "stuck too long": (STUCK, STUCK.replace("_friction(s", "3.0 * _friction(s")),
    "step": ("sixth = h / 6.0", "sixth = h / 6.01"),
}


def run(rate_hz: float = 2000.0) -> float:
    """Back and forth over a dent with everything that a chain can have; the largest residual."""
    chain = three_shafts(
        hysteresis_n_m=2.0,
        gap_rad=1e-3,
        errors=(Line(1, 11.0, 1e-4, 0.3), Line(2, 30.0, 5e-5, 1.0)),
        dents=(Dent(2, 0.0, 0.3, 1e-3), Dent(2, 0.0, 0.3, 1e-3, -1)),
        efficiency=(0.9, 0.8),
    )
    chain = with_shaft(chain, 0, coulomb_n_m=0.5, stribeck_n_m=0.2, coulomb_backward_n_m=0.3)
    reference = back_and_forth(np.arange(int(rate_hz)) / rate_hz, 0.8, 60.0, 0.1, 0.05)
    reference[2] *= 0.0072
    result = run_chain(chain, Servo(reference, 12.0, 0.5, 0.08, 500.0, 200.0), rate_hz, reference.shape[1])
    return result.residual.largest


def test_an_honest_run_passes() -> None:
    assert run() < 1e-7


@pytest.fixture
def interpreted() -> Iterator[None]:
    """Functions that are made meanwhile are not compiled."""
    numba.config.DISABLE_JIT = True
    yield
    numba.config.DISABLE_JIT = False


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("law", WRONG)
def test_a_wrong_law_in_the_kernel_is_found(law: str, monkeypatch: pytest.MonkeyPatch) -> None:
    source = Path(kernel.__file__).read_text(encoding="utf-8")
    right, wrong = WRONG[law]
    assert right in source
    changed = types.ModuleType("changed")
    exec(compile(source.replace(right, wrong), kernel.__file__, "exec"), changed.__dict__)
    monkeypatch.setattr(sim.chain, "kernel", changed)
    with pytest.raises(RunError, match="residual"):
        run()
