# ruff: noqa: E501
"""What a finding means and what to measure next, in sentences that a technician can act on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from sim.axis import Axis
from sim.discrepancy.unexplained import Unexplained

if TYPE_CHECKING:
    from sim.discrepancy.investigation import Finding

SENTENCES: Mapping[str, str] = {
    "backlash": "The {where} gear pair has play of {gap_rad:.3g} rad: around every reversal of torque the load moves freely until the other flank meets.",
    "tooth_damage": "A flank of the {where} gear lacks material near {angle_rad:.3f} rad, {depth_rad:.2g} rad deep: torque breaks down there once per revolution, in one direction of torque.",
    "eccentricity": "The {where} gear runs out of true by {amplitude_rad:.3g} rad once per revolution.",
    "mesh_error": "The teeth of the {where} gear pair err by {amplitude_rad:.3g} rad at tooth frequency, more than as new.",
    "coulomb_friction": "Dry friction of {torque_n_m:.3g} N m as felt at the motor is missing from the description.",
    "viscous_friction": "Viscous friction of {coefficient_n_m_s_per_rad:.3g} N m s/rad as felt at the motor is missing from the description.",
    "stribeck_friction": "At low speed friction rises by {torque_n_m:.3g} N m, below about {speed_rad_s:.3g} rad/s of the motor: the lubricant film breaks down.",
    "friction_asymmetry": "Friction differs between the two directions of motion.",
    "load_dependent_loss": "The {where} gear pair loses {fraction:.1%} of the torque it transmits.",
    "friction_drift": "Friction changes by {rate_per_s:.2%} per second during the record, as when the gear warms up.",
    "gravity_imbalance": "A torque of {torque_n_m:.3g} N m pulls at the load and turns with it: weight off the axis of rotation.",
    "torque_ripple": "The motor torque ripples by {torque_n_m:.3g} N m {order:g} times per revolution of the motor.",
    "stiffness_hardening": "The {where} gear pair is stiffer at large twist than at small.",
    "hysteresis": "The {where} gear pair holds back {torque_n_m:.3g} N m when the twist turns: its spring has a loop.",
    "torque_offset": "The torque channel reads {torque_n_m:.3g} N m too much, whatever the motion.",
    "encoder_error": "The load encoder errs by {amplitude_rad:.3g} rad once per revolution, more than its data sheet says.",
    "time_delay": "A channel is late by {delay_s:.3g} s against the others.",
    "structural_resonance": "Part of the load, {share:.0%} of its inertia, swings by itself at {frequency_hz:.3g} Hz: an arm, a tool or the stand is soft or loose.",
    "electrical_hum": "A hum of {frequency_hz:g} Hz from the mains is on the torque channel.",
}  # fmt: skip


BOTTOMS = ((3.0, "round, like a worn hollow"), (6.0, "between a worn hollow and a piece broken out"))
BROKEN = "flat with steep edges, like a piece broken out"


def explain(mechanism: str, location: str | None, numbers: Mapping[str, float], elsewhere: Sequence[str] = ()) -> str:
    """Sentences with the fitted numbers; `elsewhere`: where it would explain the data as well."""
    said = [SENTENCES.get(mechanism, mechanism.replace("_", " ")).format(where=location or "", **numbers)]
    if "form" in numbers:
        bottom = next((text for below, text in BOTTOMS if numbers["form"] < below), BROKEN)
        said.append(f"Its bottom is {bottom} (form {numbers['form']:.1f}).")
    return " ".join(
        [*said, *(f"Its place is not certain: at {place} it explains the data as well." for place in elsewhere)]
    )


def next_measurement(axis: Axis, findings: Sequence[Finding], rest: Sequence[Unexplained], load_encoder: bool) -> str:
    """The one measurement that would settle most of what is open."""
    for finding in findings:
        if finding.indistinguishable_from:
            return _separate(finding.mechanism, finding.indistinguishable_from[0], load_encoder)
    if rest and not findings:
        return (
            "Repeat the same motion at half the speed: what stays at its frequency is a structure or the supply, "
            "what moves with the speed is a gear, a bearing or the motor."
        )
    if not load_encoder and axis.stages:
        return "Add an encoder at the load: without it play, eccentricity and stiffness inside the gear can hardly be told apart."
    if findings:
        return f"After the repair or after a month, repeat the same motion and compare the size of {findings[0].mechanism.replace('_', ' ')}."
    return "Nothing is open; repeat the same motion after maintenance or in half a year, and compare."


def _separate(first: str, second: str, load_encoder: bool) -> str:
    pair = {first, second}
    if pair & {"friction_asymmetry", "torque_offset"}:
        return "Hold the axis at rest with the brake open and log the torque, then move at two speeds in both directions: an offset stays, a friction that differs by direction grows with speed."
    if pair & {"backlash", "stiffness_hardening", "hysteresis"}:
        return "Block the load, let the motor push slowly to and fro up to its torque limit and log torque against angle: play shows a flat middle, hardening a bend, hysteresis a loop."
    if pair & {"eccentricity", "encoder_error", "gravity_imbalance", "mesh_error"}:
        return "Turn the load slowly through more than one revolution in both directions: an encoder's error needs no torque, eccentricity grows with speed squared, weight does not."
    if not load_encoder:
        return "Add an encoder at the load and repeat the motion: it separates what happens before and behind the gear."
    return "Repeat the motion at a third of the speed and at full speed, in both directions: friction laws differ in how they depend on speed."
