"""Hypotheses about sensors and their wires: offset, delay, hum, errors of an encoder."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sim.description.axis import Axis
from sim.investigation.data.preprocessing import Array, Measurement
from sim.investigation.hypotheses.harmonics import (
    AS_NEW_FACTOR,
    ENCODER_ERROR,
    amplitude,
    cosine_and_sine,
    cosine_and_sine_probe,
    parameter_key,
)
from sim.investigation.hypotheses.hypothesis import Term
from sim.investigation.model.parameters import Owner, Parameter, Values
from sim.mechanisms import ElectricalHum, EncoderError, TimeDelay, TorqueGain, TorqueOffset

HUM_HZ = (50.0, 60.0, 100.0, 120.0)
HIGHEST_HUM = 0.4  # of the sample rate
LATEST_S = 0.02  # what wants to be later is no delay
EDGE_S = 0.1  # over which a factor changes
HUM_SHARE = 0.003  # of the torque: less hum does not matter


def offset(level: float, peak: float = math.inf) -> Term:
    """Of the torque channel; `level`: rms of the torque, `peak`: the largest of it [N m].

    What wants to be larger than all that was measured is no offset: it stands against something else.
    """
    name, step = "offset_n_m", 0.01 * level
    return Term(
        TorqueOffset.name, "motor", (Parameter(name, 0.0, step, low=-peak, high=peak, unit="N m"),), (({name: step},),),
        lambda v: {"torque_n_m": v[name]}, replaces=(name,), size=0.5 * step,
        magnitude=lambda v: v[name] if abs(v[name]) < 0.99 * peak else 0.0,
    )  # fmt: skip


def delay(name: str, location: str, size: float) -> Term:
    parameters = (Parameter(name, 0.0, 0.2 * size, low=-LATEST_S, high=LATEST_S, unit="s"),)
    return Term(
        TimeDelay.name, location, parameters, (({name: size},), ({name: -size},)), lambda v: {"delay_s": v[name]},
        replaces=(name,), size=size, magnitude=lambda v: v[name] if abs(v[name]) < 0.99 * LATEST_S else 0.0,
    )  # fmt: skip


def gain(level: float, duration_s: float, start_s: float, end_s: float, among: int) -> Term:
    """The torque channel read by another factor between two times, which a fit may move.

    `level`: usual share [1]; `among`: windows of which this one was picked. The factor turns over `EDGE_S`, so that
    what is left has a slope over either time.
    """
    share, start, end = (parameter_key(TorqueGain.name, "motor", p.name) for p in TorqueGain.parameters)

    def torque(m: Measurement, values: Values) -> Array:
        since, until = ((m.time_s - values[name]) / EDGE_S for name in (start, end))
        factor = values[share] * 0.5 * (np.tanh(since) - np.tanh(until))
        return np.asarray(m.torque * factor / (1.0 + factor))

    numbers = TorqueGain.parameters[0]
    parameters = (
        Parameter(share, 0.0, 0.1 * level, low=numbers.low, high=numbers.high),
        Parameter(start, start_s, 0.5 * EDGE_S, low=0.0, high=duration_s, unit="s"),
        Parameter(end, end_s, 0.5 * EDGE_S, low=0.0, high=duration_s, unit="s"),
    )
    return Term(
        TorqueGain.name, "motor", parameters, (({share: level},),),
        lambda v: {"share": v[share], "start_s": v[start], "end_s": v[end]},
        torque=torque, shape=(start, end), size=0.5 * level, among=among,
        magnitude=lambda v: v[share] if abs(v[share]) < 0.99 * numbers.high else 0.0,
    )  # fmt: skip


def hum(frequency: float, level: float) -> Term:
    """Hum of the mains in the torque channel at a frequency [Hz]; `level`: rms of the torque [N m], for its step."""
    prefix = f"{ElectricalHum.name}{frequency:g}@motor"
    step = 0.01 * level

    def torque(m: Measurement, values: Values) -> Array:
        turn = 2.0 * np.pi * frequency * m.time_s
        return values[f"{prefix}.sine"] * np.sin(turn) + values[f"{prefix}.cosine"] * np.cos(turn)

    def report(values: Values) -> dict[str, float]:
        sine, cosine = values[f"{prefix}.sine"], values[f"{prefix}.cosine"]
        return {
            "torque_n_m": math.hypot(sine, cosine),
            "frequency_hz": frequency,
            "phase_rad": math.atan2(cosine, sine),
        }

    waves = tuple(replace(p, owner=Owner.MOTION) for p in cosine_and_sine(prefix, step, "N m"))
    return Term(
        ElectricalHum.name, "motor", waves, cosine_and_sine_probe(prefix, step), report,
        torque=torque, size=HUM_SHARE * level, frequency_hz=frequency,
    )  # fmt: skip


def encoder_error(axis: Axis) -> Term:
    names = ENCODER_ERROR
    step = max(axis.load_encoder.error_rad, 1e-5)
    parameters = tuple(Parameter(name, 0.0, step, unit="rad") for name in names)
    probes = (tuple({name: 2.0 * AS_NEW_FACTOR * step} for name in names),)
    report = amplitude(parameters, "amplitude_rad", "phase_rad")
    return Term(EncoderError.name, "load", parameters, probes, report, replaces=names, size=AS_NEW_FACTOR * step)
