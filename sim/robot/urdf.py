"""Robot descriptions in URDF: links with mass, joints between them; pictures and shapes are left out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from sim.errors import AxisError

MOVING = ("revolute", "continuous", "prismatic")
KNOWN = (*MOVING, "fixed")
LIMITED = ("revolute", "prismatic")
KEPT = ("link", "joint")
KEPT_IN = {
    "link": ("inertial",),
    "joint": ("parent", "child", "origin", "axis", "limit"),
    "inertial": ("origin", "mass", "inertia"),
}
NUMBERS = {
    "origin": ("xyz", "rpy"), "axis": ("xyz",), "mass": ("value",),
    "inertia": ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), "limit": ("lower", "upper", "velocity"),
}  # fmt: skip
ROUNDED = 1e-6  # of the largest principal moment: what makers round
MOST_ELEMENTS, DEEPEST = 20_000, 50
MOST_MOVING = 128
"""Joints that move: a humanoid with its fingers has about 60; the regressor grows with their square."""


@dataclass(frozen=True)
class Urdf:
    """A robot of links and joints.

    `text`: the URDF with its links and joints alone; `moving`: names of the joints that move, in the file's order;
    `prismatic`: those of them that slide; `limits`: lower and upper end of the joints that have them [rad] or [m],
    and the largest speed [rad/s] or [m/s]; `mended`: links whose inertia no body can have, and is the least instead.
    """

    name: str
    text: str
    moving: tuple[str, ...]
    prismatic: frozenset[str]
    limits: dict[str, tuple[float, float, float]]
    mended: tuple[str, ...] = ()


def read_urdf(text: bytes) -> Urdf:
    """Read a URDF; meshes, colours, controllers and the like are not looked at.

    Raises
    ------
    AxisError
        saying what is wrong and what would be right.
    """
    root = _parsed(text)
    if root.tag != "robot":
        raise AxisError(f"urdf: the document is <{root.tag[:60]}>, a URDF is <robot>; expand a xacro file first")
    mended: list[str] = []
    kept = ElementTree.Element("robot", {"name": root.get("name", "robot")})
    names: dict[str, set[str]] = {kind: set() for kind in KEPT}
    for part in root:
        if part.tag not in KEPT:
            continue
        name = part.get("name", "")
        if not name or name in names[part.tag]:
            raise AxisError(f"urdf: <{part.tag}> {name!r}: a name that no other {part.tag} has is missing")
        names[part.tag].add(name)
        for child in _keep(kept, part).iter():
            _check_numbers(f"{part.tag} {name!r}", child)
            _check_inertial(name, child)
            if child.tag == "inertia" and _mend(child):
                mended.append(name)
    kinds = _kinds(kept)
    moving = tuple(name for name, kind in kinds.items() if kind in MOVING)
    if not moving:
        raise AxisError("urdf: no joint moves")
    if len(moving) > MOST_MOVING:
        raise AxisError(f"urdf: {len(moving)} joints move; there may be {MOST_MOVING}: take out what was not moved")
    _check_tree(kept, names["link"])
    if not any(float(mass.get("value", "0")) > 0.0 for mass in kept.iter("mass")):
        raise AxisError("urdf: no link has a mass; a description with <inertial> in its links is needed")
    limits = {
        joint.get("name", ""): (
            float(at.get("lower", "0")),
            float(at.get("upper", "0")),
            float(at.get("velocity", "0")),
        )
        for joint in kept.iter("joint")
        if kinds[joint.get("name", "")] in LIMITED
        for at in joint.findall("limit")
    }
    prismatic = frozenset(name for name, kind in kinds.items() if kind == "prismatic")
    text_kept = ElementTree.tostring(kept, encoding="unicode")
    return Urdf(root.get("name", "robot"), text_kept, moving, prismatic, limits, tuple(mended))


def _kinds(kept: ElementTree.Element) -> dict[str, str]:
    """How each joint moves, by its name."""
    kinds = {joint.get("name", ""): joint.get("type", "") for joint in kept.iter("joint")}
    for name, kind in kinds.items():
        if kind not in KNOWN:
            raise AxisError(f"urdf: joint {name!r}: type {kind!r} is not known here; there are {', '.join(KNOWN)}")
    return kinds


def _keep(parent: ElementTree.Element, part: ElementTree.Element) -> ElementTree.Element:
    """Copy an element with those of its children alone that are looked at."""
    copy = ElementTree.SubElement(parent, part.tag, dict(part.attrib))
    for child in part:
        if child.tag in KEPT_IN.get(part.tag, ()):
            _keep(copy, child)
    return copy


def _parsed(text: bytes) -> ElementTree.Element:
    """Without a document type: entities are what makes small files large."""
    count = depth = 0
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > MOST_ELEMENTS:
            raise AxisError(f"urdf: it has more than {MOST_ELEMENTS} elements")
        if depth > DEEPEST:
            raise AxisError(f"urdf: its elements nest more than {DEEPEST} deep")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: object) -> None:
        raise AxisError("urdf: it declares a document type, which no URDF needs; take <!DOCTYPE ...> out")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
        return builder.close()
    except expat.ExpatError as error:
        raise AxisError(f"urdf: this is no XML: {error}") from None


def _check_inertial(link: str, element: ElementTree.Element) -> None:
    missing = [f"<{tag}>" for tag in ("mass", "inertia") if element.tag == "inertial" and element.find(tag) is None]
    if missing:
        raise AxisError(
            f"urdf: link {link!r}: its <inertial> has no {' and no '.join(missing)}; write both, or leave <inertial> "
            "out of a link that weighs nothing"
        )


def _mend(inertia: ElementTree.Element) -> bool:
    """Make an inertia one that a body can have, by raising its principal moments as little as that needs."""
    xx, yy, zz, xy, xz, yz = (float(inertia.get(key, "0")) for key in NUMBERS["inertia"])
    moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    least = np.maximum(moments, ROUNDED * abs(moments).max())
    least[:2] += max(float(least[2] - least[0] - least[1]), 0.0) / 2.0
    if np.allclose(least, moments, rtol=ROUNDED, atol=0.0):
        return False
    tensor = axes @ np.diag(least) @ axes.T
    for key, (i, j) in zip(NUMBERS["inertia"], ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True):
        inertia.set(key, repr(float(tensor[i, j])))
    return True


def _check_numbers(where: str, element: ElementTree.Element) -> None:
    for key in NUMBERS.get(element.tag, ()):
        text = element.get(key)
        try:
            values = [] if text is None else [float(value) for value in text.split()]
        except ValueError:
            values = [math.nan]
        if not all(math.isfinite(value) for value in values) or (text is not None and not values):
            raise AxisError(f"urdf: {where}: {key} of its {element.tag} must be finite numbers, got {str(text)[:60]!r}")
        if element.tag == "mass" and values and values[0] < 0.0:
            raise AxisError(f"urdf: {where}: its mass of {values[0]:g} kg is below 0")


def _check_tree(root: ElementTree.Element, links: set[str]) -> None:
    above: dict[str, str] = {}
    for joint in root.iter("joint"):
        ends = {role: joint.find(role) for role in ("parent", "child")}
        parent, child = ("" if end is None else end.get("link", "") for end in ends.values())
        for role, link in (("parent", parent), ("child", child)):
            if link not in links:
                raise AxisError(f"urdf: joint {joint.get('name')!r}: its {role} link {link!r} is not in the file")
        if child in above:
            raise AxisError(f"urdf: link {child!r} is the child of two joints; a URDF is a tree")
        above[child] = parent
    bases = sorted(links - set(above))
    if len(bases) != 1:
        raise AxisError(f"urdf: {len(bases)} links are no joint's child; the base alone should be")
    hanging, level = set(bases), set(bases)
    while level:
        level = {child for child, parent in above.items() if parent in level}
        hanging |= level
    if hanging != links:
        raise AxisError(
            f"urdf: link {min(links - hanging)!r} does not hang at the base {bases[0]!r}: its joints make a ring"
        )
