"""What can be hidden: how each effect changes the axis or the recording, its size, and its level."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.hidden_effects.second.kernel import Axis
from benchmarks.hidden_effects.second.scene import EncoderError, Recording, Scene, simulate
from benchmarks.hidden_effects.second.sound import Bearing

LEVELS = {"full": 1.0, "half": 0.5, "quarter": 0.25}


def _same_axis(axis: Axis) -> Axis:
    return axis


def _same_recording(recording: Recording) -> Recording:
    return recording


@dataclass(frozen=True)
class Loss:
    """A share of the samples is lost: as `rows` that are missing, or as values that are `held`."""

    share: float
    how: str


@dataclass(frozen=True)
class Effect:
    """One hidden effect: `size` is what may be found of it, `notes` what else is known.

    `act` is the axis with it, `without` the axis that lacks it altogether, which is also what the description says.
    `fault` is what the electronics do to a recording.
    """

    size: Mapping[str, float] = field(default_factory=dict)
    notes: Mapping[str, object] = field(default_factory=dict)
    act: Callable[[Axis], Axis] = _same_axis
    without: Callable[[Axis], Axis] = _same_axis
    fault: Callable[[Recording], Recording] = _same_recording
    encoder_error: EncoderError | None = None
    bearing: Bearing | None = None
    torque_limit: float | None = None
    loss: Loss | None = None


@dataclass(frozen=True)
class Draw:
    """What an effect may depend on; `level` is a value of LEVELS, `location` its gear, channel or kind, or empty."""

    rng: np.random.Generator
    scene: Scene
    level: float
    location: str

    @property
    def axis(self) -> Axis:
        return self.scene.axis

    @property
    def ratio(self) -> float:
        return self.scene.sheet.ratio

    @property
    def friction_scale(self) -> float:
        """Return 1 for a motor of middle size; motors' friction grows with their inertia."""
        return self.axis.motor_inertia / 0.005

    @property
    def peak_load_torque(self) -> float:
        """Return the largest torque that accelerates the load [N m]."""
        return self.axis.load_inertia * np.abs(self.scene.motion.acceleration).max() / self.ratio

    def uniform(self, low: float, high: float) -> float:
        return self.rng.uniform(low, high)

    def sign(self) -> float:
        return float(self.rng.choice([1, -1]))


def _rounded(value: float) -> float:
    """Return a value with the four digits that the answer gives of it."""
    return float(f"{value:.4g}")


def _with_mesh(name: str, **values: float) -> Callable[[Axis], Axis]:
    """Return what changes one mesh of an axis."""
    return lambda axis: axis._replace(**{name: getattr(axis, name)._replace(**values)})


def _with(**values: float) -> Callable[[Axis], Axis]:
    """Return what changes an axis."""
    return lambda axis: axis._replace(**values)


def backlash(draw: Draw) -> Effect:
    usual = 1.1e-3 * draw.uniform(0.85, 1.3) if draw.location == "output" else 0.008 * draw.uniform(0.8, 1.2)
    gap = _rounded(draw.level * usual)
    return Effect({"gap_rad": gap}, act=_with_mesh(draw.location, backlash=gap))


def tooth_damage(draw: Draw) -> Effect:
    depth = _rounded(draw.level * (1e-3 if draw.location == "output" else 0.004) * draw.uniform(0.8, 1.3))
    flank, angle = draw.sign(), _rounded(draw.uniform(0.8, 5.5))
    conventions = (
        "angle of the middle of the tooth at the driven gear (load encoder zero); flank 1 carries positive torque"
    )
    return Effect(
        {"depth_rad": depth, "angle_rad": angle, "flank": flank},
        {"conventions": conventions},
        act=_with_mesh(draw.location, damage_depth=depth, damage_angle=angle, damage_flank=flank),
    )


def eccentricity(draw: Draw) -> Effect:
    usual = 2.2e-3 if draw.location == "transfer" else 6e-4
    amplitude = _rounded(draw.level * usual * draw.uniform(0.8, 1.2))
    phase = _rounded(draw.uniform(0, 6.28))
    return Effect(
        {"amplitude_rad": amplitude},
        act=_with_mesh(draw.location, eccentricity=amplitude, eccentricity_phase=phase),
    )


