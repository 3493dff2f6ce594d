"""Numbers of a description against telemetry: which cannot be, what they imply, and what would be plausible."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sim.chain.model import Array
from sim.description.axis import Axis
from sim.investigation.data.data_fault import InvestigationError
from sim.investigation.data.excitation import errors_over, lacking
from sim.investigation.data.preprocessing import LEAST_ROWS, Measurement, one_body
from sim.investigation.data.sample_defects import Rows
from sim.mechanisms.mechanism import Need

SLIP = 1000.0  # mN m for N m, g for kg, mrad for rad: what a wrong prefix does to a number
LATE_ROWS = 2  # of a torque that is read and filtered after the position
LEAST_TURN = 0.5  # rad of the load over which weight shows
BEYOND = 3.0  # times what telemetry shows: a data sheet may be wrong by two
LEAST = 1.5  # rms of what is left that friction must be to be known by torque alone
FAR_BEYOND = 10.0  # the same of what is 'at most'
NEAR = 2.0  # a prefix that is set right fits as well as this
LEAST_OF_ALL = 0.05  # of the whole inertia that a motor has: less is not known from the rest
HARDLY = (
    "The torque that speeds the axis up is smaller than what is left beside it: this record does not show the inertia, "
    "and the described one was kept."
)
TURNED = (
    "motor_torque_nm: pushes against the acceleration: the sign of torque or of position is turned; turn one of them"
)
HEAVIEST = 8.0  # inertia felt over the described one, and the other way round
LIGHTEST = 1.0 / HEAVIEST


@dataclass(frozen=True)
class Seen:
    """What telemetry shows of an axis, without a model of it; of the output where nothing else is said.

    `inertia`, `coulomb`, `viscous`: of one body at the motor [kg m2], [N m], [N m s/rad]; `left`: rms of the torque
    beyond it [N m]; `body`: smallest and largest inertia that it may have, weight of the load aside or counted in,
    or of a torque that is late, None where the speed hardly changes; `torque`, `speed`: largest at the motor; `swing`:
    rms of the load's acceleration; `yields`: twist per acceleration of the load
    [s2], `soft`: the smallest and the largest that it may be, `erring`: beside an error over the load's angle; `loose`:
    range of the twist beyond that.
    """

    inertia: float
    body: tuple[float, float] | None
    coulomb: float
    viscous: float
    left: float
    torque: float
    speed: float
    swing: float
    yields: float = math.nan
    soft: tuple[float, float] = (math.nan, math.nan)
    erring: float = math.nan
    loose: float = math.nan

    @staticmethod
    def of(axis: Axis, m: Measurement, used: Rows) -> Seen:
        top = float(np.abs(m.speed).max())
        torque = _of_drive(axis, m)
        (inertia, coulomb, viscous, _), beyond = one_body(torque, m.slow_acceleration, m.speed, used)
        others = [one_body(torque, m.slow_acceleration, m.speed, used, laws)[0][0] for laws in _other_laws(axis, m)]
        others.append(one_body(np.roll(torque, -LATE_ROWS), m.slow_acceleration, m.speed, used)[0][0])
        body = _range([inertia, *others]) if Need.SEVERAL_SPEEDS not in lacking(m) else None
        largest = float(np.quantile(np.abs(m.torque[used]), 0.999))
        seen = (float(inertia), body, float(coulomb), float(viscous), float(np.std(beyond[used])), largest, top)
        swing = float(np.std(m.slow_acceleration[used])) / axis.ratio
        load = used & (m.load_valid > 0.5)
        if m.slow_load_angle is None or m.slow_load_speed is None or load.sum() < LEAST_ROWS:
            return Seen(*seen, swing)
        twist = (m.angle / axis.ratio - m.slow_load_angle)[load]
        columns = np.stack([np.gradient(m.slow_load_speed)[load] * m.rate_hz, np.ones(twist.size)], 1)
        yields = np.linalg.lstsq(columns, twist, rcond=None)[0]
        way = np.sign(m.speed)[load]
        laws = [
            np.stack([*columns.T, way, *(law[load] for law in beside)], 1) for beside in ((), *_other_laws(axis, m))
        ]
        soft = _range([yields[0], *(float(np.linalg.lstsq(c, twist, rcond=None)[0][0]) for c in laws)])
        errors = errors_over(m.slow_load_angle[load])
        erring = np.linalg.lstsq(np.stack([*columns.T, *errors], axis=1), twist, rcond=None)[0][0]
        low, high = np.quantile(twist - columns @ yields, [0.005, 0.995])
        swing = float(np.std(columns[:, 0]))
        return Seen(*seen, swing, float(yields[0]), soft, float(erring), float(high - low))


def _range(values: Iterable[float]) -> tuple[float, float]:
    values = list(map(float, values))
    return min(values), max(values)


def _other_laws(axis: Axis, m: Measurement) -> list[list[Array]]:
    """What else may explain a torque that goes with the acceleration: weight of the load, where it turns far enough."""
    known = [] if m.known_torque is None else [m.known_torque]
    laws = known + _weight(axis, m)
    return [laws] if laws else []


def _weight(axis: Axis, m: Measurement) -> list[Array]:
    """Torque of a weight at the load, two laws; none where the load does not turn far enough to show it."""
    turn = m.angle / (axis.ratio * m.gear)
    return [np.sin(turn), np.cos(turn)] if float(np.ptp(turn)) > LEAST_TURN else []


def _of_drive(axis: Axis, m: Measurement) -> Array:
    """Motor torque without what the load is known to ask for, losses left aside [N m], shape (n,)."""
    return m.torque if m.known_torque is None else m.torque - m.known_torque / axis.ratio


def check_description(axis: Axis, m: Measurement, used: Rows, unknown: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """Refuse numbers that telemetry rules out; return remarks on those that it makes unlikely.

    Raises
    ------
    InvestigationError
        naming the entry, what it implies and what would be plausible.
    """
    seen = Seen.of(axis, m, used)
    doubted = bool(m.doubts.size)  # a known torque that may be wrong may be so along the acceleration
    if unknown and not doubted:
        _check_whole(axis, seen)
    remarks = [] if unknown or doubted else _check_inertia(axis, seen)
    _check_limits(axis, seen)
    _check_friction(axis, seen)
    if math.isfinite(seen.yields):
        _check_stiffness(axis, seen)
        remarks += _check_as_new(axis, seen)
    return tuple(remarks)


def with_first_inertia(axis: Axis, m: Measurement, used: Rows) -> tuple[Axis, frozenset[str]]:
    """The axis with the inertia of its motor that torque and acceleration show where nobody knows it, and its name.

    The larger one of those that they show with weight of the load aside and counted in, which over one stroke goes with
    the acceleration: a number is looked for near its first value, and one that is too small would hold it down.
    """
    if axis.motor.inertia_kg_m2:
        return axis, frozenset()
    torque = _of_drive(axis, m)
    asides: tuple[list[Array], ...] = ([], _weight(axis, m))
    felt = max(float(one_body(torque, m.slow_acceleration, m.speed, used, aside)[0][0]) for aside in asides)
    felt = min(felt, float(np.std(torque[used])) / max(float(np.std(m.slow_acceleration[used])), 1e-300))
    beyond = sum(inertias(axis).values())
    carried = 0.0
    if m.known_torque is not None:
        (carried, *_), _ = one_body(m.known_torque / axis.ratio, m.slow_acceleration, m.speed, used)
    least = LEAST_OF_ALL * max(felt, beyond, abs(float(carried)), 1e-12)
    motor = replace(axis.motor, inertia_kg_m2=max(felt - beyond, least))
    return replace(axis, motor=motor), frozenset({"motor.inertia_kg_m2"})


def _check_limits(axis: Axis, seen: Seen) -> None:
    motor = axis.motor
    for key, limit, most, unit in (
        ("torque_limit_n_m", motor.torque_limit_n_m, seen.torque, "N m"),
        ("speed_limit_rad_s", motor.speed_limit_rad_s, seen.speed, "rad/s"),
    ):
        if most > BEYOND * limit:
            raise InvestigationError(
                f"motor.{key}: {limit:.4g} {unit}, but telemetry reaches {most:.4g} {unit}: "
                "a unit is wrong in one of them"
            )


def _frictions(axis: Axis) -> tuple[dict[str, float], dict[str, float]]:
    """Dry and viscous friction by entry, as felt at the motor [N m], [N m s/rad]."""
    n = axis.ratio
    dry = {
        "motor.coulomb_friction_n_m": axis.motor.coulomb_friction_n_m,
        "load.coulomb_friction_n_m": axis.load.coulomb_friction_n_m / n,
    }
    viscous = {
        "motor.viscous_friction_n_m_s_per_rad": axis.motor.viscous_friction_n_m_s_per_rad,
        "load.viscous_friction_n_m_s_per_rad": axis.load.viscous_friction_n_m_s_per_rad / n**2,
    }
    return dry, viscous


def _check_friction(axis: Axis, seen: Seen) -> None:
    """Friction is at most the largest torque, and no thousandth of what torque shows."""
    for entries, speed, found in zip(_frictions(axis), (1.0, seen.speed), (seen.coulomb, seen.viscous), strict=True):
        for name, value in entries.items():
            if value * speed > min(BEYOND * seen.torque, max(seen.torque, 30.0 * (abs(found) * speed + seen.left))):
                raise InvestigationError(
                    f"{name}: {_entry(axis, name):.4g} means {value * speed:.4g} N m of friction at the motor, "
                    f"{value * speed / seen.torque:.3g} times the largest torque measured ({seen.torque:.4g} N m): "
                    f"is its unit right? {_entry(axis, name) / SLIP:.4g} would be plausible"
                )
        short = _short_of(entries, found)
        if short is None or not LEAST * seen.left < found * speed < seen.torque:
            continue
        if entries["motor" + short[short.index(".") :]] > 0.0:  # else the motor's own was left out
            raise InvestigationError(
                f"{short}: {_entry(axis, short):.4g} is a thousandth of what the torque shows: is its unit right? "
                f"{_entry(axis, short) * SLIP:.4g} would be plausible; friction that is not known is left out (0)"
            )


def _short_of(entries: Mapping[str, float], found: float, near: float = NEAR) -> str | None:
    """The entry that would have to be a thousand times as large for the sum to be what was found."""
    total = sum(entries.values())
    for name, value in entries.items():
        if value > 0.0 and found > 1.5 * total and SLIP / near < (found - total + value) / value < SLIP * near:
            return name
    return None


def inertias(axis: Axis) -> dict[str, float]:
    """Inertia by entry, as felt at the motor [kg m2]."""
    out = {"motor.inertia_kg_m2": axis.motor.inertia_kg_m2}
    out |= {
        f"stages.{s.name}.inertia_kg_m2": s.inertia_kg_m2 * (axis.ratio_from(s.name) / axis.ratio) ** 2
        for s in axis.stages
    }
    return out | {"load.inertia_kg_m2": axis.load.inertia_kg_m2 / axis.ratio**2}


def _check_whole(axis: Axis, seen: Seen) -> None:
    """Of an axis whose motor's inertia nobody knows, torque must not push against an acceleration that it shows.

    What is known behind the motor must be there besides.
    """
    if seen.body is None:
        return
    behind = sum(value for name, value in inertias(axis).items() if not name.startswith("motor."))
    most = max(seen.body)
    felt = abs(most) * seen.swing * axis.ratio
    if most < 0.0 and felt > seen.left:
        raise InvestigationError(TURNED)
    if most < LIGHTEST * behind and behind * seen.swing * axis.ratio > seen.left:
        raise InvestigationError(
            f"motor_torque_nm: fits an inertia of {most:.4g} kg m2 at the motor, and the description has {behind:.4g} "
            f"kg m2 behind it: a unit is wrong (N m, rad and s are needed), or this is another axis"
        )


def _check_inertia(axis: Axis, seen: Seen) -> list[str]:
    """The inertia that torque and acceleration show must be of the order that the description says."""
    entries = inertias(axis)
    expected = sum(entries.values())
    share = seen.inertia / expected
    accelerating = seen.swing * axis.ratio * expected
    if seen.body is None:
        return [
            "The speed hardly changes in this record: it does not show the inertia, and the described one was kept. "
            "Record a motion that speeds up and slows down."
        ]
    if accelerating < 0.02 * math.hypot(seen.left, seen.torque / 3.0) and abs(share) < 30.0:
        return []
    least, most = (inertia / expected for inertia in seen.body)
    if most < -0.2:
        if max(-most * accelerating, -seen.coulomb) > seen.left:  # friction that drives is a sign that is turned, too
            raise InvestigationError(TURNED)
        return [HARDLY]
    if not (LIGHTEST <= share <= HEAVIEST) and (least <= HEAVIEST and most >= LIGHTEST):
        return [
            f"motor_torque_nm: torque and acceleration alone fit an inertia {share:.4g} times the described "
            f"{expected:.4g} kg m2; beside a weight of the load, or of a late torque, {least:.4g} to {most:.4g}."
        ]
    if share < LIGHTEST and accelerating < seen.left:  # the described one would not be seen either
        return [HARDLY]
    if share > HEAVIEST or share < LIGHTEST:
        raise InvestigationError(
            f"motor_torque_nm: fits an inertia {share:.4g} times the described {expected:.4g} kg m2: "
            f"a unit is wrong (N m, rad and s are needed), channels are swapped, or this is another axis"
            f"{_culprits(axis, entries, seen)}"
        )
    short = _short_of(entries, seen.inertia, 1.4) if axis.stages else None
    if short is None:
        return []
    return [
        f"{short}: {_entry(axis, short):.4g} kg m2 may be too small by 1000: torque and acceleration show "
        f"{seen.inertia:.4g} kg m2 at the motor, the description says {expected:.4g}."
    ]


def _culprits(axis: Axis, entries: Mapping[str, float], seen: Seen) -> str:
    """What would make inertia and torque agree, of an entry or of a channel."""
    total, found = sum(entries.values()), seen.inertia
    causes = []
    for name, value in entries.items():
        for factor in (1.0 / SLIP, SLIP):
            right = total + value * (factor - 1.0)
            if right > 0.0 and value > 0.0 and 1.0 / NEAR < found / right < NEAR:
                causes.append(f"{name} were {_entry(axis, name) * factor:.4g} instead of {_entry(axis, name):.4g}")
    for factor, torque, motion in (
        (SLIP, "smaller (is it in N mm?)", "larger"),
        (1.0 / SLIP, "larger (is it in kN m?)", "smaller (are they in mrad?)"),
    ):
        if 1.0 / NEAR < found / total / factor < NEAR:
            causes += [f"motor_torque_nm were 1000 times {torque}", f"positions were 1000 times {motion}"]
    return f"; it would fit if {', or if '.join(causes)}" if causes else ""


def _load_of(axis: Axis) -> float:
    """Inertia of load and last gear [kg m2]."""
    return axis.load.inertia_kg_m2 + sum(s.inertia_kg_m2 for s in axis.stages[-1:])


def _compliances(axis: Axis) -> dict[str, float]:
    """Compliance by entry, as felt at the output [rad/(N m)]."""
    shared = not axis.stages or any(s.stiffness_n_m_per_rad is None for s in axis.stages)
    if shared and axis.transmission.stiffness_n_m_per_rad:
        return {"transmission.stiffness_n_m_per_rad": 1.0 / axis.transmission.stiffness_n_m_per_rad}
    return {
        f"stages.{s.name}.stiffness_n_m_per_rad": 1.0 / (s.stiffness_n_m_per_rad * axis.ratio_from(s.name) ** 2)
        for s in axis.stages
        if s.stiffness_n_m_per_rad is not None
    }


def _check_stiffness(axis: Axis, seen: Seen) -> None:
    """Springs and load must twist as far as both encoders say."""
    parts, load = _compliances(axis), _load_of(axis)
    soft = sum(parts.values())
    if not parts or not seen.yields > 0.0 or load <= 0.0:
        return
    share = seen.yields / (soft * load)
    least, most = (yields / (soft * load) for yields in seen.soft)
    if least < BEYOND and most > 1.0 / BEYOND:
        return
    torque, twist = load * seen.swing, seen.yields * seen.swing
    text = (
        f"the described stiffness would twist by {torque * soft:.3g} rad (rms) under the {torque:.4g} N m that "
        f"accelerate the described load; both encoders say {twist:.3g} rad"
    )
    if 1.0 / NEAR < share / SLIP < NEAR and _short_of(inertias(axis), seen.inertia, NEAR) == "load.inertia_kg_m2":
        value = axis.load.inertia_kg_m2
        raise InvestigationError(
            f"load.inertia_kg_m2: {value:.6g} kg m2 cannot be: {text}. Is its unit right? {value * SLIP:.6g} would fit"
        )
    for name, part in parts.items():
        for factor in (SLIP, 1.0 / SLIP):
            right = soft + part * (factor - 1.0)
            if 1.0 / 1.4 < seen.yields / (right * load) < 1.4:
                value = _entry(axis, name)
                raise InvestigationError(
                    f"{name}: {value:.6g} N m/rad cannot be: {text}. Is its unit right? {value / factor:.6g} would fit"
                )
    stays = min(share, seen.erring / (soft * load))  # an error over the angle may be the rest, which none describes
    if share < 1.0 / FAR_BEYOND or stays > FAR_BEYOND:
        raise InvestigationError(
            f"{min(parts, key=lambda n: 1.0 / parts[n])}: {text}; stiffness or load.inertia_kg_m2 is wrong by far"
        )


def _check_as_new(axis: Axis, seen: Seen) -> list[str]:
    """What is as new at most must not be far more than all that both encoders and the torque show."""
    bounds = [("load_encoder.error_rad", 2.0 * axis.load_encoder.error_rad, seen.loose, "rad between both encoders")]
    for s in axis.stages:
        after = axis.ratio_from(s.name)
        bounds.append(
            (f"stages.{s.name}.backlash_rad", s.backlash_rad / after, seen.loose, "rad between both encoders")
        )
        if s.stiffness_n_m_per_rad is not None:
            wave = s.transmission_error_rad * s.stiffness_n_m_per_rad * after / axis.ratio
            name = f"stages.{s.name}.transmission_error_rad"
            bounds.append((name, wave, BEYOND * seen.left, "N m at the motor"))
    remarks = []
    for name, implied, most, what in bounds:
        if implied > BEYOND * most:
            value = _entry(axis, name)
            spring = name.replace("transmission_error_rad", "stiffness_n_m_per_rad")
            other = "" if spring == name else f", or {spring} is too large"
            text = (
                f"{name}: {value:.4g} rad as new would be {implied:.3g} {what}, where {most:.3g} are seen at most. "
                f"Is its unit right? {value / SLIP:.4g} would be plausible{other}"
            )
            if implied > FAR_BEYOND * most:
                raise InvestigationError(text)
            remarks.append(f"{text}.")
    return remarks


def _entry(axis: Axis, path: str) -> float:
    """The number that stands at a path as messages name it, `stages.NAME.key` for a stage's."""
    table, *rest = path.split(".")
    if table == "stages":
        stage = next(s for s in axis.stages if s.name == ".".join(rest[:-1]))
        return float(getattr(stage, rest[-1]))
    return float(getattr(getattr(axis, table), rest[-1]))
