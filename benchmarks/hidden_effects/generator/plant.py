"""The joint as it really is: the data sheet's joint with more bodies, and whatever was hidden in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.hidden_effects.generator import kernel
from benchmarks.hidden_effects.generator.joint import Joint
from benchmarks.hidden_effects.generator.motion import SETTLE_S, Motion

TABLE_CELLS = 16_384


@dataclass(frozen=True)
class Line:
    """One line of tooth error at a gear: amplitude [rad, at the driven gear], per turn of that gear, phase [rad]."""

    amplitude: float
    order: float
    phase: float


@dataclass(frozen=True)
class Damage:
    """A tooth that lost `depth` [rad] over `width` [rad] around `angle` [rad] on one flank (1 or -1)."""

    angle: float
    width: float
    depth: float
    flank: int
    rectangular: bool


@dataclass(frozen=True)
class Mesh:
    """What a stage really is: play [rad], tooth errors of driver and driven gear, damage, elasticity, losses."""

    gap: float
    driver: tuple[Line, ...]
    driven: tuple[Line, ...]
    damage: Damage | None = None
    cubic: float = 0.0
    hysteresis: float = 0.0
    loss: float = 0.0


@dataclass(frozen=True)
class Absorber:
    """A mass [kg m2] on a spring at the load: natural frequency [Hz] and damping ratio."""

    inertia: float
    frequency: float
    damping_ratio: float


@dataclass(frozen=True)
class Plant:
    """Everything that the simulation needs; effects return a changed copy.

    `shares`: of coupling in the motor-side elasticity, pinion in the motor's inertia, shaft in the output's
    elasticity, output gear in the load's inertia.  `frictions` (2, 16) as the kernel takes them.
    """

    joint: Joint
    shares: tuple[float, float, float, float]
    meshes: tuple[Mesh, ...]
    frictions: NDArray[np.float64]
    gravity: tuple[float, float] = (0.0, 0.0)
    ripple: tuple[float, float, float] = (0.0, 0.0, 0.0)
    drift_rate: float = 0.0
    absorber: Absorber | None = None
    disturbance: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def with_mesh(self, name: str, **changes: object) -> Plant:
        """Return the plant with the mesh of one stage changed."""
        names = [stage.name for stage in self.joint.stages]
        meshes = list(self.meshes)
        place = names.index(name)
        meshes[place] = replace(meshes[place], **changes)  # type: ignore[arg-type]
        return replace(self, meshes=tuple(meshes))

    def with_friction(self, body: int, **columns: float) -> Plant:
        """Return the plant with columns of one body's friction (0 motor, 1 load) changed."""
        frictions = self.frictions.copy()
        for column, value in columns.items():
            frictions[body, getattr(kernel, column.upper())] = value
        return replace(self, frictions=frictions)


@dataclass(frozen=True)
class Run:
    """What the simulation gave, at the telemetry's rate, and the mesh force at the kernel's."""

    motor_torque: NDArray[np.float64]
    motor_angle: NDArray[np.float64]
    load_angle: NDArray[np.float64]
    motor_speed: NDArray[np.float64]
    force: NDArray[np.float32]
    energy: NDArray[np.float64]

    def since(self, sample: int) -> Run:
        """Return the run without its first samples (energy stays that of the whole)."""
        per = kernel.STEP_RATE_HZ // kernel.TELEMETRY_RATE_HZ
        return Run(
            self.motor_torque[sample:],
            self.motor_angle[sample:],
            self.load_angle[sample:],
            self.motor_speed[sample:],
            self.force[sample * per :],
            self.energy,
        )


def build_plant(rng: np.random.Generator, joint: Joint) -> Plant:
    """Draw the hidden inside of a joint in good order: errors below those of the data sheet, presliding friction."""
    meshes = []
    for stage in joint.stages:
        new, phase = stage.tooth_error * rng.uniform(0.3, 0.9), rng.uniform(0, 2 * np.pi, 4)
        driven = (
            Line(new, stage.driven_teeth, phase[0]),
            Line(0.3 * new, 2 * stage.driven_teeth, phase[1]),
            Line(0.5 * new, 1, phase[2]),
        )
        driver = (Line(0.4 * new, 1, phase[3]),)
        loss = 0.0 if stage.efficiency is None else 1 - stage.efficiency
        meshes.append(Mesh(stage.backlash * float(rng.uniform(0.3, 0.95)), driver, driven, loss=loss))
    frictions = np.zeros((2, 16))
    sliding = (joint.motor_coulomb, joint.motor_viscous), (joint.load_coulomb, joint.load_viscous)
    presliding = rng.uniform(1e-3, 3e-3), rng.uniform(1e-5, 3e-5)
    for body, (coulomb, viscous) in enumerate(sliding):
        inertia = joint.load_inertia if body else joint.motor_inertia
        stretch = presliding[body] if joint.stages else 3e-5
        frictions[body, [kernel.COULOMB_FORWARD, kernel.COULOMB_BACKWARD]] = coulomb
        frictions[body, [kernel.VISCOUS_FORWARD, kernel.VISCOUS_BACKWARD]] = viscous
        frictions[body, kernel.BRISTLE_STIFFNESS] = stiffness = max(coulomb, 1e-9) / stretch
        frictions[body, kernel.BRISTLE_DAMPING] = 0.1 * np.sqrt(stiffness * inertia)
        frictions[body, [kernel.STRIBECK_SPEED, kernel.STRIBECK_EXPONENT, kernel.BAND_WIDTH]] = 1.0
    shares = tuple(rng.uniform([0.1, 0.01, 0.15, 0.005], [0.2, 0.025, 0.3, 0.012]))
    return Plant(joint, shares, tuple(meshes), frictions)  # type: ignore[arg-type]


