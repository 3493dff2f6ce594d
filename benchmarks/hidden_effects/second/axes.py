"""Axes drawn by seed: true parameters, a data sheet that is near them, and the description that is handed over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.hidden_effects.second.kernel import Axis, Mesh


@dataclass(frozen=True)
class DataSheet:
    """Teeth (driver, driven) of both stages, and as new, at most [rad]: backlash, tooth error, load encoder's error."""

    transfer_teeth: tuple[int, int]
    output_teeth: tuple[int, int]
    transfer_backlash: float
    output_backlash: float
    transfer_error: float
    output_error: float
    encoder_error: float

    @property
    def ratio(self) -> float:
        """Motor speed over load speed."""
        transfer, output = self.transfer_teeth, self.output_teeth
        return transfer[1] / transfer[0] * output[1] / output[0]


def _draw_sheet(rng: np.random.Generator, transfer: tuple[int, int], output: tuple[int, int]) -> DataSheet:
    return DataSheet(
        transfer,
        output,
        transfer_backlash=float(rng.choice([4e-5, 5e-5, 8e-5])),
        output_backlash=float(rng.choice([1.5e-5, 2e-5, 3e-5])),
        transfer_error=float(rng.choice([1.5e-5, 2e-5, 3e-5])),
        output_error=float(rng.choice([1e-6, 1.5e-6, 2e-6])),
        encoder_error=float(rng.choice([1e-5, 1.5e-5, 2e-5])),
    )


def _draw_teeth(rng: np.random.Generator) -> tuple[tuple[int, int], tuple[int, int]]:
    """Draw teeth (driver, driven) of both stages, for a ratio of 50 to 130."""
    while True:
        first, second = int(rng.integers(11, 18)), int(rng.integers(11, 17))
        transfer = (first, round(first * rng.uniform(4, 9)))
        output = (second, round(second * rng.uniform(9, 14)))
        if 50 <= transfer[1] / transfer[0] * output[1] / output[0] <= 130:
            return transfer, output


def draw_axis(rng: np.random.Generator) -> tuple[Axis, DataSheet]:
    """Draw an axis whose inertias are matched and whose natural frequencies are those of robot joints."""
    u = rng.uniform
    teeth = _draw_teeth(rng)
    transfer_ratio, output_ratio = (driven / driver for driver, driven in teeth)
    ratio = teeth[0][1] / teeth[0][0] * teeth[1][1] / teeth[1][0]
    motor = float(np.exp(u(np.log(0.003), np.log(0.009))))
    load = u(0.4, 1.0) * motor * ratio * ratio
    transfer_stiffness = (2 * np.pi * u(11, 22)) ** 2 * motor * transfer_ratio**2
    output_stiffness = (2 * np.pi * u(8, 13)) ** 2 * load
    transfer_inertia = 0.02 * motor / 0.006 * u(0.7, 1.4)
    transfer_damping = 2 * u(0.002, 0.007) * np.sqrt(transfer_stiffness * motor * transfer_ratio**2)
    output_damping = 2 * u(0.01, 0.03) * np.sqrt(output_stiffness * load)
    motor_coulomb, motor_viscous = u(45, 100) * motor, u(0.28, 0.55) * motor
    load_coulomb, load_viscous = u(0.15, 0.35) * load, u(0.1, 0.22) * load
    efficiency = round(u(0.955, 0.985), 3)
    current_lag = u(2e-4, 5e-4)
    sheet = _draw_sheet(rng, *teeth)
    transfer_backlash, output_backlash = sheet.transfer_backlash * u(0.5, 1.0), sheet.output_backlash * u(0.5, 1.0)
    transfer_error, output_error = sheet.transfer_error * u(0.5, 1.0), sheet.output_error * u(0.5, 1.0)
    phases = [u(0, 2 * np.pi) for _ in range(4)]
    bandwidth = 2 * np.pi * u(25, 42)
    axis = Axis(
        transfer=Mesh(
            transfer_ratio,
            float(teeth[0][0]),
            transfer_stiffness,
            transfer_damping,
            transfer_backlash,
            transfer_error,
            *phases[:2],
        ),
        output=Mesh(
            output_ratio,
            float(teeth[1][0]),
            output_stiffness,
            output_damping,
            output_backlash,
            output_error,
            *phases[2:],
        ),
        motor_inertia=motor,
        transfer_inertia=transfer_inertia,
        load_inertia=load,
        motor_coulomb=motor_coulomb,
        motor_viscous=motor_viscous,
        load_coulomb=load_coulomb,
        load_viscous=load_viscous,
        output_efficiency=efficiency,
        position_gain=motor * bandwidth**2,
        speed_gain=2 * u(0.6, 0.9) * bandwidth * motor,
        integral_gain=motor * bandwidth**2 * float(rng.choice([0.0, 0.0, 1.0])),
        feedforward=u(0.6, 1.0) * (motor + load / ratio**2),
        stick_speed=float(rng.choice([0.0, 0.0, 0.0, u(0.5, 2.0)])),
        current_lag=current_lag,
    )
    return axis, sheet


