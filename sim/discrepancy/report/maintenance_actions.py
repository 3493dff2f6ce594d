# ruff: noqa: E501
"""What to do now about a finding, and the one measurement that would settle it; for every mechanism and every fault."""

from __future__ import annotations

import math
from collections.abc import Mapping

from sim.description.axis import Axis
from sim.discrepancy.report.formatting import angle
from sim.mechanisms import MECHANISMS

OF_THE_MEASUREMENT = frozenset(name for name, kind in MECHANISMS.items() if kind.kind == "measurement")
"""Mechanisms of sensors, cables and recorders: nothing is wrong with the machine."""

BEHIND_THE_MOTOR = frozenset(
    {"backlash", "tooth_damage", "eccentricity", "mesh_error", "kinematic_error", "stiffness_hardening", "hysteresis",
     "structural_resonance", "gravity_imbalance"}
)  # fmt: skip
"""What an encoder at the load tells more of."""

BROKEN_FORM = 6.0  # of a dent, from which on it has steep edges
SURE = 0.9
SHOWN_RAD = 0.006  # to which an angle is said

ACTIONS: Mapping[str, str] = {
    "backlash": "Lock the motor, move the load by hand to and fro and read the free travel at the {where} gear; compare it with what the maker allows, and check preload, centre distance and fastening of that stage. Plan it for the next stop; sooner where the axis must hold a position.",
    "tooth_damage": "Open or look by endoscope into the {where} gear {place}, and look for steel in the oil. {urgency}",
    "eccentricity": "Put a dial gauge on the {where} gear or its shaft and turn it once: check seat, keys and bearings. At the next stop; runout wears teeth slowly.",
    "mesh_error": "Look at the contact pattern of the {where} gear pair and at its oil: worn, wrongly spaced or misaligned teeth. At the next stop.",
    "kinematic_error": "Compare it with what the maker of the {where} gear allows; if it is more, check how input shaft and gear are centred and fastened. If it was there from the beginning, enter it in the axis description.",
    "coulomb_friction": "Nothing to repair: enter the dry friction in the axis description. If it was lower when the axis was new, check seals, brake and lubrication.",
    "viscous_friction": "Nothing to repair: enter the viscous friction in the axis description. If it was lower when the axis was new, check grade and amount of grease and its temperature.",
    "stribeck_friction": "Check lubrication (grade, amount, age) and seals: at low speed the film breaks down. At the next service; enter the rise in the axis description if it was there from the beginning.",
    "friction_asymmetry": "Look for what drags one way only: a brake that rubs, a preloaded screw or seal, a cable or hose that pulls. Zero the torque channel at standstill first, as an offset looks alike.",
    "load_dependent_loss": "Check lubrication and contact pattern of the {where} gear pair, and enter its efficiency in the axis description. At the next service.",
    "friction_drift": "Warm the axis up before measuring, and log the temperature; if friction rises when warm, check preload and the amount of grease.",
    "gravity_imbalance": "Check payload, its centre of gravity and the balancer against what is described, and enter the weight in the axis description.",
    "torque_ripple": "Check calibration of current sensors and commutation of the drive; turn the motor without current by hand and feel for cogging. Not urgent.",
    "stiffness_hardening": "Nothing to repair: enter the law of the spring for the {where} gear pair. If the axis was linear before, check preload and end stops of that stage.",
    "hysteresis": "Check clamping and fastening of the {where} gear (slipping fits, loose screws) and its preload. At the next stop.",
    "bearing_defect": "Order the bearing whose data sheet has this order (it is told per turn of the motor; for a bearing on a slower shaft multiply it by the ratio up to there), listen to all bearings near the motor by stethoscope, and look for flakes in the grease; measure again in a week, and change it before the level doubles.",
    "structural_resonance": "Tighten arm, tool, covers and stand, and tap them: find the part that rings at {frequency_hz:.4g} Hz. Until then avoid motions that excite it.",
    "torque_offset": "Zero the torque channel at standstill, brake open and load balanced or without its weight; nothing is wrong with the machine.",
    "encoder_error": "Check seat, centring and coupling of the load encoder and clean its scale; nothing needs to be wrong with the machine.",
    "time_delay": "Check that all channels are sampled on one clock: filters, bus cycles and time stamps of the late channel; nothing is wrong with the machine.",
    "electrical_hum": "Check shielding and grounding of the cable and keep it away from power lines: one earth, shield on one side; nothing is wrong with the machine.",
    "clipping": "Widen the range of the channel (or lower the gain of the microphone), or accelerate less, and record again; if it is the drive's own torque limit that is reached, the motion asks too much.",
    "lost_samples": "Check load of the logger, buffers and cables of the recorder, then record again; nothing is wrong with the machine.",
}  # fmt: skip

