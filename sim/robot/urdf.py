"""Robot descriptions in URDF: links with mass, joints between them; pictures and shapes are left out."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree
from xml.parsers import expat

MOVING = ("revolute", "continuous", "prismatic")
KNOWN = (*MOVING, "fixed")
KEPT = ("link", "joint")
KEPT_IN = {
    "link": ("inertial",),
    "joint": ("parent", "child", "origin", "axis", "limit"),
    "inertial": ("origin", "mass", "inertia"),
}
MOST_ELEMENTS = 20_000
MOST_MOVING = 128
"""Joints that move: a humanoid with its fingers has about 60; the regressor grows with their square."""


class UrdfError(ValueError):
    """The text is no URDF that can be used; it says why."""


@dataclass(frozen=True)
class Urdf:
    """A robot of links and joints.

    `text`: the URDF with its links and joints alone; `moving`: names of the joints that move, in the file's order;
    `prismatic`: those of them that slide; `limits`: lower and upper end of the joints that have them [rad] or [m],
    and the largest speed [rad/s] or [m/s].
    """

    name: str
    text: str
    moving: tuple[str, ...]
    prismatic: frozenset[str]
    limits: dict[str, tuple[float, float, float]]


def read_urdf(text: bytes) -> Urdf:
    """Read a URDF; meshes, colours, controllers and the like are not looked at.

    Raises
    ------
    UrdfError
        saying what is wrong and what would be right.
    """
    root = _parsed(text)
    if root.tag != "robot":
        raise UrdfError(f"the document is <{root.tag[:60]}>, a URDF is <robot>; expand a xacro file first")
    kept = ElementTree.Element("robot", {"name": root.get("name", "robot")})
    moving, prismatic, limits = [], [], {}
    names: dict[str, set[str]] = {kind: set() for kind in KEPT}
    for part in root:
        if part.tag not in KEPT:
            continue
        name = part.get("name", "")
        if not name or name in names[part.tag]:
            raise UrdfError(f"<{part.tag}> {name!r}: a name that no other {part.tag} has is missing")
        names[part.tag].add(name)
        _keep(kept, part)
        if part.tag == "link":
            continue
        kind = part.get("type", "")
        if kind not in KNOWN:
            raise UrdfError(f"joint {name!r}: type {kind!r} is not known here; there are {', '.join(KNOWN)}")
        if kind in MOVING:
            moving.append(name)
            limits.update(_limit(name, part))
        if kind == "prismatic":
            prismatic.append(name)
    _check_tree(kept, names["link"])
    if not moving:
        raise UrdfError("no joint moves")
    if len(moving) > MOST_MOVING:
        raise UrdfError(f"{len(moving)} joints move; there may be {MOST_MOVING}: take out what was not moved")
    text_kept = ElementTree.tostring(kept, encoding="unicode")
    return Urdf(root.get("name", "robot"), text_kept, tuple(moving), frozenset(prismatic), limits)


def _keep(parent: ElementTree.Element, part: ElementTree.Element) -> None:
    """Copy an element with those of its children alone that are looked at."""
    copy = ElementTree.SubElement(parent, part.tag, dict(part.attrib))
    for child in part:
        if child.tag in KEPT_IN.get(part.tag, ()):
            _keep(copy, child)


def _parsed(text: bytes) -> ElementTree.Element:
    """Without a document type: entities are what makes small files large."""
    count = 0
    builder = ElementTree.TreeBuilder()
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > MOST_ELEMENTS:
            raise UrdfError(f"it has more than {MOST_ELEMENTS} elements")
        builder.start(tag, attributes)

    def refuse(*_: object) -> None:
        raise UrdfError("it declares a document type, which no URDF needs; take <!DOCTYPE ...> out")

    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
        return builder.close()
    except expat.ExpatError as error:
        raise UrdfError(f"this is no XML: {error}") from None
    except RecursionError:
        raise UrdfError("it nests too deeply") from None


def _limit(name: str, joint: ElementTree.Element) -> dict[str, tuple[float, float, float]]:
    limit = joint.find("limit")
    if limit is None:
        return {}
    try:
        low, high, speed = (float(limit.get(key, "0")) for key in ("lower", "upper", "velocity"))
    except ValueError:
        raise UrdfError(f"joint {name!r}: lower, upper and velocity of its limit must be numbers") from None
    return {name: (low, high, speed)}


def _check_tree(root: ElementTree.Element, links: set[str]) -> None:
    moved: set[str] = set()
    for joint in root.iter("joint"):
        for role in ("parent", "child"):
            end = joint.find(role)
            link = "" if end is None else end.get("link", "")
            if link not in links:
                raise UrdfError(f"joint {joint.get('name')!r}: its {role} link {link!r} is not in the file")
            if role == "child" and link in moved:
                raise UrdfError(f"link {link!r} is the child of two joints; a URDF is a tree")
            if role == "child":
                moved.add(link)
    if len(links - moved) != 1:
        raise UrdfError(f"{len(links - moved)} links are no joint's child; the base alone should be")
