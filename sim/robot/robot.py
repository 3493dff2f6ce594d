"""A robot as its maker describes it: links and joints (URDF), which joints are logged, and what hangs at the flange."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from signals.columns.joint_maps import LoggedJoint
from signals.errors import TextError
from signals.reading.documents import parse_document
from signals.reading.plain_file import plain_bytes
from sim.description.axis import Axis, Load, Motor
from sim.description.axis_document import read_axis
from sim.errors import AxisError, number, shown
from sim.robot.urdf import Urdf, read_urdf

SCHEMA = "gearcase-robot/1"
GRAVITY_M_S2 = (0.0, 0.0, -9.81)
MOST_JOINTS = 64
LARGEST_URDF_BYTES = 4 << 20
Vector = tuple[float, float, float]
SLIDING = (
    ("N m s/rad", "N s/m"), ("N m", "N"), ("rad/s", "m/s"), ("kg m2", "kg"), ("torque", "force"), ("angle", "position"),
    ("[°]", "[m]"),
)  # fmt: skip
WITHOUT_MOTOR = (
    ("of the motor", "of the joint"), ("at the motor", "at the joint"), ("of motor", "of the joint"),
    ("of load", "of the joint"), ("motor torque", "torque of the joint"), ("motor ahead", "joint ahead"),
)  # fmt: skip
"""Where nothing turns otherwise than the joint."""


@dataclass(frozen=True)
class Payload:
    """What hangs at the link that the logged joint farthest from the base moves.

    `center_m`: centre of mass in the frame of that link [m]. It counts as a point.
    """

    mass_kg: float = 0.0
    center_m: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Joint:
    """A logged joint: its name in the URDF, and its drive train where that is described (`described`)."""

    name: str
    axis: Axis
    described: bool = False


@dataclass(frozen=True)
class Robot:
    """A robot. `joints`: those that are logged, in the log's order.

    `gravity_m_s2`: in the frame of the robot's base, shape (3,) [m/s2]; `held`: where joints that are not logged were
    held [rad], sliding ones [m]. A joint that is neither is unknown, and taken to stand at 0.
    """

    name: str
    urdf: Urdf
    joints: tuple[Joint, ...]
    gravity_m_s2: Vector = GRAVITY_M_S2
    payload: Payload = field(default_factory=Payload)
    held: Mapping[str, float] = field(default_factory=dict)
    document: Mapping[str, object] = field(default_factory=dict, repr=False, compare=False)


def slides(robot: Robot, place: int) -> bool:
    """Whether what is logged of a joint are a force [N] and a way [m], and not torque and angle."""
    joint = robot.joints[place]
    return joint.name in robot.urdf.prismatic and not joint.axis.stages


def joint_words(robot: Robot, place: int, text: str) -> str:
    """A text about an axis as one about a joint: units of one that slides, and no motor where none is described."""
    for before, after in (
        *(() if robot.joints[place].described else WITHOUT_MOTOR),
        *(SLIDING if slides(robot, place) else ()),
    ):
        text = text.replace(before, after)
    return text


def logged_joints(robot: Robot) -> tuple[LoggedJoint, ...]:
    """What the columns of a log are told by: names, and gears where they are described."""
    return tuple(LoggedJoint(j.name, j.axis.ratio if j.described else None) for j in robot.joints)


def rigid_joint(name: str) -> Joint:
    """A joint of which nothing is known but its name: a rigid drive without friction, its rotor's inertia unknown."""
    return Joint(name, Axis(name, Motor(), Load(0.0)))


def read_robot(path: Path) -> Robot:
    """Read a robot from its file; URDF and axes are read from beside it.

    Raises
    ------
    AxisError, ParameterError
        naming the key, what is wrong with it and what would be right; unknown keys are refused.
    """
    document = _parsed(path.name, _bytes(path, path.name))
    here = path.parent
    name = document.get("urdf")
    if not isinstance(name, str):
        raise AxisError(f'urdf: must be the name of a file beside this one, such as "robot.urdf", got {shown(name)}')
    return robot_of(
        document,
        _bytes(here / name, f"urdf: {name}", LARGEST_URDF_BYTES),
        lambda axis: _parsed(axis, _bytes(here / axis, axis)),
    )


def robot_of(document: Mapping[str, object], urdf: bytes, axis_of: Any) -> Robot:
    """The robot of a parsed document, the text of its URDF, and the axes that it names (`axis_of`: name -> mapping).

    Raises
    ------
    AxisError
        as `read_robot`.
    """
    _refuse_unknown("", document, ("schema", "name", "urdf", "gravity_m_s2", "payload", "joints", "held"))
    if document.get("schema", SCHEMA) != SCHEMA:
        raise AxisError(f"schema: must be {SCHEMA!r}, got {shown(document['schema'])}")
    links = read_urdf(urdf)
    joints = _joints(document.get("joints"), links, axis_of)
    name = document.get("name", links.name)
    if not isinstance(name, str) or not name.strip() or len(name) > 200:
        raise AxisError(f"name: must be a text of 1 to 200 characters, got {shown(name)}")
    gravity = _vector("gravity_m_s2", document.get("gravity_m_s2", GRAVITY_M_S2), 100.0, "m/s2")
    held = _held(document.get("held", []), links, [joint.name for joint in joints])
    return Robot(name, links, joints, gravity, _payload(document.get("payload", {})), held, dict(document))


