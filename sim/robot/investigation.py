"""What the rigid-body model of a robot misses: all joints together first, then each with what the others know."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib.metadata import version

import numpy as np
from scipy.optimize import root_scalar

from casebase.signals.telemetry import Telemetry
from sim.description.axis import MechanismEntry
from sim.discrepancy.assessment.calibration import WEIGHTS
from sim.discrepancy.assessment.intervals import NINETY
from sim.discrepancy.data.data_fault import InvestigationError, TooLittleMotion
from sim.discrepancy.investigation import investigate, telemetry_sha256
from sim.discrepancy.model.one_body import as_described, at_the_motor, is_one_body
from sim.discrepancy.next_measurement.advice import of_a_joint
from sim.discrepancy.report.wording import telling_what_is_left
from sim.discrepancy.results import SAID, Estimate, Finding, Investigation
from sim.discrepancy.unexplained import rounded
from sim.mechanisms import LostSamples, TimeDelay
from sim.robot.motion import Motion
from sim.robot.plausibility import check_joints, check_robot
from sim.robot.results import PAYLOAD, JointInvestigation, RobotInvestigation
from sim.robot.rigid_body import RigidBody
from sim.robot.robot import Joint, Robot, position_key, slides
from sim.robot.shared_fit import TILT_RAD, Late, PayloadEstimate, SharedFit, shared_fits
from sim.robot.sliding import sliding_words

Progress = Callable[[str, float], None]
CLOSE_S, STEPS = 1e-4, 6  # of the secant method that finds a delay
TILTED = 3.0  # standard deviations from which the base is said to stand askew
LEAST_SHARE = 0.1  # of variance explained: an interval is ten times as wide at most
NOT_ITS_TORQUE = (
    "The torque of this joint is not what the robot asks for along this motion: its unit, factor or sign may be "
    "wrong. The other joints were examined without it."
)
HELD = "The joint was held still: nothing is told of its friction and its drive."
BRIEFLY = "The joint moved too briefly: nothing is told of its friction and its drive."


@dataclass(frozen=True)
class RobotLog:
    """One log of a robot: telemetry of each joint, in the joints' order, over one clock.

    `recognised`: the channel map that reading it amounted to, where the columns were recognised; else empty.
    `unusable`: why the torque of a joint could not be read, by its name.
    """

    name: str
    joints: tuple[Telemetry, ...]
    recognised: str = ""
    unusable: Mapping[str, str] = field(default_factory=dict)


def investigate_robot(
    robot: Robot, logs: Sequence[RobotLog], progress: Progress = lambda stage, share: None
) -> RobotInvestigation:
    """Hold a log of all joints against the robot's description.

    Of several logs of the same robot the last is investigated; what the joints share is fitted over all of them, the
    payload for each of its own.

    Raises
    ------
    InvestigationError
        for data that cannot be what they claim; the text says what would be right.
    RobotError
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
    motions = [motion.without_torque(check_robot(robot, body, motion)) for motion in motions]
    progress("what the joints share", 0.08)
    fits, late = _in_time(robot, body, motions, [0.5 / log.joints[0].sample_rate_hz for log in logs])
    shared, count = fits[-1], len(robot.joints)
    log, delays = logs[-1], late[-1]
    joints = []
    for k, (joint, telemetry) in enumerate(zip(robot.joints, log.joints, strict=True)):
        watch = partial(_within, progress, f"joint {k + 1} of {count}, {joint.name}", k, count)
        late_s = delays[k].delay_s if k in delays else 0.0
        if k not in shared.motion.unmeasured:
            one = _of_joint(joint, _earlier(telemetry, late_s), shared, k, watch)
            one = less_sure(_late(one, delays.get(k), described[k]))
        else:
            one = replace(_untold(joint, log.unusable.get(joint.name, NOT_ITS_TORQUE)), verdict="unusable")
        joints.append(JointInvestigation(joint.name, in_metres(one) if slides(robot, k) else one))
    if all(joint.investigation.verdict == "unusable" or _is_untold(joint.investigation) for joint in joints):
        raise InvestigationError(
            "telemetry: all joints move too briefly; a longer record of the robot in motion is needed"
        )
    joints, remarks = _of_log(joints)
    payload = _payload_finding(robot, logs, fits)
    found = [f for joint in joints for f in joint.investigation.findings] + ([] if payload is None else [payload])
    rest = any(joint.investigation.unexplained is not None for joint in joints)
    verdict = "named" if any(f.probability >= SAID for f in found) else "unnamed" if rest else "nothing_missing"
    progress("done", 1.0)
    return RobotInvestigation(
        robot, verdict, payload, tuple(joints), shared, _payload_parameters(robot, shared),
        _next_measurement(joints, shared), _provenance(robot, logs, shared),
        (
            *_recognised(logs), *_taken_as_held(robot), *_weightless(body), *_mended(robot), *_tilt_remarks(shared),
            *_earlier_payloads(logs, fits),
            *remarks,
        ),
    )  # fmt: skip


