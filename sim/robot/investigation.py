"""What the rigid-body model of a robot misses: all joints together first, then each with what the others know."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version

import numpy as np
from scipy.optimize import root_scalar

from signals.telemetry import Telemetry
from sim.description.axis import MechanismEntry
from sim.investigation.assessment.calibration import WEIGHTS
from sim.investigation.assessment.intervals import NINETY
from sim.investigation.data.data_fault import InvestigationError, TooLittleMotion
from sim.investigation.investigate import investigate, telemetry_sha256
from sim.investigation.model.one_body import as_described, at_the_motor, is_one_body
from sim.investigation.report.wording import measurement_of_the_rest
from sim.investigation.results import REPORTED, Estimate, Finding, Investigation
from sim.investigation.unexplained import rounded
from sim.mechanisms import TimeDelay
from sim.robot.motion import Motion, RobotLog
from sim.robot.plausibility import check_joints, check_robot
from sim.robot.results import PAYLOAD, JointInvestigation, RobotInvestigation
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Joint, Robot, joint_words, position_key
from sim.robot.shared_fit import TILT_RAD, Late, PayloadEstimate, SharedFit, shared_fits

Progress = Callable[[str, float], None]
CLOSE_S, STEPS = 1e-4, 6  # of the secant method that finds a delay
TILTED = 3.0  # standard deviations from which the base is said to stand askew
NOT_ITS_TORQUE = (
    "The torque of this joint is not what the robot asks for along this motion: its unit, factor or sign may be "
    "wrong. The other joints were examined without it."
)
DEAD = "motor_torque_nm: has the same value in all rows. The other joints were examined without it."
HELD = "The joint was held still: its friction and its drive are not known."
BRIEFLY = "The joint moved too briefly: its friction and its drive are not known."


def investigate_robot(
    robot: Robot, logs: Sequence[RobotLog], progress: Progress = lambda stage, share: None
) -> RobotInvestigation:
    """Hold a log of all joints against the robot's description.

    Of several logs of the same robot the last is investigated; what the joints share is fitted over all of them, the
    payload for each of its own. A joint whose torque says nothing is unusable, and moves the others all the same.

    Raises
    ------
    InvestigationError
        for data that cannot be what they claim; the text says what would be right.
    AxisError
        for a description of which no rigid body can be made.
    """
    if not logs:
        raise InvestigationError("nothing to investigate: a robot needs telemetry of its joints")
    progress("rigid body", 0.02)
    described, robot = [_described_delay(joint) for joint in robot.joints], _without_delays(robot)
    logs = [replace(log, joints=tuple(map(_earlier, log.joints, described))) for log in logs]
    body = RigidBody.of(robot)
    check_joints(robot, body)
    motions = [Motion.of(robot, log.joints) for log in logs]
    dead = motions[-1].unmeasured
    motions = [motion.without_torque(check_robot(robot, body, motion)) for motion in motions]
    progress("what the joints share", 0.08)
    fits, late = _in_time(robot, body, motions, [0.5 / log.joints[0].sample_rate_hz for log in logs])
    shared, log, delays = fits[-1], logs[-1], late[-1]
    joints = []
    for k, (joint, telemetry) in enumerate(zip(robot.joints, log.joints, strict=True)):
        if k in shared.motion.unmeasured:
            why = log.unusable.get(joint.name, DEAD if k in dead else NOT_ITS_TORQUE)
            one = replace(_not_examined(joint, why), verdict="unusable")
        else:
            watch = partial(_within, progress, joint.name, k, len(robot.joints))
            by_s = delays[k].delay_s if k in delays else 0.0
            one = _late(_of_joint(joint, _earlier(telemetry, by_s), shared, k, watch), delays.get(k), described[k])
        joints.append(JointInvestigation(joint.name, _in_its_words(robot, k, one)))
    if not any(joint.investigation.selection for joint in joints):
        reasons = "; ".join(f"{joint.name}: {joint.investigation.remarks[0]}" for joint in joints)
        raise InvestigationError(f"telemetry: no joint can be examined. {reasons}")
    payload = _payload_finding(robot, shared.payload)
    found = [f for joint in joints for f in joint.investigation.findings] + ([] if payload is None else [payload])
    rest = any(joint.investigation.unexplained is not None for joint in joints)
    verdict = "named" if any(f.probability >= REPORTED for f in found) else "unnamed" if rest else "nothing_missing"
    progress("done", 1.0)
    return RobotInvestigation(
        robot, verdict, payload, tuple(joints), shared, _payload_parameters(robot, shared),
        _next_measurement(joints, shared), _provenance(robot, logs, shared),
        tuple(_remarks(robot, body, logs, shared)),
    )  # fmt: skip


def _in_time(
    robot: Robot, body: RigidBody, motions: Sequence[Motion], half_s: Sequence[float]
) -> tuple[tuple[SharedFit, ...], list[dict[int, Late]]]:
    """What the joints share once torques that are late by themselves are back in time, and those of each log.

    The likeliest first: what it leaves in the others looks like delays, too. What does not converge is none, and what
    wants to be later than any delay. `half_s`: half a row of each log; channels are read one after the other.
    """
    late: list[dict[int, Late]] = [{} for _ in motions]
    none: set[tuple[int, int]] = set()
    fits = shared_fits(robot, body, motions)
    for _ in robot.joints:
        found = [
            (one.probability, k, j)
            for k, fit in enumerate(fits)
            for j, one in enumerate(fit.late)
            if one.probability >= REPORTED and abs(one.delay_s) > half_s[k]
            if j not in late[k] and (k, j) not in none
        ]
        if not found:
            break
        _, k, j = max(found)
        by_s, moved, then = _followed(robot, body, motions, fits, k, j)
        one = fits[k].late[j].found_at(by_s, then[k].late[j].deviation_s)
        if by_s and one.probability >= REPORTED and one.is_delay(2.0 * half_s[k]):
            late[k][j], motions, fits = one, moved, then
        else:
            none.add((k, j))
    return fits, late


def _followed(
    robot: Robot, body: RigidBody, motions: Sequence[Motion], fits: tuple[SharedFit, ...], k: int, j: int
) -> tuple[float, Sequence[Motion], tuple[SharedFit, ...]]:
    """The delay of joint `j` in log `k` [s], 0 where none is found; motions and fits with its torque earlier by that.

    By the secant method, since a torque bends within a delay, and friction that is late looks as if it built up while
    friction that is early looks like nothing else.
    """
    tried = {0.0: (motions, fits)}

    def left_s(by_s: float) -> float:
        """By how much it is still late [s]."""
        if by_s not in tried:
            moved = [*motions[:k], motions[k].with_earlier_torque(j, by_s), *motions[k + 1 :]]
            tried[by_s] = moved, shared_fits(robot, body, moved)
        return tried[by_s][1][k].late[j].delay_s

    found = root_scalar(left_s, method="secant", x0=0.0, x1=left_s(0.0), xtol=CLOSE_S, maxiter=STEPS)
    by_s = float(found.root) if found.converged else 0.0
    left_s(by_s)
    return by_s, *tried[by_s]


def _described_delay(joint: Joint) -> float:
    """By how much the torque of a joint is described to be late [s]."""
    return sum(e.parameters["delay_s"] for e in joint.axis.mechanisms if e.name == TimeDelay.name)


def _without_delays(robot: Robot) -> Robot:
    """The robot as it is once its torques are where they belong."""

    def plain(joint: Joint) -> Joint:
        rest = tuple(e for e in joint.axis.mechanisms if e.name != TimeDelay.name)
        return replace(joint, axis=replace(joint.axis, mechanisms=rest))

    return replace(robot, joints=tuple(map(plain, robot.joints)))


def _earlier(telemetry: Telemetry, by_s: float) -> Telemetry:
    """With the torque where it belongs."""
    if not by_s or "motor_torque_nm" not in telemetry:
        return telemetry
    torque = np.interp(telemetry.time_s + by_s, telemetry.time_s, telemetry["motor_torque_nm"])
    return replace(telemetry, channels={**telemetry.channels, "motor_torque_nm": torque})


def _late(one: Investigation, late: Late | None, described_s: float) -> Investigation:
    """With the delay of its torque beyond that described as a finding."""
    if total_s := described_s + (late.delay_s if late else 0.0):
        entry = MechanismEntry(TimeDelay.name, "motor", {"delay_s": total_s})
        one = replace(one, extended=replace(one.extended, mechanisms=(*one.extended.mechanisms, entry)))
    if late is None:
        return one
    half = NINETY * late.deviation_s
    numbers = (Estimate("delay_s", late.delay_s, "s", late.delay_s - half, late.delay_s + half),)
    finding = Finding(
        TimeDelay.name, "motor", min(late.probability, WEIGHTS.cap), numbers, (),
        f"The torque of this joint is {abs(late.delay_s):.2g} s {'later' if late.delay_s > 0.0 else 'earlier'} in the "
        "log than its motion and the torques of the other joints.",
        action=TimeDelay.action,
    )  # fmt: skip
    return replace(one, verdict="named", findings=(*one.findings, finding))


def _within(progress: Progress, joint: str, place: int, joints: int, stage: str, share: float) -> None:
    """How far the whole is, by how far one joint is."""
    progress(f"joint {place + 1} of {joints}, {joint}", 0.15 + 0.8 * (place + share) / joints)


def _of_joint(joint: Joint, telemetry: Telemetry, shared: SharedFit, place: int, progress: Progress) -> Investigation:
    """One joint, whose load asks for what the rigid body does besides the inertia that its description has."""
    motion, axis = shared.motion, joint.axis
    if not motion.moves[place]:
        return _not_examined(joint, HELD)
    load, ratio, felt_at = axis.load.inertia_kg_m2, axis.ratio, 1.0
    if as_one_body := is_one_body(axis, telemetry):
        axis, load, felt_at = at_the_motor(axis), 0.0, ratio
    elif axis.stages and not load:
        raise InvestigationError(
            f"{joint.name}: load.inertia_kg_m2 of its axis has to be above 0: about what the spring of its gears moves"
        )
    telemetry = _counting(telemetry, motion)
    known = shared.known[:, place] - load * motion.acceleration[:, place]
    known, doubts = (motion.on(each, telemetry.time_s) / felt_at for each in (known, shared.errors[place]))
    channels = {**telemetry.channels, "known_torque_nm": known}
    if "motor_position_rad" not in channels:
        channels["motor_position_rad"] = channels["load_position_rad"] * ratio
    try:
        one = investigate(
            axis, replace(telemetry, channels=channels), progress=progress, known_doubts=doubts, gear=felt_at
        )
    except TooLittleMotion:
        return _not_examined(joint, BRIEFLY)
    except InvestigationError as error:
        return replace(_not_examined(joint, str(error)), verdict="unusable")
    return replace(one, extended=as_described(joint.axis, one.extended)) if as_one_body else one


def _in_its_words(robot: Robot, place: int, one: Investigation) -> Investigation:
    """The investigation of a joint in its units, and without a motor where none is described."""
    said = partial(joint_words, robot, place)

    def in_units(estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
        return tuple(replace(e, unit=said(e.unit)) for e in estimates)

    findings = tuple(
        replace(f, explanation=said(f.explanation), parameters=in_units(f.parameters)) for f in one.findings
    )
    return replace(
        one, findings=findings, parameters=in_units(one.parameters),
        gain=tuple(replace(g, unit=said(g.unit)) for g in one.gain), next_measurement=said(one.next_measurement),
    )  # fmt: skip


def _not_examined(joint: Joint, why: str) -> Investigation:
    """A joint of which no model is made: it counts in the torques of the others, and nothing is told of its own."""
    return Investigation(
        joint.axis, "nothing_missing", (), None, (), (), "Move this joint, too.", joint.axis, {}, remarks=(why,)
    )


def _counting(telemetry: Telemetry, motion: Motion) -> Telemetry:
    """From the first to the last row that counts; those between that do not are lost."""
    counting = motion.time_s[motion.counts]
    kept = (telemetry.time_s >= counting[0]) & (telemetry.time_s <= counting[-1])
    time_s = telemetry.time_s[kept]
    unknown = np.interp(time_s, motion.time_s, motion.counts.astype(float)) < 0.5
    lost = {name: gone[kept] for name, gone in telemetry.lost.items()}
    if unknown.any():
        lost["motor_torque_nm"] = unknown | lost.get("motor_torque_nm", False)
    return replace(
        telemetry, time_s=time_s, channels={name: v[kept] for name, v in telemetry.channels.items()}, lost=lost
    )


def _payload_numbers(robot: Robot, payload: PayloadEstimate) -> tuple[Estimate, ...]:
    """Mass and centre of all that hangs, with intervals of 90 %."""
    described, at = robot.payload.mass_kg, np.array(robot.payload.center_m)
    mass = payload.mass_kg + described
    first = payload.numbers[1:] + described * at
    half = NINETY * payload.mass_deviation_kg
    out = [Estimate("mass_kg", mass, "kg", mass - half, mass + half, described or None)]
    for k, way in enumerate("xyz"):
        center = float(first[k]) / mass if mass else 0.0
        slope = np.array([-center, *np.eye(3)[k]]) / (mass or 1.0)
        half = NINETY * math.sqrt(max(float(slope @ payload.covariance @ slope), 0.0))
        out.append(Estimate(f"center_{way}_m", center, "m", center - half, center + half))
    return tuple(out)


def _payload_finding(robot: Robot, payload: PayloadEstimate) -> Finding | None:
    """A payload that the description lacks."""
    if robot.payload.mass_kg or payload.probability < REPORTED or payload.mass_kg <= 0.0:
        return None
    return Finding(
        PAYLOAD, PAYLOAD, payload.probability, _payload_numbers(robot, payload), (),
        f"{payload.mass_kg:.3g} kg hang at the flange that the description does not have.",
        action="Look what hangs at the flange. If it belongs there, enter its mass and centre in the robot's "
        "description, and in the controller.",
    )  # fmt: skip


def _payload_parameters(robot: Robot, shared: SharedFit) -> tuple[Estimate, ...]:
    """Of a payload that is described, as it was found."""
    if not robot.payload.mass_kg:
        return ()
    numbers = _payload_numbers(robot, shared.payload)
    nominal = (robot.payload.mass_kg, *robot.payload.center_m)
    return tuple(replace(e, name=f"payload.{e.name}", nominal=n) for e, n in zip(numbers, nominal, strict=True))


def _remarks(robot: Robot, body: RigidBody, logs: Sequence[RobotLog], shared: SharedFit) -> list[str]:
    """How the log was read, and what of the description was completed, mended or seems to be off."""
    out = [f"The log was read as:\n{text}" for text in dict.fromkeys(log.recognised for log in logs) if text]
    if robot.held:
        places = [f"{name} at {at:.4g} {position_key(robot.urdf, name)[9:]}" for name, at in robot.held.items()]
        out.append(f"Not logged, and held still as the robot's description says: {', '.join(places)}.")
    if weightless := [name for name, own in zip(body.links, body.parameters, strict=True) if own[0] <= 0.0]:
        out.append(f"Without a mass in the URDF, and taken to weigh nothing: {', '.join(weightless)}.")
    if robot.urdf.mended:
        out.append(
            "The inertia in the URDF is none that a body can have, and the least that it can have was taken instead, "
            f"of: {', '.join(robot.urdf.mended)}."
        )
    tilt = float(np.linalg.norm(shared.tilt_rad))
    if tilt >= TILT_RAD and np.any(np.abs(shared.tilt_rad) > TILTED * shared.tilt_deviation_rad):
        out.append(
            f"Gravity seems to pull {math.degrees(tilt):.2g} degrees off the direction described: the base may stand "
            "askew, or masses of the links are off in a way that looks like it."
        )
    return out


def _next_measurement(joints: Sequence[JointInvestigation], shared: SharedFit) -> str:
    """What the joint that is least understood asks for."""
    unsure = [j for j in joints if j.investigation.verdict == "unnamed"] or [
        j for j in joints if any(f.probability < 0.9 for f in j.investigation.findings)
    ]
    if unsure:
        return f"{unsure[0].name}: {unsure[0].investigation.next_measurement}"
    if 0.05 < shared.payload.probability < 0.9:
        return "Record the same motion once with nothing at the flange: the difference is what hangs there."
    for joint in joints:
        if joint.investigation.unexplained is not None:
            return f"{joint.name}: {measurement_of_the_rest(joint.investigation.unexplained)}"
    return "No further measurement is needed for what was found; record the same motion again to see what changes."


def _provenance(robot: Robot, logs: Sequence[RobotLog], shared: SharedFit) -> dict[str, object]:
    return {
        "gearcase": version("gearcase"),
        "method": "rigid body, shared fit, guided chain 1",
        "robot": robot.name,
        "urdf_sha256": hashlib.sha256(robot.urdf.text.encode()).hexdigest(),
        "telemetry_sha256": telemetry_sha256(telemetry for log in logs for telemetry in log.joints),
        "logs": [log.name for log in logs],
        "rows": int(logs[-1].joints[0].rows),
        "rate_hz": rounded(logs[-1].joints[0].sample_rate_hz),
        "payload_probability": round(shared.payload.probability, 4),
    }