def mesh_error(draw: Draw) -> Effect:
    usual = 2.5e-4 if draw.location == "transfer" else 1.6e-4
    amplitude = _rounded(draw.level * usual * draw.uniform(0.8, 1.2))
    return Effect(
        {"amplitude_rad": amplitude},
        {"note": "second harmonic has 0.3 of the amplitude"},
        act=_with_mesh(draw.location, error=amplitude),
    )


def coulomb_friction(draw: Draw) -> Effect:
    axis, level = draw.axis, draw.level
    return Effect(
        {"torque_n_m": _rounded(level * (axis.motor_coulomb + axis.load_coulomb / draw.ratio))},
        act=_with(motor_coulomb=level * axis.motor_coulomb, load_coulomb=level * axis.load_coulomb),
        without=_with(motor_coulomb=0.0, load_coulomb=0.0),
    )


def viscous_friction(draw: Draw) -> Effect:
    axis, level = draw.axis, draw.level
    whole = axis.motor_viscous + axis.load_viscous / (draw.ratio * draw.ratio)
    return Effect(
        {"coefficient_n_m_s_per_rad": _rounded(level * whole)},
        act=_with(motor_viscous=level * axis.motor_viscous, load_viscous=level * axis.load_viscous),
        without=_with(motor_viscous=0.0, load_viscous=0.0),
    )


def stribeck_friction(draw: Draw) -> Effect:
    torque = _rounded(draw.level * 0.5 * draw.friction_scale**0.5 * draw.uniform(0.9, 1.3))
    speed = _rounded(draw.uniform(12, 30))
    gaussian = float(draw.rng.random() < 0.6)
    return Effect(
        {"torque_n_m": torque, "speed_rad_s": speed},
        {"form": "exp(-(w/speed)^2)" if gaussian else "exp(-|w|/speed)"},
        act=_with(stribeck_torque=torque, stribeck_speed=speed, stribeck_gaussian=gaussian),
    )


def friction_asymmetry(draw: Draw) -> Effect:
    fraction = _rounded(draw.level * 0.25 * draw.sign())
    half = _rounded(fraction * (draw.axis.motor_coulomb + draw.axis.load_coulomb / draw.ratio))
    return Effect(
        notes={
            "fraction": fraction,
            "form": "all friction times (1 + fraction*sign(speed))",
            "torque_half_difference_n_m": half,
        },
        act=_with(friction_asymmetry=fraction),
    )


def load_dependent_loss(draw: Draw) -> Effect:
    fraction = _rounded(draw.level * draw.uniform(0.09, 0.13))
    return Effect(
        {"fraction": fraction},
        {"true_location": "output"},
        act=_with(output_efficiency=1 - fraction),
        without=_with(output_efficiency=1.0),
    )


def friction_drift(draw: Draw) -> Effect:
    rate = _rounded(draw.level * 0.014 * draw.uniform(0.8, 1.2) * draw.sign())
    return Effect(
        {"rate_per_s": rate},
        {"form": "all friction times (1 + rate*t), t from the first sample"},
        act=_with(friction_drift=rate),
    )


def gravity_imbalance(draw: Draw) -> Effect:
    torque = _rounded(draw.level * 0.6 * draw.friction_scale**0.5 * draw.ratio * draw.uniform(0.8, 1.2))
    phase = _rounded(draw.uniform(0, 6.28))
    return Effect(
        {"torque_n_m": torque},
        {"phase_rad": phase, "form": "load feels -T sin(load angle + phase)"},
        act=_with(gravity_torque=torque, gravity_phase=phase),
    )


def torque_ripple(draw: Draw) -> Effect:
    torque = _rounded(draw.level * 0.35 * draw.friction_scale**0.5 * draw.uniform(0.8, 1.2))
    order = float(draw.rng.choice([2, 4, 6, 8, 12]))
    phase = draw.uniform(0, 6.28)
    return Effect(
        {"torque_n_m": torque, "order": order},
        {"true_location": "motor"},
        act=_with(ripple_torque=torque, ripple_order=order, ripple_phase=phase),
    )


def stiffness_hardening(draw: Draw) -> Effect:
    twist = draw.peak_load_torque / draw.axis.output.stiffness
    cubic = _rounded(draw.level * 0.8 / twist**2)
    return Effect(
        {"cubic_per_rad2": cubic},
        {"true_location": "output", "form": "T = k x (1 + c x^2), x twist of the output mesh at the driven gear"},
        act=_with_mesh("output", cubic=cubic),
    )


