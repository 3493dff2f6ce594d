"""scipy's DOP853 with its steps compiled: the same coefficients, control of the step and interpolant."""

import numpy as np
from scipy.integrate import DOP853, DenseOutput

from sim.piecewise_affine.system import Array
from sim.runge_kutta import kernel
from sim.runge_kutta.law import Law, Signals

RELATIVE_TOLERANCE = 1e-11
LONGEST_STEP_S = 0.02


class Steps(DOP853):
    """Integrates angles and speeds of a law, which are at most `scale`; signals' pieces began at `began` [s]."""

    def __init__(self, law: Law, began: float, signals: Signals, t0: float, y0: Array, t_bound: float, scale: Array):
        self._law, self._began, self._signals = law, began, signals
        self._tolerance = RELATIVE_TOLERANCE * 1e-2 * np.maximum(scale, 1e-6)
        super().__init__(
            lambda t, y: law.rate(np.asarray(y, np.float64), t - began, signals),
            t0,
            y0,
            t_bound,
            max_step=LONGEST_STEP_S,
            rtol=RELATIVE_TOLERANCE,
            atol=self._tolerance,  # type: ignore[arg-type]
        )


class CompiledSteps(Steps):
    """The same of a law that is reduced, in compiled code."""

    def _step_impl(self) -> tuple[bool, str | None]:
        law = self._law
        assert law.reduced is not None
        end, y, f, taken, following = kernel.step(
            self.t, self.y, self.f, self.h_abs, self.t_bound, LONGEST_STEP_S, self._began, RELATIVE_TOLERANCE,
            self._tolerance, law.reduced.tables, law.curves, self._signals, self.K_extended,
        )  # fmt: skip
        if taken == 0.0:
            return False, self.TOO_SMALL_STEP
        self.h_previous, self.y_old = taken, self.y
        self.t, self.y, self.h_abs, self.f = end, y, following, f
        return True, None

    def _dense_output_impl(self) -> DenseOutput:
        law = self._law
        assert law.reduced is not None
        old = np.asarray(self.y_old, np.float64)
        terms = kernel.interpolant(
            self.t_old, old, self.h_previous, self.y, self.f, self._began,
            law.reduced.tables, law.curves, self._signals, self.K_extended,
        )  # fmt: skip
        return _Interpolant(float(self.t_old or 0.0), self.t, old, terms)


class _Interpolant(DenseOutput):
    def __init__(self, t_old: float, t: float, y_old: Array, terms: Array) -> None:
        super().__init__(t_old, t)
        self._y_old, self._terms = y_old, terms

    def _call_impl(self, t: Array) -> Array:
        shares = (np.atleast_1d(t) - self.t_old) / (self.t - self.t_old)
        values = kernel.interpolated(shares, self._y_old, self._terms).T
        return np.asarray(values[:, 0] if t.ndim == 0 else values)
