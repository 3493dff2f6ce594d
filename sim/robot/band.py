"""The band of frequencies in which the accelerations of a robot are motion rather than noise of its encoders.

Beyond it inertias seem smaller than they are: the noise of a position, differentiated twice, turns with what is fitted
(errors in variables), and masses, tilt and payload make up for what that changes of gravity. Torques and all that they
are explained by are filtered alike and thinned (parallel decimation: Gautier 1997).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.signal import oaconvolve, welch

from sim.discrepancy.data.preprocessing import gaussian_kernel
from sim.robot.motion import ROWS_PER_CUT, Motion
from sim.robot.rigid_body import RigidBody

Array = NDArray[np.float64]

SEGMENT_S = 4.0  # of a spectrum
LEAST_HZ = 1.0  # in which a robot's motion is in any case
MOSTLY = 0.5  # of the power in an octave
POSES = 100  # in which it is asked what an acceleration of each joint asks for
ENOUGH = 0.5  # of the rows that count, else a log is too short for a narrower band
FELT = 0.1  # of a smoothed row, that a joint was at rest


@dataclass(frozen=True)
class Band:
    """Rows of `rows_hz`, smoothed once more up to `cut_hz`, of which every `stride`th is kept; 0: all, as they are."""

    cut_hz: float
    rows_hz: float
    stride: int

    @staticmethod
    def of(body: RigidBody, motion: Motion) -> Band:
        """Up to the first octave in which what accelerations ask for is mostly noise of the encoders."""
        noise = motion.acceleration_noise
        if not noise.any():
            return Band(motion.cut_hz, motion.rate_hz, 0)
        rows = np.flatnonzero(motion.counts)
        asked = _inertial(body, motion.position[rows], motion.acceleration[rows])
        segment = min(rows.size, int(SEGMENT_S * motion.rate_hz))
        places_hz, power = welch(asked, motion.rate_hz, nperseg=segment, axis=0)
        at = np.linspace(0.0, 0.5 * motion.rate_hz, noise.shape[0])
        few = motion.position[rows[:: max(1, rows.size // POSES)]]
        by_noise = np.zeros_like(power)
        for joint, unit in enumerate(np.eye(noise.shape[1])):
            felt = np.mean(_inertial(body, few, np.tile(unit, (len(few), 1))) ** 2, axis=0)
            by_noise += np.interp(places_hz, at, noise[:, joint])[:, None] * felt
        loud = np.maximum(np.var(motion.torque[rows], axis=0), 1e-300)
        asks, noisy = (np.cumsum(np.sum(each / loud, axis=1)) for each in (power, by_noise))
        octave = np.minimum(2 * np.arange(places_hz.size), places_hz.size - 1)
        mostly = np.flatnonzero((noisy[octave] - noisy > MOSTLY * (asks[octave] - asks)) & (places_hz >= LEAST_HZ))
        if not mostly.size or places_hz[mostly[0]] >= motion.cut_hz:
            return Band(motion.cut_hz, motion.rate_hz, 0)
        cut_hz = float(places_hz[mostly[0]])
        band = Band(cut_hz, motion.rate_hz, max(1, int(motion.rate_hz / (ROWS_PER_CUT * cut_hz))))
        left = band.counting(motion.counts, np.zeros_like(motion.counts)).sum() * band.stride
        return band if left > ENOUGH * rows.size else Band(motion.cut_hz, motion.rate_hz, 0)

    @property
    def rate_hz(self) -> float:
        return self.rows_hz / max(self.stride, 1)

    def smooth(self, values: Array) -> Array:
        """Columns of rows, shape (rows, ...)."""
        if not self.stride:
            return values
        kernel = gaussian_kernel(self.cut_hz, self.rows_hz, 0)
        half = kernel.size // 2
        ends = [(half, half), *[(0, 0)] * (values.ndim - 1)]
        padded = np.pad(values, ends, "reflect", reflect_type="odd")
        shaped = kernel.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray(oaconvolve(padded, shaped, "valid", axes=0)[:: self.stride], dtype=np.float64)

    def counting(self, counts: NDArray[np.bool_], rested: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Rows of a joint whose smoothing meets none that does not count, and hardly any of a rest."""
        if not self.stride:
            return counts & ~rested
        size = gaussian_kernel(self.cut_hz, self.rows_hz, 0).size
        all_count = minimum_filter1d(counts, size, mode="constant", cval=0)[:: self.stride]
        return np.asarray(all_count & (self.smooth(rested.astype(float)) < FELT), dtype=np.bool_)


def _inertial(body: RigidBody, position: Array, acceleration: Array) -> Array:
    """Torque of the links' inertias alone, shape (rows, joints) [N m]."""
    still = np.zeros_like(position)
    return body.torque(position, still, acceleration) - body.torque(position, still, still)