MEASUREMENTS: Mapping[str, str] = {
    "backlash": "Block the load and let the motor push slowly to and fro: play shows as a flat middle of torque over angle, a soft spring does not.",
    "tooth_damage": "Turn the {where} gear slowly through {at} under load in both directions of torque: a damaged tooth breaks the torque down at that angle and with one direction only, an error of all teeth does so everywhere.",
    "eccentricity": "Turn the load slowly through more than one revolution in both directions: runout keeps its place on the {where} gear whatever the speed, weight changes with the position of the axis in space.",
    "mesh_error": "Repeat the motion at two thirds of the speed: what keeps its order is the teeth, what keeps its frequency is a structure.",
    "kinematic_error": "Move slowly in one direction with an encoder at the load: an error of the gear shows between both encoders at its order of the input shaft, ripple of the motor does not.",
    "coulomb_friction": "Move at three even speeds in both directions: dry friction stays the same, viscous friction grows with the speed.",
    "viscous_friction": "Move at three even speeds in both directions: viscous friction grows with the speed, dry friction stays the same.",
    "stribeck_friction": "Move at five even speeds from creeping to a third of the largest: friction that rises at low speed falls along them, stiction alone does not.",
    "friction_asymmetry": "Hold the axis at rest with the brake open and log the torque, then move at two speeds in both directions: an offset stays, friction that differs by direction does not.",
    "load_dependent_loss": "Repeat the motion without payload: a loss of the teeth shrinks with the torque, friction stays.",
    "friction_drift": "Repeat the motion after half an hour of running, with the temperature logged: heat has gone by then, wear has not.",
    "gravity_imbalance": "Hold the axis at four positions a quarter turn apart and log the torque: weight follows the sine of the angle, friction and offset do not.",
    "torque_ripple": "Repeat the motion at half the speed: ripple keeps its order of the motor, hum its frequency.",
    "stiffness_hardening": "Block the load, let the motor push slowly up to its torque limit both ways: hardening bends torque over angle at its ends, play in the middle.",
    "hysteresis": "Block the load, let the motor push slowly to and fro up to its torque limit: hysteresis opens a loop, hardening a bend, play a flat middle.",
    "bearing_defect": "Repeat the motion at two thirds of the speed with the sound: what keeps its order is the bearing, what keeps its pitch is not.",
    "structural_resonance": "Tap the arm at standstill and record the sound or the load encoder: a soft part rings at the same frequency without any motion.",
    "torque_offset": "Hold the axis at rest with the brake open and log the torque, then move at two speeds in both directions: an offset stays, friction that differs by direction does not.",
    "encoder_error": "Turn the load slowly through more than one revolution with a second encoder or a laser beside it: the encoder's error shows between the two, runout of the gear does not.",
    "time_delay": "Log one sharp step of torque with all channels at the full rate: a late channel lags by the same time at every step, a soft spring does not.",
    "electrical_hum": "Log the torque for ten seconds at standstill with the drive on: hum of the mains stays, ripple of the motor is gone.",
    "clipping": "Repeat the same motion with a wider range or half the acceleration: what happens at the largest torque was not measured.",
    "lost_samples": "Repeat the same motion without gaps: what happens in the lost rows was not measured.",
}  # fmt: skip
OTHERWISE = (
    "Look at what is described here, and change no parts on it alone.",
    "Repeat the same motion at half the speed and in both directions: what stays the same does not come from the motion.",
)
"""The same of what the catalogue does not know."""


