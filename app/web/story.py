"""The panels and candidates of an investigation, as charts and rows of a page."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from app.http.errors import NotFound
from app.report.charts import Chart
from app.report.svg import Band, Marker, Series
from sim.investigation.report.box import Entry
from sim.investigation.report.panels import AS_DESCRIBED, style_of

Part = Literal["causes", "overlay", "residual", "sound"]


def panels_of(document: Mapping[str, Any], part: Part) -> list[Chart]:
    """Return the charts of one part; none of what is at work yet."""
    return [_chart(panel) for panel in document.get("story", {}).get(part, ())]


def panel_of(document: Mapping[str, Any], part: Part, number: int) -> Chart:
    """Return one chart.

    Raises:
        NotFound: if the part has fewer.
    """
    panels = panels_of(document, part)
    if not 0 <= number < len(panels):
        raise NotFound(f"This investigation has {len(panels)} panels of its {part}.")
    return panels[number]


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


def box_shown(document: Mapping[str, Any], entries: Iterable[Entry]) -> list[Shown]:
    """Return what a technician reads first, each with the plot that shows it as far as one was kept."""
    shown = causes_of(document)
    return [
        Shown(entry, *shown[entry.finding]) if entry.finding is not None and entry.finding in shown else Shown(entry)
        for entry in entries
    ]


def causes_of(document: Mapping[str, Any]) -> dict[int, tuple[Chart, int]]:
    """Return the chart of each finding that has one, with its place among them, by the finding's place."""
    kept = document["story"].get("causes", ())
    return {panel["finding"]: (_chart(panel), place) for place, panel in enumerate(kept)}


def _chart(panel: Mapping[str, Any]) -> Chart:
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


def _markers(markers: Sequence[Mapping[str, Any]]) -> Iterator[Marker]:
    """Say what several markers mean alike once, at the first of them."""
    said: set[str] = set()
    for marker in markers:
        yield Marker(marker["x"], "" if marker["text"] in said else marker["text"])
        said.add(marker["text"])