def _in_time(
    robot: Robot, body: RigidBody, motions: Sequence[Motion], half_s: Sequence[float]
) -> tuple[tuple[SharedFit, ...], list[dict[int, Late]]]:
    """What the joints share once torques that are late by themselves are back in time, and those of each log.

    The likeliest first: what it leaves in the others looks like delays, too. By the secant method, since a torque bends
    within a delay, and friction that is late looks as if it built up while friction that is early looks like nothing
    else. What does not converge and what wants to be later than any delay is none. `half_s`: half a row of each log;
    channels are read one after the other.
    """
    late: list[dict[int, Late]] = [{} for _ in motions]
    none: set[tuple[int, int]] = set()
    fits = shared_fits(robot, body, motions)
    for _ in robot.joints:
        found = [
            (one.probability, k, j)
            for k, fit in enumerate(fits)
            for j, one in enumerate(fit.late)
            if one.probability >= SAID and abs(one.delay_s) > half_s[k]
            if j not in late[k] and (k, j) not in none
        ]
        if not found:
            break
        _, k, j = max(found)
        first = fits[k].late[j]
        earlier = _Earlier(robot, body, motions, k, j, {0.0: fits})
        found_s = root_scalar(earlier.left_s, method="secant", x0=0.0, x1=first.delay_s, xtol=CLOSE_S, maxiter=STEPS)
        by_s = float(found_s.root)
        if found_s.converged:
            one = first.found_at(by_s, earlier.fitted(by_s)[k].late[j].deviation_s)
            if one.probability >= SAID and one.is_delay(2.0 * half_s[k]):
                late[k][j], motions, fits = one, earlier.motions(by_s), earlier.fitted(by_s)
                continue
        none.add((k, j))
    return fits, late


@dataclass(frozen=True)
class _Earlier:
    """The logs with the torque of one joint of one of them earlier; `fits`: what the joints share, by how much [s]."""

    robot: Robot
    body: RigidBody
    logs: Sequence[Motion]
    log: int
    joint: int
    fits: dict[float, tuple[SharedFit, ...]]

    def motions(self, by_s: float) -> list[Motion]:
        moved = self.logs[self.log].with_earlier_torque(self.joint, by_s)
        return [moved if place == self.log else m for place, m in enumerate(self.logs)]

    def fitted(self, by_s: float) -> tuple[SharedFit, ...]:
        if by_s not in self.fits:
            self.fits[by_s] = shared_fits(self.robot, self.body, self.motions(by_s))
        return self.fits[by_s]

    def left_s(self, by_s: float) -> float:
        """By how much it is still late [s]."""
        return self.fitted(by_s)[self.log].late[self.joint].delay_s


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


def less_sure(one: Investigation) -> Investigation:
    """What is found at a joint rests on the share of its torque's variance that the model explains on rows that it has
    not seen (coefficient of determination): names are so much less sure, intervals as much wider. Where unused rows do
    not show that anything was gained, names are no likelier than not."""
    torque = next((g for g in one.gain if g.channel == "motor_torque_nm"), None)
    if torque is None or not torque.rms_measured:
        return one
    explained = 1.0 - min(torque.rms_after / torque.rms_measured, 1.0) ** 2
    share = explained if torque.significant else min(explained, 0.5)

    def wider(e: Estimate) -> Estimate:
        low, high = (e.value + (end - e.value) / max(share, LEAST_SHARE) for end in (e.low, e.high))
        return replace(e, low=low, high=high)

    findings = tuple(
        replace(f, probability=f.probability * share, parameters=tuple(map(wider, f.parameters))) for f in one.findings
    )
    verdict = one.verdict
    if verdict == "named" and not any(f.probability >= SAID for f in findings):
        verdict = "unnamed"
    return replace(one, findings=findings, parameters=tuple(map(wider, one.parameters)), verdict=verdict)


def _within(progress: Progress, name: str, place: int, joints: int, stage: str, share: float) -> None:
    """How far the whole is, by how far one joint is."""
    progress(name, 0.15 + 0.8 * (place + share) / joints)


