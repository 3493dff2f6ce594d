"""One panel of an investigation, for the interactive plot."""

from collections.abc import Mapping
from typing import Any

from app.http.errors import NotFound
from app.report.charts import Chart
from app.report.investigation_report import Part, panels_of


def panel_of(document: Mapping[str, Any], part: Part, number: int) -> Chart:
    """Return one chart.

    Raises:
        NotFound: if the part has fewer.
    """
    panels = panels_of(document, part)
    if not 0 <= number < len(panels):
        raise NotFound(f"This investigation has {len(panels)} panels of its {part}.")
    return panels[number]
