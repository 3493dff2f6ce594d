"""Gears of which nothing elastic is known and whose output nobody sees: the drive moves as one body, at the motor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from signals.telemetry import Telemetry
from sim.description.axis import Axis, Load, LoadEncoder, Transmission


def is_one_body(axis: Axis, telemetry: Telemetry) -> bool:
    """Whether gears are rigid for all that is described and logged: no stiffness, no backlash, no encoder at the load.

    Nor a mechanism, which may act at a gear.

    A stiffness that is unknown shows between two encoders; at the motor alone it is what acceleration and weight are.
    """
    elastic = any(stiffness is not None for stiffness in axis.stiffness())
    loose = any(stage.backlash_rad for stage in axis.stages)
    seen = "load_position_rad" in telemetry.channels
    return bool(axis.stages) and not (elastic or loose or seen or axis.mechanisms)


BY_THE_RATIO = (
    "No channel has the motion of the motor: it was taken from that of the load by the ratio, as of rigid gears, so "
    "what the gears do in between is not seen."
)


UNDESCRIBED: Mapping[str, Any] = {"motor": {}, "load": {"inertia_kg_m2": 0.0}}
"""An axis of which nothing is known: one body, of an inertia to be estimated."""


def with_motor_motion(axis: Axis, telemetry: Telemetry) -> Telemetry:
    """Return telemetry whose torque has a motion: where only the load's was logged, the motor's by the ratio.

    Robots log the angles of joints, which their drives compute from the motor's.
    """
    channels = telemetry.channels
    if "motor_torque_nm" not in channels or any(
        f"motor_{each}" in channels for each in ("position_rad", "speed_rad_s")
    ):
        return telemetry
    motor = {
        name.replace("load_", "motor_"): channels[name] * axis.ratio for name in channels if name.startswith("load_")
    }
    kept = {name: values for name, values in channels.items() if not name.startswith("load_")}
    lost = {name.replace("load_", "motor_"): rows for name, rows in telemetry.lost.items()}
    return replace(telemetry, channels={**kept, **motor}, lost=lost) if motor else telemetry


def has_ratios_alone(axis: Axis) -> bool:
    """Whether neither teeth nor losses of the gears are described, which no body has."""
    plain = (s.driven_teeth is None and s.mesh_efficiency == 1.0 and not s.transmission_error_rad for s in axis.stages)
    return all(plain)


def at_the_motor(axis: Axis, load_kg_m2: float = 0.0) -> Axis:
    """The axis as one body that turns with the motor; what moves behind a gear counts by its ratio (squared).

    `load_kg_m2`: inertia of the load, where it is no part of a known torque.
    """
    n, motor, load = axis.ratio, axis.motor, axis.load
    inertias = sum(stage.inertia_kg_m2 * (axis.ratio_from(stage.name) / n) ** 2 for stage in axis.stages)
    return replace(
        axis,
        stages=(),
        transmission=Transmission(),
        load_encoder=LoadEncoder(),
        load=Load(load_kg_m2 / n**2 + (inertias if motor.inertia_kg_m2 else 0.0)),
        motor=replace(
            motor,
            coulomb_friction_n_m=motor.coulomb_friction_n_m + load.coulomb_friction_n_m / n,
            viscous_friction_n_m_s_per_rad=motor.viscous_friction_n_m_s_per_rad
            + load.viscous_friction_n_m_s_per_rad / n**2,
        ),
    )


def as_described(axis: Axis, found: Axis) -> Axis:
    """The described gears with what was found at the motor."""
    load = replace(axis.load, coulomb_friction_n_m=0.0, viscous_friction_n_m_s_per_rad=0.0)
    return replace(axis, motor=found.motor, load=load, mechanisms=found.mechanisms)