def action(axis: Axis, mechanism: str, location: str | None, numbers: Mapping[str, float], probability: float) -> str:
    """What to do now; of a name that is not sure, to measure first."""
    text = _filled(ACTIONS.get(mechanism, OTHERWISE[0]), axis, location, numbers)
    return text if probability >= SURE else f"Measure first, as it is not sure (see the next measurement). Then: {text}"


def measurement(axis: Axis, mechanism: str, location: str | None, numbers: Mapping[str, float]) -> str:
    """The measurement that tells a mechanism from what looks like it."""
    return _filled(MEASUREMENTS.get(mechanism, OTHERWISE[1]), axis, location, numbers)


def tooth(axis: Axis, location: str | None, angle_rad: float) -> str:
    """Which tooth of a driven gear is in mesh at an angle, where its teeth are known.

    >>> from sim.description.axis import read_axis
    >>> gear = {"name": "output", "driver_teeth": 12, "driven_teeth": 150, "inertia_kg_m2": 1}
    >>> axis = read_axis({"motor": {"inertia_kg_m2": 1}, "load": {"inertia_kg_m2": 1}, "stages": [gear]})
    >>> tooth(axis, "output", 2.7)
    'tooth 65 of 150'
    """
    teeth = next((stage.driven_teeth for stage in axis.stages if stage.name == location), None)
    if not teeth:
        return ""
    place = int((angle_rad % (2.0 * math.pi)) / (2.0 * math.pi) * teeth) + 1
    return f"tooth {place} of {teeth}"


def place_of(axis: Axis, location: str | None, numbers: Mapping[str, float]) -> str:
    """Where something is: degrees, tooth and how often it comes back, or order or frequency; empty where not known."""
    out = _angle(numbers)
    if "order" in numbers:
        return f"at {numbers['order']:.3g} times per turn of the motor"
    if "frequency_hz" in numbers:
        return f"at {numbers['frequency_hz']:.4g} Hz"
    if not out or "angle_rad" not in numbers:
        return out
    if location in axis.locations and (turns := axis.ratio_from(location or "")) > 1.0 + 1e-9:
        out += f" of this gear, which comes back every {360.0 / turns:.3g}° of the load"
    counted = tooth(axis, location, numbers["angle_rad"])
    return f"{out} ({counted})" if counted else out


def _angle(numbers: Mapping[str, float]) -> str:
    if "angle_from_middle_rad" in numbers:
        return f"{angle(numbers['angle_from_middle_rad'], SHOWN_RAD)} from the middle of the travel"
    return angle(numbers["angle_rad"], SHOWN_RAD) if "angle_rad" in numbers else ""


def _filled(text: str, axis: Axis, location: str | None, numbers: Mapping[str, float]) -> str:
    place = place_of(axis, location, numbers)
    if "tooth" in place:
        place = f"{place.removesuffix(')')}, counted from the one in mesh at 0° as angles grow)"
    given = {
        "where": location or "",
        "place": f"where it is in mesh at {place}" if place else "all around, as its angle is not known",
        "at": _angle(numbers) or "a whole turn",
        "urgency": _urgency(numbers),
        "frequency_hz": numbers.get("frequency_hz", math.nan),
    }
    return " ".join(text.format(**given).split())


def _urgency(numbers: Mapping[str, float]) -> str:
    if numbers.get("form", 0.0) >= BROKEN_FORM:
        return "Before the next shift: the edges are steep, so a piece may have broken out and lie in the gear."
    if "form" in numbers:
        return "Within a week, and without raising speed or payload until then: a worn tooth breaks without further notice."
    return (
        "Within a week, and without raising speed or payload until then: how deep it is, this recording does not tell."
    )
