"""An investigation as its page and its report show it, made of its document alone; the report is one file."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from app.report.charts import Chart
from app.report.formatting import ENVIRONMENT, style_sheet
from app.report.svg import Band, Marker, Series
from app.report.words import investigation_headline, likely_words
from sim.description.axis import Axis
from sim.investigation.report.box import (
    Entry,
    box_of,
    box_of_robot,
    is_shown,
    rests_of_robot,
    size_of,
    unexplained_words,
)
from sim.investigation.report.formatting import named
from sim.investigation.report.panels import AS_DESCRIBED, SHOWS, style_of
from sim.investigation.results import REPORTED
from sim.investigation.unexplained import unexplained_of
from sim.robot.results import SAYS

Document = Mapping[str, Any]
Part = Literal["causes", "overlay", "residual", "sound"]
WIDTH, HEIGHT = 390.0, 240.0
"""Of a plot of the report, so that its words can be read on a phone."""
MOST_PLACES = 6


@dataclass(frozen=True)
class Shown:
    """An entry of the box, and the chart that shows it with its place among the causes' charts."""

    entry: Entry
    chart: Chart | None = None
    place: int = 0

    @property
    def has_parts(self) -> bool:
        """Whether the chart holds the torque of this one cause against the model without it."""
        return self.chart is not None and any(one.name == AS_DESCRIBED for one in self.chart.series)


def investigation_report(
    document: Document,
    axis: Axis | None,
    files: Sequence[str] = (),
    parts: Sequence[tuple[str, Document]] = (),
) -> str:
    """Return an investigation step by step as one HTML page that loads nothing.

    Args:
        document: of `Investigation`, `Together` or `RobotInvestigation`, with its `story`.
        axis: the description it was held against; None for a robot.
        files: names of what was measured.
        parts: of several recordings or joints, the title and the document with its story of each.
    """
    from sim.investigation.estimation.problem import MISTAKEN  # slow to import, which no page need wait for
    from sim.investigation.model.nominal import DAMPING_SPREAD, LOSS_SPREAD, PAYLOAD_SPREAD, STATED_SPREAD
    from sim.investigation.report.wording import measurement_between

    context = {
        "style": style_sheet(),
        "document": document,
        "axis": axis,
        "files": list(files),
        "parts": parts,
        "box_of": lambda one, of: box_shown(one, box_of(one, of) if of else box_of_robot(one)),
        "headline": investigation_headline,
        "panels_of": panels_of,
        "likely_words": likely_words,
        "is_shown": is_shown,
        "size_of": size_of,
        "unexplained_words": lambda found: unexplained_words(unexplained_of(found)),
        "rests_of_robot": rests_of_robot,
        "telling_apart": measurement_between,
        "highest": highest,
        "shows": SHOWS,
        "spreads": {"stated": STATED_SPREAD, "loss": LOSS_SPREAD, "payload": PAYLOAD_SPREAD, "damping": DAMPING_SPREAD},
        "mistaken": MISTAKEN,
        "size": {"width": WIDTH, "height": HEIGHT},
    }
    return ENVIRONMENT.get_template("investigation_report.html").render(context)


def panels_of(document: Document, part: Part) -> list[Chart]:
    """Return the charts of one part; none of what is at work yet."""
    return [_chart(panel) for panel in document.get("story", {}).get(part, ())]


def box_shown(document: Document, entries: Iterable[Entry]) -> list[Shown]:
    """Return what a technician reads first, each with the plot that shows it as far as one was kept."""
    shown = causes_of(document)
    return [
        Shown(entry, *shown[entry.finding]) if entry.finding is not None and entry.finding in shown else Shown(entry)
        for entry in entries
    ]


def causes_of(document: Document) -> dict[int, tuple[Chart, int]]:
    """Return the chart of each finding that has one, with its place among them, by the finding's place."""
    kept = document.get("story", {}).get("causes", ())
    return {panel["finding"]: (_chart(panel), place) for place, panel in enumerate(kept)}


def highest(charts: Iterable[Chart]) -> list[tuple[float, str, float, str]]:
    """Return where the last model leaves most over its noise floor: times the floor, the plot, x and its unit."""
    found = []
    for chart in charts:
        last = chart.series[-1]
        if chart.bands and chart.bands[0].low >= 0.0 and np.isfinite(last.y).any():
            at = int(np.nanargmax(last.y))
            unit = chart.x_label.partition("[")[2].removesuffix("]")
            found.append((float(last.y[at]) / chart.bands[0].high, chart.title, float(last.x[at]), unit))
    return sorted(found, reverse=True)[:MOST_PLACES]


def _chart(panel: Document) -> Chart:
    x = np.array(panel["x"], dtype=np.float64)
    noise = panel["noise"]
    return Chart(
        panel["title"],
        tuple(
            Series(line["name"], x, np.array(line["y"], dtype=np.float64), style_of(line["name"], place))
            for place, line in enumerate(panel["lines"])
        ),
        panel["x_label"],
        panel["y_label"],
        bands=(Band(panel.get("band", "noise floor"), *noise),) if noise else (),
        markers=tuple(_markers(panel["markers"])),
        cursor=panel["cursor"],
    )


def _markers(markers: Sequence[Document]) -> Iterator[Marker]:
    """Name what several markers mean alike once, at the first of them."""
    named: set[str] = set()
    for marker in markers:
        yield Marker(marker["x"], "" if marker["text"] in named else marker["text"])
        named.add(marker["text"])


def joints_of(document: Document) -> list[dict[str, Any]]:
    """Return the joints of a document, in the log's order: what was found, its values without its name, its torques.

    `findings`: each with the chart that shows it, where one was kept, and its place among the charts of causes.
    """
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
    likely = [named(str(one["mechanism"])) for one in findings if one["probability"] >= REPORTED]
    return ", ".join(dict.fromkeys(likely)) if verdict == "named" and likely else SAYS[verdict]


def _joint(document: Document, joint: Document) -> dict[str, Any]:
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
    return {
        "name": name,
        "verdict": joint["verdict"],
        "says": _says(joint["verdict"], [f for f, _, _ in findings]),
        "unit": joint.get("unit", "N m"),
        "torque": joint.get("torque_rms_nm", {}),
        "findings": findings,
        "unexplained": joint.get("unexplained"),
        "parameters": parameters,
        "gain": [one for one in document["gain"] if one.get("joint") == name],
        "remarks": joint.get("remarks", ()),
    }