def _tooth_table(lines: tuple[Line, ...], damage: Damage | None, flank: int) -> tuple[NDArray, NDArray]:
    """Return tooth error [rad] and its slope over one turn (n + 1)."""
    angle = np.linspace(0.0, 2 * np.pi, TABLE_CELLS + 1)
    value, slope = np.zeros_like(angle), np.zeros_like(angle)
    for line in lines:
        value += line.amplitude * np.cos(line.order * angle + line.phase)
        slope -= line.amplitude * line.order * np.sin(line.order * angle + line.phase)
    if damage is not None and damage.flank == flank:
        dip = flank * damage.depth * _damage_shape(angle, damage)
        value += dip
        slope += np.gradient(dip, angle)
    return value, slope


def _damage_shape(angle: NDArray[np.float64], damage: Damage) -> NDArray[np.float64]:
    """Return the shape of the missing flank, 0 to 1: a half sine, or a rectangle with short rounded edges."""
    away = np.abs((angle - damage.angle + np.pi) % (2 * np.pi) - np.pi) / (damage.width / 2)
    if not damage.rectangular:
        return np.where(away < 1, np.cos(np.pi / 2 * np.minimum(away, 1)), 0.0)
    edge = 0.25
    return 0.5 * (1 + np.cos(np.pi * np.clip((away - (1 - edge)) / (2 * edge), 0, 1)))


def _links(plant: Plant) -> tuple[list[list[float]], list[float]]:
    """Return links (start, end, 12 columns) and inertias; the load is the last body before an absorber."""
    joint = plant.joint
    coupling, pinion, shaft, gear = plant.shares
    rows: list[list[float]] = []

    def link(ratio: float, stiffness: float, damping: float) -> list[float]:
        row = [0.0] * 12
        row[kernel.RATIO], row[kernel.STIFFNESS], row[kernel.DAMPING] = ratio, stiffness, damping
        row[kernel.TEETH], row[kernel.YIELD_TWIST], row[kernel.LOSS_SPEED] = -1, 1.0, 1.0
        rows.append(row)
        return row

    def spring(index: int, share: float, faster: float, ratio: float = 1.0) -> list[float]:
        """A share of the elasticity of a stage, on a shaft `faster` times as fast as its driven gear."""
        stage, mesh = joint.stages[index], plant.meshes[index]
        row = link(ratio, stage.stiffness / share / faster**2, stage.damping / share / faster**2)
        row[kernel.CUBIC] = mesh.cubic / (share * faster) ** 2
        row[kernel.HYSTERESIS] = mesh.hysteresis / faster
        row[kernel.YIELD_TWIST] = share * faster * 0.3 * working_twist(joint, index)
        return row

    inertias = [joint.motor_inertia * (1 - pinion), joint.motor_inertia * pinion]
    if not joint.stages:
        link(1.0, joint.stiffness / coupling, joint.damping / coupling)
        link(1.0, joint.stiffness / (1 - coupling), joint.damping / (1 - coupling))
        rows[-1][kernel.LOUDNESS] = 1 / joint.peak_torque
        return rows, [*inertias, joint.load_inertia]
    last = len(joint.stages) - 1
    for index, (stage, mesh) in enumerate(zip(joint.stages, plant.meshes, strict=True)):
        rest = 1.0
        if index == 0:
            spring(index, coupling, stage.ratio)
            rest -= coupling
        if index == last:
            rest -= shaft
        row = spring(index, rest, 1.0, stage.ratio)
        row[kernel.GAP], row[kernel.SOFTNESS] = mesh.gap, 0.05 * stage.backlash
        row[kernel.LOSS], row[kernel.LOSS_SPEED] = mesh.loss, 0.004 * speed_of(joint, index)
        row[kernel.TEETH], row[kernel.LOUDNESS] = index, 1.0 / torque_of(joint, index)
        inertias.append(stage.inertia if index != last else joint.load_inertia * gear)
        if index == last:
            spring(index, shaft, 1.0)
            inertias.append(joint.load_inertia * (1 - gear))
    return rows, inertias


