"""What a microphone on or near the gear hears: forces in the meshes and rubbing, through the housing's modes.

    y = gain (h * (w_1 F_1 + w_2 F_2 + ... + rubbing |speed|^p white noise) + ambient)
    H(s) = sum of A_n (s / omega_n) / (1 + 2 zeta_n s / omega_n + s^2 / omega_n^2)

F_k is the torque of mesh k, felt at the output. H is a mobility: each mode of the housing answers a force by a
velocity of its surface, and the pressure of the sound follows that velocity (Fahy and Gardonio, Sound and Structural
Vibration, chapter 3). Modes in phase have an antiresonance between them. Ambient noise has a spectral density of
frequency^-slope.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from sim.errors import ParameterError

Array = NDArray[np.float64]
SAMPLE_RATE_HZ = 8000.0  # the paper's
AT_ONCE = 8192  # frequencies whose arrays stay in the processor's cache
LOWEST_NOISE_HZ = 5.0  # below, ambient noise no longer rises


@dataclass(frozen=True)
class Mode:
    """One resonance of the housing as the microphone hears it."""

    frequency_hz: float
    damping_ratio: float
    amplitude: float

    def __post_init__(self) -> None:
        if not (self.frequency_hz > 0 and 0 < self.damping_ratio < 1 and math.isfinite(self.amplitude)):
            raise ParameterError(
                f"mode: needs a frequency > 0 Hz, a damping ratio between 0 and 1 and a finite amplitude, got {self}"
            )


@dataclass(frozen=True)
class Microphone:
    """The path from the gear to the recording.

    Parameters
    ----------
    modes
        Resonances of the housing; without any the force itself is heard.
    gain
        Full scale per N m at the output that excites a mode of amplitude 1 and damping ratio 0.5 at its resonance.
    lowest_hz
        Below it nothing is heard [Hz], fourth order: two for a housing that is small against the wavelength, two for
        the microphone. What an arm swings with is felt, not heard.
    mesh_weights
        How loud each mesh is, motor side first; one value stands for all.
    rubbing_n_m, rubbing_exponent
        Broadband force of sliding teeth and rolling bearings, RMS at full speed [N m at the output], and with which
        power of the speed it rises.
    ambient_n_m, ambient_slope
        Everything that is heard at standstill, RMS in the same unit after the path; spectral density ~ f^-slope.
    """

    modes: tuple[Mode, ...] = ()
    gain: float = 1.0
    lowest_hz: float = 30.0
    mesh_weights: tuple[float, ...] = (1.0,)
    rubbing_n_m: float = 0.0
    rubbing_exponent: float = 1.0
    ambient_n_m: float = 0.0
    ambient_slope: float = 1.0

    def __post_init__(self) -> None:
        for name in ("rubbing_n_m", "ambient_n_m", "gain", "lowest_hz"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise ParameterError(f"microphone.{name}: must be >= 0, got {value}")

    def path(self, frequency_hz: Array) -> NDArray[np.complex128]:
        """H and the microphone's high-pass at the given frequencies [Hz], shape (n,).

        >>> heard = Microphone(modes=(Mode(100.0, 0.05, 2.0),)).path(np.array([0.0, 100.0, 1e6]))
        >>> [round(float(abs(value)), 2) for value in heard]
        [0.0, 19.84, 0.0]
        """
        ratio = frequency_hz / self.lowest_hz
        square = ratio * ratio
        weight = square / (1 + square * square)
        high_pass = weight * (square - 1) + 1j * (weight * (math.sqrt(2) * ratio))
        high_pass *= high_pass
        if not self.modes:
            return np.asarray(high_pass)
        real, imaginary = np.zeros((2, len(frequency_hz)))
        for mode in self.modes:
            s = frequency_hz / mode.frequency_hz
            rest, loss = 1 - s * s, 2 * mode.damping_ratio * s
            s *= mode.amplitude / (rest * rest + loss * loss)
            real += s * loss
            imaginary += s * rest
        return np.asarray((real + 1j * imaginary) * high_pass)


def microphone_of(document: Mapping[str, Any]) -> Microphone:
    """Read a microphone back from what `dataclasses.asdict` made of it (JSON)."""
    modes = tuple(Mode(**mode) for mode in document["modes"])
    return Microphone(**{**document, "modes": modes, "mesh_weights": tuple(document["mesh_weights"])})


def hear(
    mesh_torque_n_m: Array,
    speed_rad_s: Array,
    sample_rate_hz: float,
    microphone: Microphone,
    seed: int,
) -> NDArray[np.float32]:
    """The recording of a run.

    Parameters
    ----------
    mesh_torque_n_m
        Torque of every mesh felt at the output [N m], shape (n, meshes).
    speed_rad_s
        Speed of the output [rad/s], shape (n,).
    seed
        Of rubbing and ambient noise: the same seed gives the same samples.

    Returns
    -------
    Samples at the same rate, shape (n,); neither clipped nor rounded.
    """
    n, meshes = mesh_torque_n_m.shape
    random = np.random.default_rng(seed)
    weights = np.broadcast_to(np.asarray(microphone.mesh_weights, dtype=np.float64), (meshes,))
    force = mesh_torque_n_m @ weights
    force -= force.mean()
    rubbing = np.abs(speed_rad_s)
    top = float(rubbing.max(initial=0.0))
    if top > 0:  # in place: another array of a long run takes longer than the numbers in it
        rubbing /= top
        rubbing **= microphone.rubbing_exponent
        rubbing *= microphone.rubbing_n_m
        rubbing *= random.standard_normal(n, dtype=np.float32)
        force += rubbing
    size = fft.next_fast_len(n + int(sample_rate_hz / 2), real=True)
    path, noise = _path_and_noise(replace(microphone, gain=1.0), size, sample_rate_hz)
    spectrum = fft.rfft(force.astype(np.float32), size)
    spectrum *= path
    ambient = random.standard_normal(2 * len(noise), dtype=np.float32).view(np.complex64)
    ambient *= noise
    spectrum += ambient
    spectrum *= np.float32(microphone.gain)
    return np.asarray(fft.irfft(spectrum, size)[:n], dtype=np.float32)


@lru_cache(maxsize=4)
def _path_and_noise(
    microphone: Microphone, size: int, sample_rate_hz: float
) -> tuple[NDArray[np.complex64], NDArray[np.float32]]:
    """H and the spread of each part of the ambient noise's spectrum, shape (size // 2 + 1,); kept for runs alike."""
    frequency = fft.rfftfreq(size, 1 / sample_rate_hz)
    shape = np.maximum(frequency, LOWEST_NOISE_HZ) ** (-0.5 * microphone.ambient_slope)
    shape *= microphone.ambient_n_m * math.sqrt(0.5 * size / float(np.mean(shape**2)))
    parts = np.array_split(frequency, 1 + len(frequency) // AT_ONCE)
    path = np.concatenate([microphone.path(part).astype(np.complex64) for part in parts])
    noise = shape.astype(np.float32)
    path.flags.writeable = noise.flags.writeable = False
    return path, noise
