"""A robot joint's data sheet: drawn by seed, believed with errors, written as an axis description."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

KINDS = ("three shafts", "two shafts", "direct drive")


@dataclass(frozen=True)
class Stage:
    """One gear stage, named after its driven gear; elasticity, play and errors at the driven gear.

    `inertia` [kg m2] of the driven shaft (0: counted in the load), `stiffness` [N m/rad] of mesh and shaft,
    `damping` [N m s/rad], `efficiency` None where the data sheet gives none, `backlash` and `tooth_error` [rad]
    as new, at most.
    """

    name: str
    driver_teeth: int
    driven_teeth: int
    inertia: float
    stiffness: float
    damping: float
    efficiency: float | None
    backlash: float
    tooth_error: float

    @property
    def ratio(self) -> float:
        """Speed of the driver over speed of the driven gear."""
        return self.driven_teeth / self.driver_teeth


@dataclass(frozen=True)
class Joint:
    """Inertias [kg m2], friction [N m, N m s/rad] of motor and load, and the stages between them.

    `stiffness`, `damping` stand for the whole transmission at the load where there are no stages.
    """

    name: str
    motor_inertia: float
    motor_coulomb: float
    motor_viscous: float
    stages: tuple[Stage, ...]
    load_inertia: float
    load_coulomb: float
    load_viscous: float
    stiffness: float
    damping: float
    encoder_error: float
    peak_torque: float
    top_speed: float

    @property
    def ratio(self) -> float:
        """Motor speed over load speed."""
        return float(np.prod([stage.ratio for stage in self.stages])) if self.stages else 1.0

    @property
    def coulomb_at_motor(self) -> float:
        return self.motor_coulomb + self.load_coulomb / self.ratio

    @property
    def viscous_at_motor(self) -> float:
        return self.motor_viscous + self.load_viscous / self.ratio**2

    def stage(self, name: str) -> Stage:
        return next(stage for stage in self.stages if stage.name == name)

    def with_stage(self, name: str, **changes: object) -> Joint:
        """Return the joint with one stage changed."""
        stages = tuple(replace(s, **changes) if s.name == name else s for s in self.stages)  # type: ignore[arg-type]
        return replace(self, stages=stages)

    def scaled_friction(self, *, coulomb: float = 1.0, viscous: float = 1.0) -> Joint:
        """Return the joint with Coulomb and viscous friction of motor and load multiplied."""
        return replace(
            self,
            motor_coulomb=self.motor_coulomb * coulomb,
            load_coulomb=self.load_coulomb * coulomb,
            motor_viscous=self.motor_viscous * viscous,
            load_viscous=self.load_viscous * viscous,
        )


def _teeth(rng: np.random.Generator, ratio_low: float, ratio_high: float) -> tuple[int, int]:
    driver = int(rng.integers(11, 21))
    return driver, round(driver * rng.uniform(ratio_low, ratio_high))


def _output_stage(rng: np.random.Generator, teeth: tuple[int, int], stiffness: float, damping: float) -> Stage:
    return Stage(
        "output",
        *teeth,
        inertia=0.0,
        stiffness=stiffness,
        damping=damping,
        efficiency=float(rng.uniform(0.95, 0.985)),
        backlash=float(rng.uniform(1.5e-5, 4e-5)),
        tooth_error=float(rng.uniform(1e-6, 3e-6)),
    )


def _transfer_stage(rng: np.random.Generator, teeth: tuple[int, int], output: Stage, motor_inertia: float) -> Stage:
    stiffness = float(output.stiffness / output.ratio**2 * rng.uniform(1.6, 3.0))
    inertia = float(motor_inertia * (teeth[1] / teeth[0]) ** 2 * rng.uniform(0.03, 0.08))
    return Stage(
        "transfer",
        *teeth,
        inertia=inertia,
        stiffness=stiffness,
        damping=float(2 * rng.uniform(0.012, 0.03) * np.sqrt(stiffness * inertia)),
        efficiency=float(rng.uniform(0.96, 0.99)) if rng.random() < 0.3 else None,
        backlash=float(rng.uniform(4e-5, 8e-5)),
        tooth_error=float(rng.uniform(1.5e-5, 4e-5)),
    )


def draw_joint(rng: np.random.Generator, kind: str) -> Joint:
    """Draw a joint whose natural frequencies and torques are those of robot joints."""
    inertia_range = {"three shafts": (2e-3, 8e-3), "two shafts": (5e-3, 3e-2), "direct drive": (0.1, 0.5)}[kind]
    locked_hz = {"three shafts": (8, 15), "two shafts": (9, 20), "direct drive": (15, 35)}[kind]
    ratios = {"three shafts": ((4.0, 9.0), (8.0, 14.0)), "two shafts": ((5.0, 13.0),), "direct drive": ()}[kind]
    teeth = [_teeth(rng, *limits) for limits in ratios]
    ratio = float(np.prod([driven / driver for driver, driven in teeth])) if teeth else 1.0
    motor_inertia = float(np.exp(rng.uniform(*np.log(inertia_range))))
    load_inertia = float(ratio**2 * motor_inertia * rng.uniform(0.5, 1.6))
    locked = 2 * np.pi * rng.uniform(*locked_hz)
    stiffness = float(load_inertia * locked**2)
    damping = float(2 * rng.uniform(0.01, 0.03) * stiffness / locked)
    stages: tuple[Stage, ...] = ()
    if teeth:
        stages = (_output_stage(rng, teeth[-1], stiffness, damping),)
    if len(teeth) == 2:
        stages = (_transfer_stage(rng, teeth[0], stages[0], motor_inertia), *stages)
    top_speed = float(rng.uniform(2.5, 5.0) if kind == "direct drive" else rng.uniform(1.9, 3.0))
    peak = float((motor_inertia + load_inertia / ratio**2) * top_speed * ratio / 0.4 * 2)
    coulomb = peak * rng.uniform(0.03, 0.07)
    viscous = peak * rng.uniform(0.03, 0.07) / (top_speed * ratio)
    at_load = rng.uniform(0.1, 0.35)
    return Joint(
        name=f"joint-{rng.integers(100, 1000)}",
        motor_inertia=motor_inertia,
        motor_coulomb=float(coulomb * (1 - at_load)),
        motor_viscous=float(viscous * (1 - at_load)),
        stages=stages,
        load_inertia=load_inertia,
        load_coulomb=float(coulomb * at_load * ratio),
        load_viscous=float(viscous * at_load * ratio**2),
        stiffness=stiffness,
        damping=damping,
        encoder_error=float(rng.uniform(1e-5, 2e-5)),
        peak_torque=peak,
        top_speed=top_speed,
    )


def believed(rng: np.random.Generator, joint: Joint, *, spread: float = 0.02, payload: float = 0.0) -> Joint:
    """Return what the data sheet says of the joint: a few percent off, damping by a third.

    `payload` is the relative error of the load's inertia on top.
    """

    def off(value: float, by: float = spread) -> float:
        return float(value * (1 + by * np.clip(rng.standard_normal(), -2.5, 2.5)))

    def third(value: float) -> float:
        return float(value * np.exp(rng.uniform(-0.33, 0.33)))

    stages = tuple(
        replace(
            s,
            inertia=off(s.inertia),
            stiffness=off(s.stiffness),
            damping=third(s.damping),
            efficiency=None if s.efficiency is None else 1 - off(1 - s.efficiency, 3 * spread),
        )
        for s in joint.stages
    )
    return replace(
        joint,
        motor_inertia=off(joint.motor_inertia),
        motor_coulomb=off(joint.motor_coulomb),
        motor_viscous=off(joint.motor_viscous),
        stages=stages,
        load_inertia=off(joint.load_inertia) * (1 + payload),
        load_coulomb=off(joint.load_coulomb),
        load_viscous=off(joint.load_viscous),
        stiffness=off(joint.stiffness),
        damping=third(joint.damping),
    )


def _pair(key: str, value: float) -> str:
    return f"{key} = {value:.6g}"


def _stage_lines(stage: Stage, *, teeth: bool, elastic: bool) -> list[str]:
    lines = ["", "[[stages]]", f'name = "{stage.name}"']
    if teeth:
        lines += [f"driver_teeth = {stage.driver_teeth}", f"driven_teeth = {stage.driven_teeth}"]
    else:
        lines += [f"ratio = {stage.ratio:.12g}"]
    if stage.inertia > 0:
        lines.append(_pair("inertia_kg_m2", stage.inertia))
    if elastic:
        lines.append(_pair("stiffness_n_m_per_rad", stage.stiffness))
        lines.append(_pair("damping_n_m_s_per_rad", stage.damping))
    if stage.efficiency is not None:
        lines.append(_pair("mesh_efficiency", stage.efficiency))
    lines.append(_pair("backlash_rad", stage.backlash))
    lines.append(_pair("transmission_error_rad", stage.tooth_error))
    return lines


def _whole(joint: Joint) -> tuple[float, float]:
    """Return stiffness and damping of all stages in series, seen at the load with the motor locked."""
    after, give, yielding = 1.0, 0.0, 0.0
    for stage in reversed(joint.stages):
        give += 1 / (stage.stiffness * after**2)
        yielding += 1 / (stage.damping * after**2)
        after *= stage.ratio
    return 1 / give, 1 / yielding


def describe(joint: Joint, *, load_encoder: bool, teeth: bool = True, whole_transmission: bool = False) -> str:
    """Return the axis description, TOML text.

    `teeth` False gives ratios instead; `whole_transmission` gives stiffness and damping once, at the output.
    """
    whole = whole_transmission or not joint.stages
    lines = [
        "# what the axis is believed to be (data sheet and commissioning), before anything is measured",
        'schema = "gearcase-axis/1"',
        f'name = "{joint.name}"',
        "",
        "[motor]",
        _pair("inertia_kg_m2", joint.motor_inertia),
        _pair("coulomb_friction_n_m", joint.motor_coulomb),
        _pair("viscous_friction_n_m_s_per_rad", joint.motor_viscous),
    ]
    for stage in joint.stages:
        lines += _stage_lines(stage, teeth=teeth, elastic=not whole)
    if whole:
        stiffness, damping = _whole(joint) if joint.stages else (joint.stiffness, joint.damping)
        lines += ["", "[transmission]", _pair("stiffness_n_m_per_rad", stiffness)]
        lines.append(_pair("damping_n_m_s_per_rad", damping))
    lines += [
        "",
        "[load]",
        _pair("inertia_kg_m2", joint.load_inertia),
        _pair("coulomb_friction_n_m", joint.load_coulomb),
        _pair("viscous_friction_n_m_s_per_rad", joint.load_viscous),
    ]
    if load_encoder:
        lines += ["", "[load_encoder]", _pair("error_rad", joint.encoder_error)]
    return "\n".join(lines) + "\n"
