"""Measured channels made ready: smoothed by one kernel each, differentiated, without edges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, label, maximum, minimum_filter1d, uniform_filter1d
from scipy.signal import fftconvolve, upfirdn

Array = NDArray[np.float64]

LEAST_ROWS = 50  # in motion that a record needs: ten for each number of one body with friction
RATE_HZ = 1000.0  # of the prepared channels: four times the fastest mode that matters
WIDE_SHARE = 0.3  # -3 dB frequency of torque and acceleration over the sample rate
ANGLE_CUT_HZ = 150.0  # motor angle that drives the chain: far above its modes, below the encoder's noise
SLOW_ANGLE_CUT_HZ = 40.0  # the same without its encoder's noise, which springs and dampers turn into torque
LOAD_CUT_HZ = 50.0  # above this a load encoder of 20 bits says nothing about torque: what is left is cut off there
LOAD_MOTION_CUT_HZ = 10.0  # the same for the load's angle
MOTION_CUT_HZ = (
    12.0  # acceleration below it is the motion's own; above, mostly the encoder's noise, which would shrink inertias
)
SLOW_DIRECT_ANGLE_CUT_HZ = MOTION_CUT_HZ  # of an angle without gears: a stiff coupling makes far more of its noise
REACH = 4  # rows on either side of a gap that are felt, per row of it
REST_S = 0.4  # a shorter one is a reversal
SLIPPED_RAD = 0.01  # of the motor after a rest, over which friction slides whatever it held: five times the way of most
PIER = 50  # rows on either side of lost ones from whose mean a line leads over them
TURNED_ROWS = 2  # on either side of a reversal, over which the torque's kernel spreads all but a hundredth of it
STANDSTILL_SHARE = 0.012  # of the largest speed: below, dry friction is whatever it needs to be


@dataclass(frozen=True)
class Measurement:
    """Channels over one clock after smoothing; every array has shape (n,).

    `torque` and `acceleration` share one wide kernel [N m], [rad/s2]; `slow_acceleration` is nearly free of noise;
    `angle`, `speed` are of the motor; `load_angle`, `load_speed` are None without a load encoder; `slow_...` drive the
    chain, nearly free of noise. `valid`, `load_valid`: 1 where a row can be trusted, else 0; `standstill`: share of
    the largest speed below which it does not count; `rests`: it counts at the motor, from the first motion on;
    `known_torque`: what the load is known to ask for besides [N m], None where nothing is known;
    `predictable`: 1 where a model predicts the motor's torque, 0 where teeth rattle; `unsure`, shape
    (n, p): ways in which the torque may be wrong as a whole, each by a standard deviation [N m]; `doubts`: the same of
    the known torque, felt at the motor; `gear`: turns of the motor per turn of what it moves as one body.
    """

    rate_hz: float
    time_s: Array
    torque: Array
    acceleration: Array
    slow_acceleration: Array
    angle: Array
    speed: Array
    slow_angle: Array
    slow_speed: Array
    load_angle: Array | None
    load_speed: Array | None
    slow_load_angle: Array | None
    slow_load_speed: Array | None
    valid: Array
    load_valid: Array
    standstill: float = STANDSTILL_SHARE
    rests: bool = False
    predictable: Array = field(default_factory=lambda: np.ones(1))
    known_torque: Array | None = None
    doubts: Array = field(default_factory=lambda: np.zeros((0, 0)))
    gear: float = 1.0

    @cached_property
    def wrong_ways(self) -> Array:
        """Ways in which the known torque may be wrong, shape (n, p), across rows that do not count [N m]."""
        return np.stack([self.across(w) for w in self.doubts.T], axis=1) if self.doubts.size else self.doubts

    @cached_property
    def moving(self) -> Array:
        """1 in motion, 0 at standstill, shape (n,); of a robot's joint also where smoothing reaches a reversal.

        Friction of one body turns its sign there in an instant, and its torque within the kernel that smoothed it.
        """
        moves = standstill_weight(self.slow_speed, self.standstill)
        if self.doubts.size:
            moves = minimum_filter1d(moves, 2 * TURNED_ROWS + 1)
        return np.asarray(moves * (1.0 - self.resting))

    @cached_property
    def resting(self) -> Array:
        """1 at rest and until friction slides after it, 0 in motion and where that turns back, shape (n,)."""
        still = standstill_weight(self.slow_speed, self.standstill) < 0.5
        return _resting(still, self.slow_angle, self.rate_hz).astype(np.float64)

    @cached_property
    def awake(self) -> Array:
        """0 in rests that do not count, else 1, shape (n,)."""
        return np.maximum(1.0 - self.resting, self.counts > 0.5)

    @cached_property
    def counts(self) -> Array:
        """1 where the motor torque counts by its speed, 0 where it does not, shape (n,)."""
        return np.maximum.accumulate(self.moving) if self.rests else self.moving

    @cached_property
    def weight(self) -> Array:
        """The same, and 0 where it cannot be trusted or predicted."""
        return np.asarray(self.counts * self.valid * self.predictable)

    @cached_property
    def bridge(self) -> Bridge:
        """Over rests that do not count, and rows of the motor torque that cannot be trusted or predicted."""
        return Bridge.over(self.valid * self.predictable * self.awake < 0.5)

    def across(self, torque: Array) -> Array:
        """What of a torque counts, shape (n,): 0 where the motion turns back, lines over longer gaps."""
        return self.bridge.across(torque * self.counts)

    @cached_property
    def load_weight(self) -> Array:
        """The same of the load's motion, and 0 while the load itself turns back.

        Dry friction there is whatever it needs to be, later than at the motor by what the springs give way, and the
        slow kernel of the load's encoder spreads the kinks of a load that sticks over its own length.
        """
        weight = self.moving * self.load_valid
        if self.slow_load_speed is not None:
            reach = int(0.5 * self.rate_hz / LOAD_MOTION_CUT_HZ)
            weight *= minimum_filter1d(standstill_weight(self.slow_load_speed, self.standstill), 2 * reach + 1)
        return np.asarray(weight)

    @property
    def samples(self) -> int:
        return int(self.time_s.size)

    @cached_property
    def torque_rms(self) -> float:
        """Effective motor torque, standstill included [N m]."""
        return float(np.sqrt(np.mean(self.torque**2)))

    @property
    def load_stride(self) -> int:
        """Rows per row of what is left at the load."""
        return max(1, int(self.rate_hz / (4.0 * LOAD_CUT_HZ)))

    @cached_property
    def _load_kernel(self) -> Array:
        return gaussian_kernel(min(LOAD_CUT_HZ, 0.1 * self.rate_hz), self.rate_hz, 0)

    def thinned(self, values: Array) -> Array:
        """Every `load_stride`-th row of what a model leaves at the load, shape (n,), below `LOAD_CUT_HZ`.

        Cut off after the model is held against the encoder: what shakes both faster would else be missing in one.
        """
        kernel, stride = self._load_kernel, self.load_stride
        half = kernel.size // 2
        ahead = half + -2 * half % stride
        padded = np.pad(values, (ahead, half), "reflect", reflect_type="odd")
        first = (ahead + half) // stride
        return np.asarray(upfirdn(kernel, padded, 1, stride)[first : first + -(-values.size // stride)])

    def passed_at_load(self, frequency_hz: Array) -> Array:
        """Share of a wave that is left of it by `thinned`, of the shape of `frequency_hz`."""
        rows = np.arange(self._load_kernel.size) - self._load_kernel.size // 2
        return np.asarray(np.cos(2.0 * np.pi / self.rate_hz * np.outer(frequency_hz, rows)) @ self._load_kernel)


@dataclass(frozen=True)
class Bridge:
    """Straight lines over lost rows, from the mean of the `PIER` rows before a gap to that of those behind it.

    Left at zero, the rows would cut slow noise off with edges that are louder than all else.
    """

    lost: NDArray[np.int64]
    gap: NDArray[np.int64]  # to which gap each lost row belongs
    share: Array  # of the way across, at each lost row
    before: Pier
    after: Pier

    @staticmethod
    def over(lost: NDArray[np.bool_]) -> Bridge:
        """`lost`: shape (n,); nothing is bridged where all are."""
        gone, kept = np.flatnonzero(lost), np.flatnonzero(~lost)
        if not kept.size:
            gone = gone[:0]
        behind, gap = np.unique(np.searchsorted(kept, gone), return_inverse=True)
        before, after = Pier.of(kept, behind - PIER, behind), Pier.of(kept, behind, behind + PIER)
        first, last = behind == 0, behind == kept.size  # at the record's ends a line is level
        near, far = kept[np.maximum(behind - 1, 0)][gap], kept[np.minimum(behind, kept.size - 1)][gap]
        share = np.where(first[gap], 1.0, np.where(last[gap], 0.0, (gone - near) / np.maximum(far - near, 1)))
        return Bridge(gone, gap, share, before, after)

    def across(self, values: Array) -> Array:
        """`values`, shape (n,), with lines in place of the lost rows."""
        if not self.lost.size:
            return values
        before, after = self.before.mean(values), self.after.mean(values)
        out = values.copy()
        out[self.lost] = before[self.gap] + self.share * (after - before)[self.gap]
        return out


@dataclass(frozen=True)
class Pier:
    """Up to `PIER` kept rows on one side of each gap, shape (gaps, PIER); `used`: 1 where there is one."""

    rows: NDArray[np.int64]
    used: Array

    @staticmethod
    def of(kept: NDArray[np.int64], first: NDArray[np.int64], last: NDArray[np.int64]) -> Pier:
        """Places `first` to `last` among the `kept` rows, per gap."""
        place = first[:, None] + np.arange(PIER)
        used = (place >= 0) & (place < kept.size) & (place < last[:, None])
        return Pier(kept[np.clip(place, 0, max(kept.size - 1, 0))], used.astype(np.float64))

    def mean(self, values: Array) -> Array:
        """Of `values` over the rows of each gap, 0 where there are none, shape (gaps,)."""
        total = np.einsum("gk,gk->g", values[self.rows], self.used)
        return np.asarray(total / np.maximum(self.used.sum(axis=1), 1.0), dtype=np.float64)


def gaussian_kernel(cut_hz: float, rate_hz: float, derivative: int) -> Array:
    """Flat low-pass (-3 dB at `cut_hz`) or its derivative, to be correlated with; exact on polynomials of order 3.

    A Gaussian times an even polynomial whose second moment is zero: a plain Gaussian would bend a curve inwards by
    half its variance times the curvature, which for a load encoder is as much as the elastic twist itself.
    """
    sigma = max(1.47 / (2.0 * math.pi * cut_hz) * rate_hz, 0.6)
    half = math.ceil(5.5 * sigma)
    k = np.arange(-half, half + 1, dtype=np.float64)
    g = np.exp(-0.5 * (k / sigma) ** 2)
    u = k / sigma
    powers = range(derivative % 2, derivative + 3, 2)
    parts = np.array([g * u**power for power in powers])
    moments = np.array([[(part * u**power).sum() for part in parts] for power in powers])
    wanted = [math.factorial(derivative) if power == derivative else 0.0 for power in powers]
    return np.asarray(np.linalg.solve(moments, wanted) @ parts * (rate_hz / sigma) ** derivative)


def smooth(values: Array, cut_hz: float, rate_hz: float, derivative: int, margin: int) -> Array:
    """Correlate with `gaussian_kernel`; `margin` samples are cut from both ends, shape (n - 2 margin,)."""
    kernel = gaussian_kernel(cut_hz, rate_hz, derivative)
    spare = margin - kernel.size // 2
    base = values[0] if derivative == 0 else 0.0
    inner = fftconvolve(values - values[0], kernel[::-1], "valid") + base
    return inner[spare : inner.size - spare]


def prepare(
    rate_hz: float,
    torque: Array,
    angle: Array,
    load_angle: Array | None,
    valid: Array | None = None,
    load_valid: Array | None = None,
    slow_angle_cut_hz: float = SLOW_ANGLE_CUT_HZ,
    known_torque: Array | None = None,
) -> Measurement:
    """Smooth evenly sampled channels of shape (n,), thin them to about `RATE_HZ`; `valid` is 1 where a row counts."""
    stride = max(1, round(rate_hz / RATE_HZ))
    rate = rate_hz / stride
    wide, cut = WIDE_SHARE * rate, min(ANGLE_CUT_HZ, 0.2 * rate)
    slow_cut = min(cut, slow_angle_cut_hz)
    slow = min(MOTION_CUT_HZ, 0.1 * rate)
    load_slow = min(LOAD_MOTION_CUT_HZ, 0.05 * rate)
    margin = max(gaussian_kernel(c, rate_hz, 0).size // 2 for c in (wide, cut, slow_cut, slow, load_slow))

    def channel(values: Array | None, cut_hz: float, derivative: int) -> Array:
        return smooth(np.zeros(0) if values is None else values, cut_hz, rate_hz, derivative, margin)[::stride].copy()

    def load(cut_hz: float, derivative: int) -> Array | None:
        return None if load_angle is None else channel(load_angle, cut_hz, derivative)

    speed = channel(angle, cut, 1)
    trusted, load_trusted = np.ones(speed.size), np.ones(speed.size)
    least = gaussian_kernel(ANGLE_CUT_HZ, rate_hz, 0).size // 2
    if valid is not None:
        trusted *= _trusted(valid, margin, least)[::stride]
    if load_valid is not None:
        load_trusted *= _trusted(load_valid, margin, least)[::stride]
    settle = int(0.06 * rate)
    trusted[:settle] = 0.0
    load_trusted[:settle] = 0.0
    return Measurement(
        rate_hz=rate,
        time_s=(margin + stride * np.arange(speed.size)) / rate_hz,
        torque=channel(torque, wide, 0),
        acceleration=channel(angle, wide, 2),
        slow_acceleration=channel(angle, slow, 2),
        angle=channel(angle, cut, 0),
        speed=speed,
        slow_angle=channel(angle, slow_cut, 0),
        slow_speed=channel(angle, slow_cut, 1),
        load_angle=load(cut, 0),
        load_speed=load(cut, 1),
        slow_load_angle=load(load_slow, 0),
        slow_load_speed=load(load_slow, 1),
        valid=trusted,
        load_valid=load_trusted,
        known_torque=None if known_torque is None else channel(known_torque, wide, 0),
    )


def _resting(still: NDArray[np.bool_], angle: Array, rate_hz: float) -> NDArray[np.bool_]:
    """Rows of rests, and after each until friction slides whatever it held there, which no motion tells; shape (n,)."""
    long = np.ones(1 + int(REST_S * rate_hz), dtype=np.bool_)
    rested = binary_opening(still, long)
    last = np.maximum.accumulate(np.where(rested, np.arange(rested.size), -1))
    gone = np.cumsum(np.abs(np.diff(angle, prepend=angle[0])))
    return np.asarray((last >= 0) & (gone - gone[last] < SLIPPED_RAD))


def standstill_weight(speed: Array, share: float) -> Array:
    """0 at standstill, 1 in motion, a smooth step from `share` of the largest speed to three times that."""
    limit = share * float(np.abs(speed).max())
    u = np.clip((np.abs(speed) / max(limit, 1e-300) - 1.0) / 2.0, 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u)


def _trusted(valid: Array, margin: int, least: int) -> Array:
    """1 where what stands in place of lost rows is not felt, shape (n - 2 margin,); a long gap is felt further off.

    `margin`: reach of the slowest kernel, in rows; `least`: of a kernel that a gap of a few rows still disturbs.
    """
    lost = np.diff(np.concatenate([[0], (valid < 0.5).astype(np.int64), [0]]))
    out = np.ones(valid.size)
    for first, end in zip(np.flatnonzero(lost > 0), np.flatnonzero(lost < 0), strict=True):
        reach = min(margin, least + REACH * int(end - first))
        out[max(first - reach, 0) : end + reach] = 0.0
    return out[margin : valid.size - margin]


def one_body(
    torque: Array,
    acceleration: Array,
    speed: Array,
    used: NDArray[np.bool_] | slice = slice(None),
    beside: Sequence[Array] = (),
) -> tuple[Array, Array]:
    """Inertia, dry and viscous friction and offset by least squares over `used`, shape (4 + k,), and the torque beyond.

    [kg m2], [N m], [N m s/rad], [N m]; the torque that one body does not need is of all rows [N m], shape (n,).
    `beside`: k other laws of the torque, each of shape (n,).
    """
    columns = np.stack([acceleration, np.sign(speed), speed, np.ones(speed.size), *beside], 1)
    scale = np.abs(columns).max(axis=0) + 1e-300
    found = np.linalg.lstsq(columns[used] / scale, torque[used], rcond=None)[0] / scale
    return found, torque - columns @ found


KICK = 0.01  # of a step, by which all numbers are moved to see where
MOST_BENT = 0.01  # noise deviations by which twice the kick may do other than twice as much: a step, one
LEAST_BENT = 0.002  # the same where such a spell begins and ends
FELT_S = 0.05  # on either side of a row, over which that is asked
FEWEST_PREDICTABLE = 1.0 / 3.0  # of all rows; fewer say less than what is rough


def linear_rows(kicked: Sequence[Array], rate_hz: float) -> Array:
    """1 where twice the kick does twice as much, else 0, shape (n,); all 1 where hardly any row would be left.

    `kicked`: whitened residuals (n,) without a kick, with one and with two.
    """
    bent = kicked[0] - 2.0 * kicked[1] + kicked[2]
    rough = uniform_filter1d(bent**2, 2 * int(FELT_S * rate_hz) + 1)
    spells, count = label(rough > LEAST_BENT**2)
    worst = maximum(rough, spells, np.arange(count + 1))
    smooth = (spells == 0) | (worst[spells] < MOST_BENT**2)
    return np.asarray(smooth, dtype=np.float64) if smooth.mean() > FEWEST_PREDICTABLE else np.ones(smooth.size)