def hysteresis(draw: Draw) -> Effect:
    torque = _rounded(draw.level * 0.12 * draw.peak_load_torque)
    return Effect(
        {"torque_n_m": torque},
        {
            "true_location": "output",
            "form": "Dahl element beside the output mesh, torque at the driven gear",
            "torque_at_motor_n_m": _rounded(torque / draw.ratio),
        },
        act=_with(hysteresis_torque=torque, hysteresis_twist=torque / (0.25 * draw.axis.output.stiffness)),
    )


def structural_resonance(draw: Draw) -> Effect:
    axis, share = draw.axis, draw.level * 0.2
    own = np.sqrt(axis.output.stiffness / axis.load_inertia) / 2 / np.pi
    frequency = _rounded(own * draw.uniform(1.3, 1.7))
    inertia = share * axis.load_inertia
    stiffness = inertia * (2 * np.pi * frequency) ** 2
    form = f"part of the load ({share:.3g} of its inertia) hangs on a spring; frequency with the load held"
    return Effect(
        {"frequency_hz": frequency},
        {"form": form},
        act=_with(
            attached_inertia=inertia,
            attached_stiffness=stiffness,
            attached_damping=2 * 0.015 * np.sqrt(stiffness * inertia),
        ),
    )


def bearing_defect(draw: Draw) -> Effect:
    order = _rounded(draw.uniform(3.1, 7.9))
    return Effect(
        {"order": order},
        {"form": "impacts per motor revolution, 3 % scatter of each"},
        bearing=Bearing(order, draw.level * 0.9 * draw.scene.loudness),
    )


def torque_offset(draw: Draw) -> Effect:
    offset = _rounded(draw.level * 0.3 * draw.uniform(0.8, 1.2) * draw.sign())
    return Effect({"torque_n_m": offset}, fault=lambda r: replace(r, motor_torque=r.motor_torque + offset))


def encoder_error(draw: Draw) -> Effect:
    amplitude = _rounded(draw.level * 5e-4 * draw.uniform(0.8, 1.2))
    return Effect(
        notes={"amplitude_rad": amplitude, "encoder": "load"},
        encoder_error=EncoderError(amplitude, draw.uniform(0, 6.28)),
    )


def time_delay(draw: Draw) -> Effect:
    usual, channel, signal = {
        "torque": (0.01, "motor_torque_nm", "motor_torque"),
        "load": (0.006, "load_position_rad", "load_position"),
    }[draw.location]
    delay = _rounded(draw.level * usual * draw.uniform(0.8, 1.2))

    def late(recording: Recording) -> Recording:
        values = np.interp(recording.time - delay, recording.time, getattr(recording, signal))
        return replace(recording, **{signal: values})

    return Effect(notes={"delay_s": delay, "channel": channel}, fault=late)


def electrical_hum(draw: Draw) -> Effect:
    frequency = float(draw.rng.choice([50.0, 60.0]))
    torque = _rounded(draw.level * 0.15 * draw.uniform(0.8, 1.2))

    def humming(recording: Recording) -> Recording:
        time = recording.time
        wave = np.sin(2 * np.pi * frequency * time + 1.0) + 0.25 * np.sin(6 * np.pi * frequency * time + 2.0)
        return replace(recording, motor_torque=recording.motor_torque + torque * wave)

    return Effect({"frequency_hz": frequency}, {"torque_n_m": torque}, fault=humming)


def clipping(draw: Draw) -> Effect:
    peak = np.abs(simulate(draw.scene, draw.axis).recording.motor_torque).max()
    limit = _rounded(peak * (1 - 0.35 * draw.level))
    return Effect(notes={"limit_n_m": limit}, torque_limit=limit)


def lost_samples(draw: Draw) -> Effect:
    share = 0.02 * draw.level
    return Effect(notes={"share": share, "how": draw.location}, loss=Loss(share, draw.location))


EFFECTS: dict[str, Callable[[Draw], Effect]] = {
    function.__name__: function
    for function in (
        backlash,
        tooth_damage,
        eccentricity,
        mesh_error,
        coulomb_friction,
        viscous_friction,
        stribeck_friction,
        friction_asymmetry,
        load_dependent_loss,
        friction_drift,
        gravity_imbalance,
        torque_ripple,
        stiffness_hardening,
        hysteresis,
        structural_resonance,
        bearing_defect,
        torque_offset,
        encoder_error,
        time_delay,
        electrical_hum,
        clipping,
        lost_samples,
    )
}
