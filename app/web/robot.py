"""An investigation of a robot as its page shows it: joint by joint, what belongs to each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from app.report.charts import Chart
from app.report.investigation_report import causes_of
from sim.investigation.report.formatting import named
from sim.investigation.results import SAID
from sim.robot.results import SAYS

Document = Mapping[str, Any]


@dataclass(frozen=True)
class JointView:
    """A joint: what was found there, its values without its name before them, and its torques.

    `findings`: each with the chart that shows it, where one was kept, and its place among the charts of causes.
    """

    name: str
    verdict: str
    says: str
    unit: str
    torque: Mapping[str, float]
    findings: Sequence[tuple[Document, Chart | None, int]]
    unexplained: Document | None
    parameters: Sequence[Document]
    gain: Sequence[Document]
    remarks: Sequence[str]


def joints_of(document: Document) -> list[JointView]:
    """Return the joints of a document, in the log's order."""
    return [_joint(document, joint) for joint in document["joints"]]


def of_robot(document: Document) -> list[Document]:
    """Return the values of the description that belong to no joint, such as the payload's."""
    names = [joint["name"] for joint in document["joints"]]
    return [one for one in document["parameters"] if not any(one["name"].startswith(f"{name}.") for name in names)]


def _says(verdict: str, findings: Sequence[Document]) -> str:
    """Say in a few words what a joint has.

    >>> _says("named", [{"mechanism": "viscous_friction", "probability": 0.95}])
    'viscous friction'
    """
    likely = [named(str(one["mechanism"])) for one in findings if one["probability"] >= SAID]
    return ", ".join(dict.fromkeys(likely)) if verdict == "named" and likely else SAYS[verdict]


def _joint(document: Document, joint: Document) -> JointView:
    name = joint["name"]
    parameters = [
        {**one, "name": one["name"].removeprefix(f"{name}.")}
        for one in document["parameters"]
        if one["name"].startswith(f"{name}.")
    ]
    shown = causes_of(document)
    findings = [
        (f, *shown.get(k, (None, 0)))
        for k, f in enumerate(document["findings"])
        if f["location"] == name or str(f["location"]).startswith(f"{name}/")
    ]
    gain = [one for one in document["gain"] if one.get("joint") == name]
    return JointView(
        name,
        joint["verdict"],
        _says(joint["verdict"], [f for f, _, _ in findings]),
        joint.get("unit", "N m"),
        joint.get("torque_rms_nm", {}),
        findings,
        joint.get("unexplained"),
        parameters,
        gain,
        joint.get("remarks", ()),
    )