def speed_of(joint: Joint, index: int) -> float:
    """Return the top speed of the driven gear of a stage [rad/s]."""
    after = np.prod([s.ratio for s in joint.stages[index + 1 :]]) if index >= 0 else 1.0
    return float(joint.top_speed * after)


def torque_of(joint: Joint, index: int) -> float:
    """Return the largest torque of acceleration at the driven gear of a stage [N m]."""
    load = joint.load_inertia * joint.top_speed / 0.4 * 2
    return float(load / np.prod([s.ratio for s in joint.stages[index + 1 :]]))


def working_twist(joint: Joint, index: int) -> float:
    """Return the twist of a stage under its largest torque [rad]."""
    return torque_of(joint, index) / joint.stages[index].stiffness


def simulate(
    plant: Plant,
    motion: Motion,
    seconds: float,
    *,
    disturbance: NDArray[np.float64] | None = None,
    quantised: bool = True,
    drift_start: float = 0.0,
) -> Run:
    """Simulate the settling time and `seconds` after it; `disturbance` is a torque on the load [N m]."""
    joint = plant.joint
    rows, inertias = _links(plant)
    count = len(rows)
    starts, ends = list(range(count)), list(range(1, count + 1))
    load_body = count
    if plant.absorber is not None:
        rate = 2 * np.pi * plant.absorber.frequency
        row = [1.0] + [0.0] * 11
        row[kernel.STIFFNESS] = plant.absorber.inertia * rate**2
        row[kernel.DAMPING] = 2 * plant.absorber.damping_ratio * plant.absorber.inertia * rate
        row[kernel.TEETH] = -1
        rows.append(row)
        starts.append(load_body)
        ends.append(load_body + 1)
        inertias = [*inertias[:-1], inertias[-1] - plant.absorber.inertia, plant.absorber.inertia]
    tables = [
        table
        for mesh in plant.meshes
        for table in (
            _tooth_table(mesh.driver, None, 0),
            _tooth_table(mesh.driven, mesh.damage, 1),
            _tooth_table(mesh.driven, mesh.damage, -1),
        )
    ] or [(np.zeros(2), np.zeros(2))]
    samples = round((SETTLE_S + seconds) * kernel.TELEMETRY_RATE_HZ)
    if samples * kernel.SERVO_RATE_HZ > motion.course.shape[1] * kernel.TELEMETRY_RATE_HZ:
        raise ValueError(f"the motion ends before {seconds} s")
    outer = np.zeros(samples + 1)
    if disturbance is not None:
        outer[: len(disturbance)] += disturbance[: len(outer)]
    amplitude, frequency, phase = plant.disturbance
    if amplitude:
        time = np.arange(samples + 1) / kernel.TELEMETRY_RATE_HZ
        outer += amplitude * np.sin(2 * np.pi * frequency * time + phase)
    loads = np.array([*plant.gravity, *plant.ripple, plant.drift_rate, drift_start - SETTLE_S])
    signals, force, energy = kernel.run(
        np.array(inertias),
        np.array(starts),
        np.array(ends),
        np.array(rows),
        plant.frictions,
        load_body,
        _servo(joint, quantised=quantised),
        loads,
        outer,
        motion.course * joint.ratio,
        np.array([t[0] for t in tables]),
        np.array([t[1] for t in tables]),
        samples,
    )
    return Run(*signals, force, energy).since(round(SETTLE_S * kernel.TELEMETRY_RATE_HZ))


def _servo(joint: Joint, *, quantised: bool) -> NDArray[np.float64]:
    """Return the servo's gains, from the joint's inertia as its makers would tune it."""
    inertia = joint.motor_inertia + joint.load_inertia / joint.ratio**2
    bandwidth = 2 * np.pi * 9.0
    values = np.zeros(8)
    values[kernel.POSITION_GAIN] = bandwidth / 4
    values[kernel.SPEED_GAIN] = inertia * bandwidth
    values[kernel.INTEGRAL_GAIN] = inertia * bandwidth**2 / 5
    values[kernel.INERTIA_FEEDFORWARD] = 0.8 * inertia
    values[kernel.ENCODER_STEP] = 2 * np.pi / 2**21 if quantised else 0.0
    values[kernel.CURRENT_LAG] = 6e-4
    values[kernel.SPEED_FILTER] = 0.35
    values[kernel.LIMIT] = 20 * joint.peak_torque
    return values
