"""What the data sheet of an axis type would say of it: a description as users write it, without anything measured."""

from __future__ import annotations

import math
from fractions import Fraction

from .axes import DESIGNS, MESH
from .kinds import Half


def data_sheet(half: Half, axis: str) -> dict[str, object]:
    """Description of an axis type [SI units], for `sim.description.axis_document.read_axis`."""
    design = DESIGNS[half][axis]
    motor, gear, arm = design.inertias
    payload, acceleration = sum(design.payload) / 2, sum(design.accel) / 2
    nominal = (arm + payload) * acceleration
    wind_up = nominal / design.k_out
    speed = sum(design.speed) / 2
    errors = [MESH * share * wind_up for share in design.mesh]
    teeth = Fraction(design.mid_turns).limit_denominator(20)
    times = max(1, round(design.z_out / teeth.numerator))
    output = {
        "name": "output",
        "driver_teeth": times * teeth.denominator,
        "driven_teeth": times * teeth.numerator,
        "stiffness_n_m_per_rad": design.k_out,
        "damping_n_m_s_per_rad": 2 * 0.045 * math.sqrt(design.k_out * gear),
        "backlash_rad": 0.3 * wind_up,
        "transmission_error_rad": errors[2],
    }
    stages = [output]
    if design.ratio > design.mid_turns:
        turns = design.mid_turns
        first = {
            "name": "input",
            "ratio": design.ratio / turns,
            "inertia_kg_m2": gear / turns**2,
            "stiffness_n_m_per_rad": design.k_in / turns**2,
            "damping_n_m_s_per_rad": 2 * 0.035 * math.sqrt(design.k_in * gear) / turns**2,
            "transmission_error_rad": errors[0] * turns,
        }
        stages.insert(0, first)
    else:
        output["stiffness_n_m_per_rad"] = 1 / (1 / design.k_in + 1 / design.k_out)
    return {
        "schema": "gearcase-axis/1",
        "name": axis,
        "motor": {
            "inertia_kg_m2": motor / design.ratio**2,
            "coulomb_friction_n_m": design.friction * nominal / design.ratio,
            "viscous_friction_n_m_s_per_rad": 0.08 * nominal / design.speed[1] / design.ratio**2,
        },
        "stages": stages,
        "load": {"inertia_kg_m2": arm + payload, "coulomb_friction_n_m": 0.05 * nominal},
        "motion": {"load_speed_rad_s": speed},
        "servo": {"speed_bandwidth_rad_s": 2 * math.pi * design.servo_hz},
    }
