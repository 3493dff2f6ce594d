"""Predict what the motor torque of a chain must have been while motor and load moved as measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from threading import Lock

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from sim.chain.integrate import steady_start
from sim.chain.model import Array, Chain
from sim.investigation.data.excitation import beyond_twice
from sim.investigation.data.preprocessing import LOAD_MOTION_CUT_HZ, Measurement
from sim.investigation.model.observer_kernel import loudness, motor_torque, run, shaken
from sim.investigation.model.packing import Packed, lag_of, pack, substeps
from sim.laws import INV, VISCOUS_F, C, D, J

Spectrum = NDArray[np.complex128]
GUIDE_RAD_S = 2.0 * np.pi * 25.0  # bandwidth of the guide: above the drive train's modes that matter
GUIDE = np.array([GUIDE_RAD_S**2, 1.4 * GUIDE_RAD_S])  # its stiffness and damping per inertia
NO_STRETCH_RAD = 1e-9
SHAKEN_HZ = 350.0  # above this little is kept of any motion
TONES = 2.0 * np.pi * np.linspace(1.0, LOAD_MOTION_CUT_HZ, 12)  # [rad/s] at which noise is compared

RECENT = 8  # changes of the motor shaft alone need no new run of the rest, nor those of the rest one of the motor's


@dataclass(frozen=True)
class Nuisance:
    """What belongs to the measurement and not to the axis.

    `torque_delay_s`: the torque channel is late by this; `load_delay_s` the load encoder; `load_error_rad` sine and
    cosine amplitude of the encoder's error once per revolution, then twice; `load_curve_rad`: the same of the series
    `beyond_twice`, empty where there is none; `loss_split`: share of mesh losses behind
    the spring, while the motor drives and while the load does;
    `friction_width`, `loss_width`: speed over which friction and losses turn their sign, of the largest;
    `stretch_rad`: by which a contact gives way before friction slides;
    `start`: angle [rad] and speed [rad/s] by which a load without encoder is ahead of where the motor takes it.
    """

    torque_delay_s: float = 0.0
    load_delay_s: float = 0.0
    load_error_rad: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    load_curve_rad: tuple[float, ...] = ()
    load_offset_rad: float = 0.0
    loss_split: tuple[float, float] = (0.5, 0.5)
    friction_width: tuple[float, float] = (1e-3, 1e-3)  # of the largest speed: motor, load
    loss_width: float = 1e-3
    stretch_rad: tuple[float, float] = (NO_STRETCH_RAD, NO_STRETCH_RAD)  # motor, load
    start: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Prediction:
    """Motor torque [N m] and the guide's torque on the load [N m] (what the model lacks there), shape (n,)."""

    torque: Array
    guide: Array
    load_angle: Array


