"""Faults of sensors and recorders."""

from __future__ import annotations

import numpy as np

from benchmarks.hidden_effects.generator.effect import AS_NEW, Draw, Effect


def torque_offset(draw: Draw) -> Effect:
    sign = float(draw.rng.choice([-1, 1]))
    return Effect(
        "torque_offset", None, guess=1.0, where="torque offset", size=lambda a: {"torque_n_m": sign * a}, detail=(sign,)
    )


def electrical_hum(draw: Draw) -> Effect:
    frequency = float(draw.rng.choice([50.0, 60.0])) + float(draw.rng.normal(0, 0.02))
    where = f"{draw.recording()} hum"
    return Effect(
        "electrical_hum", None, guess=1.0, where=where, size=lambda a: {"frequency_hz": frequency}, detail=(frequency,)
    )


def encoder_error(draw: Draw) -> Effect:
    phase = float(draw.rng.uniform(0, 2 * np.pi))
    floor = AS_NEW * draw.joint.encoder_error
    return Effect("encoder_error", None, guess=floor, floor=floor, where="load encoder", detail=(phase,))


def time_delay(draw: Draw) -> Effect:
    which = float(draw.load_encoder and draw.rng.random() < 0.5)
    return Effect("time_delay", None, guess=3e-3, floor=3e-3, cap=6e-3, where="delay", detail=(which,))


def clipping(draw: Draw) -> Effect:
    where = f"{draw.recording()} clipped"
    return Effect("clipping", None, guess=0.02, floor=0.02, cap=0.06, where=where)


def lost_samples(draw: Draw) -> Effect:
    which = float(draw.rng.random() < 0.5)
    return Effect("lost_samples", None, guess=0.02, floor=0.02, cap=0.06, where="lost", detail=(which,))