def _tables(path: str, value: object, links: Urdf, would_be: str) -> Iterator[tuple[str, str, Mapping[str, object]]]:
    """Path, joint and table of each entry of a list of tables that name joints."""
    if not isinstance(value, list | tuple):
        raise AxisError(f"{path}: {'missing' if value is None else 'must be tables'}; write [[{path}]] with {would_be}")
    if len(value) > MOST_JOINTS:
        raise AxisError(f"{path}: {len(value)} tables; a robot has {MOST_JOINTS} at most")
    for k, table in enumerate(value):
        if not isinstance(table, Mapping):
            raise AxisError(f"{path}[{k}]: must be a table, got {shown(table)}")
        name = table.get("name")
        if not isinstance(name, str) or name not in links.moving:
            raise AxisError(
                f"{path}[{k}].name: {shown(name)} is no joint that moves in the URDF; there are "
                f"{', '.join(links.moving)}"
            )
        yield f"{path}[{k}]", name, table


def _joints(value: object, links: Urdf, axis_of: Any) -> tuple[Joint, ...]:
    out: dict[str, Joint] = {}
    would_be = 'name = "..." for each logged joint, in the log\'s order'
    for path, name, table in _tables("joints", value or None, links, would_be):
        _refuse_unknown(f"{path}.", table, ("name", "axis"))
        if name in out:
            raise AxisError(f"{path}.name: {shown(name)} stands twice; each logged joint once, in the log's order")
        out[name] = _joint(name, table.get("axis"), f"{path}.axis", axis_of)
    return tuple(out.values())


def position_key(links: Urdf, joint: str) -> str:
    """How robot.toml calls where a joint is held."""
    return "position_m" if joint in links.prismatic else "position_rad"


def _held(value: object, links: Urdf, logged: Sequence[str]) -> dict[str, float]:
    """Where joints that are not logged were held."""
    out: dict[str, float] = {}
    would_be = 'name = "..." and position_rad = ... for each joint that was held'
    for path, name, table in _tables("held", value, links, would_be):
        if name in logged or name in out:
            where = "under [[joints]], where the log says how it moves" if name in logged else "twice"
            raise AxisError(f"{path}.name: {shown(name)} stands {where}; each joint once")
        key = position_key(links, name)
        _refuse_unknown(f"{path}.", table, ("name", key))
        if key not in table:
            raise AxisError(f"{path}.{key}: missing; where {name} was held, by the zero of the URDF")
        out[name] = number(f"{path}.{key}", table[key], key.rpartition("_")[2], at_least=-1e3, at_most=1e3)
    return out


def _joint(name: str, source: object, path: str, axis_of: Any) -> Joint:
    if source is None:
        return rigid_joint(name)
    if not isinstance(source, Mapping | str):
        raise AxisError(f"{path}: must be the name of a file beside this one, or the axis itself, got {shown(source)}")
    try:
        return Joint(name, read_axis(axis_of(source) if isinstance(source, str) else source), described=True)
    except AxisError as error:
        raise AxisError(f"{path}: {error}") from None


def _payload(value: object) -> Payload:
    if not isinstance(value, Mapping):
        raise AxisError(f"payload: must be a table, got {shown(value)}")
    _refuse_unknown("payload.", value, tuple(f.name for f in fields(Payload)))
    mass = number("payload.mass_kg", value.get("mass_kg", 0.0), "kg", at_least=0.0, at_most=1e5)
    return Payload(mass, _vector("payload.center_m", value.get("center_m", (0.0, 0.0, 0.0)), 100.0, "m"))


def _vector(path: str, value: object, most: float, unit: str) -> Vector:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise AxisError(f"{path}: must be three numbers in {unit}, such as [0.0, 0.0, 0.0], got {shown(value)}")
    x, y, z = (number(f"{path}[{k}]", v, unit, at_least=-most, at_most=most) for k, v in enumerate(value))
    return x, y, z


def _refuse_unknown(path: str, table: Mapping[str, object], known: tuple[str, ...]) -> None:
    for key in table:
        if key not in known:
            raise AxisError(f"{path}{key}: unknown key; known: {', '.join(known)}")


def _bytes(path: Path, name: str, most: int = 1 << 20) -> bytes:
    try:
        if path.stat().st_size > most:
            raise AxisError(f"{name}: has {path.stat().st_size} bytes; it may have {most}")
        return plain_bytes(path)
    except OSError as error:
        raise AxisError(f"{name}: {'no such file' if isinstance(error, FileNotFoundError) else error}") from None


def _parsed(name: str, text: bytes) -> dict[str, object]:
    try:
        return dict(parse_document(text))
    except TextError as error:
        raise AxisError(f"{name}: {error}") from None