def _of_joint(joint: Joint, telemetry: Telemetry, shared: SharedFit, place: int, progress: Progress) -> Investigation:
    """One joint, whose load asks for what the rigid body does besides the inertia that its description has."""
    motion, axis = shared.motion, joint.axis
    if not motion.moves[place]:
        return _untold(joint, HELD)
    load, ratio, told = axis.load.inertia_kg_m2, axis.ratio, axis
    if as_one_body := is_one_body(axis, telemetry):
        axis, load = at_the_motor(axis), 0.0
    elif axis.stages and not load:
        raise InvestigationError(
            f"{joint.name}: load.inertia_kg_m2 of its axis has to be above 0: about what the spring of its gears moves"
        )
    telemetry = _counting(telemetry, motion)
    known = shared.known[:, place] - load * motion.acceleration[:, place]
    doubts = motion.on(shared.errors[place], telemetry.time_s)
    known = motion.on(known, telemetry.time_s)
    channels = {**telemetry.channels}
    if "motor_position_rad" not in channels:
        channels["motor_position_rad"] = channels["load_position_rad"] * ratio
    if as_one_body:
        known, doubts = known / ratio, doubts / ratio
    channels["known_torque_nm"] = known
    try:
        one = investigate(
            axis,
            replace(telemetry, channels=channels),
            progress=progress,
            known_doubts=doubts,
            gear=ratio if as_one_body else 1.0,
        )
    except TooLittleMotion:
        return _untold(joint, BRIEFLY)
    except InvestigationError as error:
        raise InvestigationError(f"{joint.name}: {error}") from None
    moved = "motor" if told.stages else "joint"
    if advice := of_a_joint(one.next_measurements, moved):
        one = replace(one, next_measurement=advice if axis.stages else _of_one_body(advice, moved))
    if as_one_body:
        return replace(one, extended=as_described(told, one.extended))
    return one if joint.described else replace(one, findings=tuple(map(_of_the_joint, one.findings)))


def in_metres(one: Investigation) -> Investigation:
    """The investigation of a joint that slides in its units."""
    findings = tuple(
        replace(f, explanation=sliding_words(f.explanation), parameters=tuple(map(_in_metres, f.parameters)))
        for f in one.findings
    )
    gain = tuple(replace(g, unit=sliding_words(g.unit)) for g in one.gain)
    return replace(
        one, findings=findings, parameters=tuple(map(_in_metres, one.parameters)), gain=gain,
        next_measurement=sliding_words(one.next_measurement),
    )  # fmt: skip


def _in_metres(estimate: Estimate) -> Estimate:
    return replace(estimate, unit=sliding_words(estimate.unit))


def _of_the_joint(finding: Finding) -> Finding:
    """In the words of a joint whose drive is not described: there is no motor that turns otherwise."""
    words = finding.explanation.replace("at the motor", "at the joint").replace("of the motor", "of the joint")
    return replace(finding, explanation=words)


def _of_one_body(advice: str, moved: str) -> str:
    """Advice for a joint that is one body: there is no place in it, and no load apart.

    >>> _of_one_body("Reach 2 rad/s of the load. That tells drift from stribeck friction at motor.", "joint")
    'Reach 2 rad/s of the joint. That tells drift from stribeck friction.'
    """
    return advice.replace(" at motor", "").replace(" at load", "").replace("the load", f"the {moved}")


def _untold(joint: Joint, why: str) -> Investigation:
    """A joint that moved too little: it counts in the torques of the others, and nothing is told of its own."""
    return Investigation(
        joint.axis, "nothing_missing", (), None, (), (), "Move this joint, too.", joint.axis, {}, remarks=(why,)
    )


def _is_untold(one: Investigation) -> bool:
    return HELD in one.remarks or BRIEFLY in one.remarks


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


def _of_log(joints: Sequence[JointInvestigation]) -> tuple[list[JointInvestigation], list[str]]:
    """Joints without faults of the log, and a remark for each that most joints show.

    A row that a logger leaves out or repeats, it does so of all joints: what few of them show is chance.
    """
    moved = [joint for joint in joints if not _is_untold(joint.investigation)]
    told = [f for joint in moved for f in joint.investigation.findings if _is_of_the_log(f)]
    out = []
    for joint in joints:
        kept = tuple(f for f in joint.investigation.findings if not _is_of_the_log(f))
        verdict = joint.investigation.verdict
        if verdict == "named" and not any(f.probability >= SAID for f in kept):
            verdict = "unnamed" if joint.investigation.unexplained is not None else "nothing_missing"
        out.append(replace(joint, investigation=replace(joint.investigation, findings=kept, verdict=verdict)))
    remarks = [f"The log of all joints: {told[0].explanation}"] if 2 * len(told) > len(moved) else []
    return out, remarks