def believed(rng: np.random.Generator, axis: Axis) -> Axis:
    """Return what the description says of an axis: 2 % off, damping by a third."""

    def off(value: float) -> float:
        return value * (1 + np.clip(0.02 * rng.standard_normal(), -0.04, 0.04))

    transfer, output = axis.transfer, axis.output
    axis = axis._replace(
        motor_inertia=off(axis.motor_inertia),
        motor_coulomb=off(axis.motor_coulomb),
        motor_viscous=off(axis.motor_viscous),
        transfer=transfer._replace(stiffness=off(transfer.stiffness)),
        output=output._replace(stiffness=off(output.stiffness)),
        load_inertia=off(axis.load_inertia),
        load_coulomb=off(axis.load_coulomb),
        load_viscous=off(axis.load_viscous),
    )
    return axis._replace(
        transfer=axis.transfer._replace(damping=transfer.damping * rng.uniform(0.67, 1.33)),
        output=axis.output._replace(damping=output.damping * rng.uniform(0.67, 1.33)),
    )


def mistaken(axis: Axis, what: str, factor: float) -> Axis:
    """Return the axis with its payload, friction or stiffness multiplied, as a description may have it wrong."""
    if what == "payload":
        return axis._replace(load_inertia=axis.load_inertia * factor)
    if what == "friction":
        return axis._replace(
            motor_coulomb=axis.motor_coulomb * factor,
            motor_viscous=axis.motor_viscous * factor,
            load_coulomb=axis.load_coulomb * factor,
            load_viscous=axis.load_viscous * factor,
        )
    if what == "stiffness":
        return axis._replace(
            transfer=axis.transfer._replace(stiffness=axis.transfer.stiffness * factor),
            output=axis.output._replace(stiffness=axis.output.stiffness * factor),
        )
    raise ValueError(f"what is wrong must be payload, friction or stiffness, got {what}")


def describe(name: str, axis: Axis, sheet: DataSheet, *, load_encoder: bool) -> str:
    """Return the axis description, TOML text; a mesh without loss has no efficiency in it."""
    transfer, output, loss = axis.transfer, axis.output, ""
    if axis.output_efficiency < 1.0:
        loss = f"mesh_efficiency = {axis.output_efficiency:g}\n"
    encoder = ""
    if load_encoder:
        encoder = (
            f"\n[load_encoder]\nerror_rad = {sheet.encoder_error:g}              # once per revolution, data sheet\n"
        )
    return f"""# what the axis is believed to be (data sheet and commissioning), before anything is measured
schema = "gearcase-axis/1"
name = "{name}"

[motor]
inertia_kg_m2 = {axis.motor_inertia:.6g}
coulomb_friction_n_m = {axis.motor_coulomb:.6g}
viscous_friction_n_m_s_per_rad = {axis.motor_viscous:.6g}

[[stages]]                      # motor side first
name = "transfer"               # the driven gear names the stage
driver_teeth = {sheet.transfer_teeth[0]}
driven_teeth = {sheet.transfer_teeth[1]}
inertia_kg_m2 = {axis.transfer_inertia:.3g}      # of the driven shaft
stiffness_n_m_per_rad = {transfer.stiffness:.6g}  # of the mesh and its shaft, at the driven gear
damping_n_m_s_per_rad = {transfer.damping:.2g}
backlash_rad = {sheet.transfer_backlash:g}             # as new, at most: total, at the driven gear
transmission_error_rad = {sheet.transfer_error:g}   # as new: amplitude at mesh order, at the driven gear

[[stages]]
name = "output"
driver_teeth = {sheet.output_teeth[0]}
driven_teeth = {sheet.output_teeth[1]}
stiffness_n_m_per_rad = {output.stiffness:.6g}
damping_n_m_s_per_rad = {output.damping:.2g}
{loss}backlash_rad = {sheet.output_backlash:g}
transmission_error_rad = {sheet.output_error:g}

[load]
inertia_kg_m2 = {axis.load_inertia:.6g}
coulomb_friction_n_m = {axis.load_coulomb:.6g}
viscous_friction_n_m_s_per_rad = {axis.load_viscous:.6g}
{encoder}"""
