"""How loud the load encoder's noise is in the guide's torque, for parts of the load that make more or less of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import freqz

from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.data.preprocessing import LOAD_CUT_HZ, Measurement
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.effects import Response
from sim.investigation.model.nominal import locked_mode_hz
from sim.investigation.model.observer import GUIDE
from sim.investigation.model.parameters import Values

PLACES = 400
DAMPED = 0.03  # damping ratio of the load on its springs, which are little damped
ENCODER_ONLY = 1.25 * LOAD_CUT_HZ  # around it all noise at the load is its encoder's
QUIETEST = 1e-3


@dataclass(frozen=True)
class LoadNoise:
    """The encoder's share of the noise at the load, for what swings there.

    Shape (k,): `s` places on the imaginary axis [rad/s], `plain` what the guide needs per angle and inertia of the load
    [1/s^2], `power` the whitened noise that the encoder makes per square of it.
    """

    s: Response
    plain: Response
    power: Array

    @staticmethod
    def under(axis: Axis, m: Measurement, taps: Array) -> LoadNoise:
        """`taps` make the guide's noise white; what is loudest around `ENCODER_ONLY` is flat in the angle."""
        rate_hz = m.rate_hz / m.load_stride
        places_hz = np.linspace(0.5, 0.5 * rate_hz - 0.5, PLACES)
        s = np.asarray(2j * math.pi * places_hz, dtype=np.complex128)
        mode = 2.0 * math.pi * locked_mode_hz(axis)
        stiffness, damping = GUIDE
        guided = (stiffness + damping * s) / (s * s + damping * s + stiffness)
        plain = guided * (s * s + 2.0 * DAMPED * mode * s + mode * mode)
        passed = np.abs(freqz(taps, 1.0, 2.0 * math.pi * places_hz / rate_hz)[1] * m.passed_at_load(places_hz)) ** 2
        made = passed * np.abs(plain) ** 2
        loud = (places_hz > 0.85 * ENCODER_ONLY) & (places_hz < 1.15 * ENCODER_ONLY)
        flat = 1.0 / max(float(np.median(made[loud])) if loud.any() else 0.0, 1e-300)
        # it makes no more than all noise that there is
        return LoadNoise(s, plain, passed * np.minimum(flat, 1.0 / np.maximum(made, 1e-300)))

    def factor(self, terms: Sequence[Term], values: Values) -> float:
        """What, at least 1, keeps noise as loud as it was, with what `terms` need beyond `plain`.

        The Jacobian of the data's likelihood, as of the chain's own: a part on a spring takes its mass from what
        follows the encoder, and a fit would let parts swing only to make its noise small. Louder noise costs by itself.
        """
        responses = [term.response(self.s, values) for term in terms if term.response is not None]
        if not responses:
            return 1.0
        response = np.sum(responses, axis=0)
        more = self.power * (np.abs(self.plain + response) ** 2 - np.abs(self.plain) ** 2)
        return math.exp(-0.5 * min(float(np.mean(np.log(np.maximum(1.0 + more, QUIETEST)))), 0.0))