def _is_of_the_log(finding: Finding) -> bool:
    return finding.mechanism == LostSamples.name and finding.location is None


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


def _payload_finding(robot: Robot, logs: Sequence[RobotLog], fits: Sequence[SharedFit]) -> Finding | None:
    """A payload that the description lacks, in the last log that has one."""
    if robot.payload.mass_kg:
        return None
    for log, shared in reversed(list(zip(logs, fits, strict=True))):
        payload = shared.payload
        if payload.probability < SAID or payload.mass_kg <= 0.0:
            continue
        numbers = _payload_numbers(robot, payload)
        whose = f" in {log.name}" if len(logs) > 1 else ""
        return Finding(
            PAYLOAD, PAYLOAD, payload.probability, numbers, (),
            f"{payload.mass_kg:.3g} kg hang at the flange{whose} that the description does not have.",
            action="Look what hangs at the flange. If it belongs there, enter its mass and centre in the "
            "robot's description, and in the controller.",
        )  # fmt: skip
    return None


def _payload_parameters(robot: Robot, shared: SharedFit) -> tuple[Estimate, ...]:
    """Of a payload that is described, as it was found."""
    if not robot.payload.mass_kg:
        return ()
    numbers = _payload_numbers(robot, shared.payload)
    nominal = (robot.payload.mass_kg, *robot.payload.center_m)
    return tuple(replace(e, name=f"payload.{e.name}", nominal=n) for e, n in zip(numbers, nominal, strict=True))


def _earlier_payloads(logs: Sequence[RobotLog], fits: Sequence[SharedFit]) -> list[str]:
    if len(logs) < 2:
        return []
    return [
        f"{log.name}: {fit.payload.mass_kg:.3g} kg beyond the description hang at the last link, "
        f"give or take {NINETY * fit.payload.mass_deviation_kg:.2g} kg (90 %)."
        for log, fit in zip(logs, fits, strict=True)
    ]


def _recognised(logs: Sequence[RobotLog]) -> list[str]:
    """How logs without a channel map were read, once where it is the same for all."""
    return [f"The log was read as:\n{text}" for text in dict.fromkeys(log.recognised for log in logs) if text]


def _taken_as_held(robot: Robot) -> list[str]:
    """Joints that are not logged, where robot.toml says that they were."""
    if not robot.held:
        return []
    places = [
        f"{name} at {at:.4g} {position_key(robot.urdf, name).rpartition('_')[2]}" for name, at in robot.held.items()
    ]
    return [f"Not logged, and held still as the robot's description says: {', '.join(places)}."]


def _weightless(body: RigidBody) -> list[str]:
    """Links that move and have no mass, as frames do and as a link has of which the maker says nothing."""
    names = [name for name, own in zip(body.links, body.parameters, strict=True) if own[0] <= 0.0]
    if not names:
        return []
    return [f"Without a mass in the URDF, and taken to weigh nothing: {', '.join(names)}."]


def _mended(robot: Robot) -> list[str]:
    """Links whose inertia was made one that a body can have."""
    if not robot.urdf.mended:
        return []
    return [
        "The inertia in the URDF is none that a body can have, and the least that it can have was taken instead, of: "
        f"{', '.join(robot.urdf.mended)}."
    ]


def _tilt_remarks(shared: SharedFit) -> list[str]:
    tilt = float(np.linalg.norm(shared.tilt_rad))
    if tilt < TILT_RAD or not np.any(np.abs(shared.tilt_rad) > TILTED * shared.tilt_deviation_rad):
        return []
    degrees = math.degrees(tilt)
    return [
        f"Gravity seems to pull {degrees:.2g} degrees off the direction described: the base may stand askew, or masses "
        "of the links are off in a way that looks like it."
    ]


def _next_measurement(joints: Sequence[JointInvestigation], shared: SharedFit) -> str:
    """What the joint that is least understood asks for."""
    unsure = [j for j in joints if j.investigation.verdict == "unnamed"] or [
        j for j in joints if any(f.probability < 0.9 for f in j.investigation.findings)
    ]
    left = [(j.name, j.investigation.unexplained) for j in joints if j.investigation.unexplained is not None]
    if not unsure and 0.05 < shared.payload.probability < 0.9:
        return (
            "Record the same motion once with nothing at the flange: then what hangs there is told by the difference."
        )
    if not unsure and left:
        return f"{left[0][0]}: {telling_what_is_left(left[0][1])}"
    if not unsure:
        return "No further measurement is needed for what was found; record the same motion again to see what changes."
    return f"{unsure[0].name}: {unsure[0].investigation.next_measurement}"


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