@dataclass
class Observer:
    """Runs chains along one measurement; `guide_inertia` fixes the guide's stiffness for all of them.

    `noise_inertia` multiplies the fast part of the measured acceleration, which is the encoder's noise: were it the
    fitted inertia, a fit would make the noise small by making the inertia small. `has_contact_loss`: teeth leave each
    other and meet again, so that what is fast in the motion of motor and load is no longer noise alone: it drives the
    chain, but what springs in contact make of it stays what it was for the chain of which the noise was learned.
    """

    measurement: Measurement
    guide_inertia: float
    noise_inertia: float
    has_contact_loss: bool = False
    _noise: tuple[Array, Array] | None = None  # of the motor's torque and the guide's
    _loudness: float = 0.0
    _lock: Lock = field(default_factory=Lock)
    _recent: dict[bytes, Array] = field(default_factory=dict)
    _shifted: dict[bool, tuple[float, Array]] = field(default_factory=dict)  # the load's motion as asked for last
    _told: dict[bool, tuple[tuple[float, ...], Array]] = field(default_factory=dict)  # and what its encoder says

    @cached_property
    def _motion(self) -> Array:
        return np.stack([self.measurement.angle, self.measurement.speed])

    @cached_property
    def _slow_motion(self) -> Array:
        return np.stack([self.measurement.slow_angle, self.measurement.slow_speed])

    @cached_property
    def _top(self) -> float:
        return float(np.abs(self.measurement.speed).max())

    @cached_property
    def _fast(self) -> Array:
        return self.measurement.acceleration - self.measurement.slow_acceleration

    @cached_property
    def _turns(self) -> tuple[Array, Array]:
        """Waves of the load encoder's error once and twice per revolution, and their slopes [1], shape (4, n)."""
        angle = self.measurement.slow_load_angle
        assert angle is not None
        once, twice = (np.stack([np.sin(k * angle), np.cos(k * angle)]) for k in (1, 2))
        slopes = np.concatenate([once[::-1] * [[1.0], [-1.0]], 2.0 * twice[::-1] * [[1.0], [-1.0]]])
        return np.concatenate([once, twice]), slopes

    @cached_property
    def _series(self) -> tuple[Array, Array]:
        """The same of a curve over the load's angle, shape (k, n)."""
        angle = self.measurement.slow_load_angle
        assert angle is not None
        return beyond_twice(angle)

    def predict(self, chain: Chain, nuisance: Nuisance) -> Prediction:
        """Simulate `chain` along the measured motion."""
        m = self.measurement
        model, motion = pack(chain, float(m.time_s[0])), self._motion if self.has_contact_loss else self._slow_motion
        motor = self._motor(model, motion, nuisance) + chain.shafts[0].inertia_kg_m2 * m.slow_acceleration
        guide, angle = np.zeros(m.samples), motion[0]
        if not chain.links and m.known_torque is not None:
            motor += m.known_torque
        if chain.links:
            out = self._links(chain, model, nuisance, slow=not self.has_contact_loss)
            fast = self._shaken(model, nuisance) if self.has_contact_loss else np.zeros((2, 1))
            motor += out[0] - fast[0]
            guide, angle = (out[2] - fast[1]) * self._even(model), out[1]
        if nuisance.torque_delay_s:
            motor = delayed(motor, nuisance.torque_delay_s * m.rate_hz)
        # noise is added as it is: a fit would choose whatever smooths it
        if self._noise is None:
            motor += self.noise_inertia * self._fast
        else:
            motor += self._noise[0]
            guide += self._noise[1]
        return Prediction(motor, guide, angle)

    def _motor(self, model: Packed, motion: Array, nuisance: Nuisance) -> Array:
        """Torque of what acts on the motor's own shaft, without its inertia."""
        width, stretch = nuisance.friction_width[0] * self._top, nuisance.stretch_rad[0]
        setting = np.array([width, stretch, self.has_contact_loss])
        key = b"motor".join(part.tobytes() for part in (setting, model[0][0, 1:], model[-1]))

        def simulated() -> Array:
            out = np.empty(self.measurement.samples)
            motor_torque(model[0], model[-1], motion, width, stretch, 1.0 / self.measurement.rate_hz, out)
            return out

        return self._kept(key, simulated)

    def _kept(self, key: bytes, simulated: Callable[[], Array]) -> Array:
        """What was simulated with the same numbers a moment ago, else `simulated`; what is asked for again stays."""
        with self._lock:
            out = self._recent.pop(key, None)
            if out is not None:
                self._recent[key] = out
                return out
        out = simulated()
        with self._lock:
            self._recent[key] = out
            if len(self._recent) > RECENT:
                del self._recent[next(iter(self._recent))]
        return out

    def _even(self, model: Packed) -> float:
        """Factor that makes noise equally loud in the guide's torque for every chain.

        The Jacobian of the data's likelihood: a load and springs of half the size make half of any disturbance, and a
        fit would make them light. What is fast of the noise is fixed by `learn_noise` and needs no factor.
        """
        own = float(loudness(*model[:2], self.guide_inertia * GUIDE, TONES))
        if self._loudness == 0.0:
            self._loudness = own
        return self._loudness / own

    def learn_noise(self, chain: Chain, nuisance: Nuisance, *, has_contact_loss: bool = False) -> None:
        """Keep what the fast part of both encoders' signals, which is noise, makes of this chain."""
        self.has_contact_loss = has_contact_loss
        self.noise_inertia = chain.shafts[0].inertia_kg_m2
        self._noise = None
        if chain.links:
            model = pack(chain)
            if has_contact_loss:
                torque, guide = self._shaken(model, nuisance)
            else:
                left = self._links(chain, model, nuisance, slow=False) - self._links(chain, model, nuisance, slow=True)
                torque, guide = left[0], left[2]
            self._noise = self.noise_inertia * self._fast + torque, guide

    @cached_property
    def _shakes(self) -> tuple[Array, Spectrum]:
        """Places on the imaginary axis [rad/s] up to where much is kept of motion, and what is fast of both there."""
        m, size = self.measurement, self._shaken_size
        turns = np.asarray(2.0 * np.pi * np.fft.rfftfreq(size, 1.0 / m.rate_hz), dtype=np.float64)
        turns = turns[turns < 2.0 * np.pi * SHAKEN_HZ]
        load = np.zeros(m.samples)
        if m.load_angle is not None and m.slow_load_angle is not None:
            load = m.load_angle - m.slow_load_angle
        return turns, rfft(np.stack([m.angle - m.slow_angle, load]), size)[:, : turns.size]

    @property
    def _shaken_size(self) -> int:
        """Rows of a transform that holds the measurement and factors well: a prime number of them takes ten times as
        long."""
        return int(next_fast_len(self.measurement.samples, real=True))

    def _shaken(self, model: Packed, nuisance: Nuisance) -> Array:
        """Torque of motor and guide that springs in contact make of what is fast of the motion [N m], shape (2, n)."""
        turns, both = self._shakes
        shafts, links = model[:2]
        key = np.array([*shafts[1:, [J, VISCOUS_F]].flat, *links[:, [INV, C, D]].flat, nuisance.load_delay_s]).tobytes()

        def answered() -> Array:
            answer = np.empty_like(both)
            shaken(shafts, links, self._gains, turns, nuisance.load_delay_s, *both, answer)
            return irfft(answer, self._shaken_size)[:, : self.measurement.samples]

        return self._kept(b"shaken" + key, answered)

    @property
    def _gains(self) -> Array:
        """Stiffness and damping of the guide, 0 without a load encoder."""
        seen = self.measurement.load_angle is not None
        return float(seen) * self.guide_inertia * GUIDE

    def _links(self, chain: Chain, model: Packed, nuisance: Nuisance, *, slow: bool) -> Array:
        """`slow`: whether the slow part of the motion alone is meant."""
        m = self.measurement
        motion = self._slow_motion if slow else self._motion
        n = len(chain.shafts)
        gains = self._gains
        guide = np.zeros((2, 1)) if m.load_angle is None else self._guide(nuisance, slow)
        ratios = np.cumprod([1.0, *(link.ratio for link in chain.links)])
        widths = np.array([[nuisance.loss_width], [nuisance.friction_width[1]]]) * self._top / ratios
        stretch = nuisance.stretch_rad[1]
        known = np.zeros(0) if m.known_torque is None else m.known_torque
        asked = float(known[0]) if known.size else 0.0
        state = steady_start(chain, float(motion[0, 0]), float(motion[1, 0]), float(m.slow_acceleration[0]), asked)
        angles, speeds = state[1:n], state[n + 1 :]
        if gains[0] > 0.0:
            angles[-1], speeds[-1] = guide[0, 0], guide[1, 0]
        else:
            angles, speeds = (x + s * lag_of(chain) for x, s in zip((angles, speeds), nuisance.start, strict=True))
        start = np.concatenate([angles, speeds, np.zeros(n - 1)])
        steps = substeps(chain, m.rate_hz, gains)
        setting = np.array([*nuisance.loss_split, stretch, steps, slow])
        inner = (
            model[0][1:],
            *model[1:],
            gains,
            widths,
            setting,
            start,
            np.array([*nuisance.load_error_rad, *nuisance.load_curve_rad]),
            guide[:, :1],
        )
        key = b"".join(part.tobytes() for part in inner) + repr(nuisance.load_delay_s).encode()

        def simulated() -> Array:
            out = np.zeros((3, m.samples))
            stages = (0.0,) * len(chain.links)
            step = 1.0 / m.rate_hz
            run(
                *model,
                motion,
                guide,
                known,
                gains,
                widths,
                stretch,
                nuisance.loss_split,
                step,
                steps,
                start,
                out,
                stages,
            )
            return out

        return self._kept(key, simulated)

    def _guide(self, nuisance: Nuisance, slow: bool) -> Array:
        """Angle and speed of the load as its encoder tells them, without that encoder's own errors, shape (2, n)."""
        m, last = self.measurement, self._told.get(slow)
        late_s, offset, parts = nuisance.load_delay_s, nuisance.load_offset_rad, np.array(nuisance.load_error_rad)
        asked = (late_s, offset, *nuisance.load_error_rad, *nuisance.load_curve_rad)
        if last is None or last[0] != asked:
            waves, slopes = self._turns
            speed = m.slow_load_speed if slow else m.load_speed
            assert speed is not None
            error = np.stack([parts @ waves + offset, (parts @ slopes) * speed])
            if any(nuisance.load_curve_rad):
                curve = np.array(nuisance.load_curve_rad)
                error += np.stack([curve @ self._series[0], (curve @ self._series[1]) * speed])
            last = self._told[slow] = (asked, self._load_motion(late_s, slow) - error)
        return last[1]

    def _load_motion(self, late_s: float, slow: bool) -> Array:
        """Angle and speed of the load that its encoder tells `late_s` later, shape (2, n); the delay seldom changes."""
        m, last = self.measurement, self._shifted.get(slow)
        if last is None or last[0] != late_s:
            told = (m.slow_load_angle, m.slow_load_speed) if slow else (m.load_angle, m.load_speed)
            moved = np.stack([delayed(channel, -late_s * m.rate_hz) for channel in told if channel is not None])
            last = self._shifted[slow] = (late_s, moved)
        return last[1]


def delayed(values: Array, samples: float) -> Array:
    """Shift by a part of a sample or more: the cubic through four neighbours (Lagrange), smooth in `samples`."""
    whole = math.floor(samples)
    u = 1.0 - (samples - whole)  # place between the second and the third neighbour
    weights = (
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0,
        -(u + 1.0) * u * (u - 2.0) / 2.0,
        (u + 1.0) * u * (u - 1.0) / 6.0,
    )
    before, after = max(0, whole + 2), max(0, 1 - whole)
    padded = np.pad(values, (before, after), "reflect", reflect_type="odd")
    first = before - whole - 2
    return np.convolve(padded[first : first + values.size + 3], weights[::-1], "valid")
