"""The page to check and sign: one page, nothing off it or over another, the largest letters that leave room."""

from collections.abc import Sequence

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from app.web.story import Shown
from app.web.work_sheet import HEIGHT, OUTCOMES, WIDTH, Sheet, drawn, investigation_pdf
from benchmarks.harness.site import Site, browsing
from sim.discrepancy.report.box import Entry


def sheet(entries: int, words: int = 30) -> Sheet:
    """What was found so many times, each in so many words."""
    told = " ".join(["backlash"] * words)
    box = [Shown(Entry(f"Finding {place}", told, "gear", "likely", f"Do {place}: {told}")) for place in range(entries)]
    return Sheet("axis, log.csv", "Found: much", box, "Move the load by hand.", "Investigation 1")


def texts(figure: Figure) -> list[tuple[str, float, float, float, float]]:
    """Every text with its left, bottom, right and top [pt]."""
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(72.0)
    renderer = canvas.get_renderer()
    boxes = [(one.get_text(), one.get_window_extent(renderer)) for one in figure.texts if one.get_text()]
    return [(text, box.x0, box.y0, box.x1, box.y1) for text, box in boxes]


def overlaps(found: Sequence[tuple[str, float, float, float, float]]) -> list[tuple[str, str]]:
    """Pairs of which one is drawn over the other, by more than the rounding of a letter."""
    return [
        (one[0], other[0])
        for place, one in enumerate(found)
        for other in found[place + 1 :]
        if min(one[3], other[3]) - max(one[1], other[1]) > 1.0 and min(one[4], other[4]) - max(one[2], other[2]) > 1.5
    ]


@pytest.mark.parametrize("entries", [1, 3, 30])
def test_nothing_runs_off_the_page_or_over_another(entries: int) -> None:
    found = texts(drawn(sheet(entries)))
    assert overlaps(found) == []
    assert min(one[1] for one in found) >= 0.0
    assert max(one[3] for one in found) <= WIDTH
    assert min(one[2] for one in found) >= 0.0
    assert max(one[4] for one in found) <= HEIGHT


def test_what_has_no_room_is_said_to_stand_elsewhere() -> None:
    few, many = (" ".join(one[0] for one in texts(drawn(sheet(entries)))) for entries in (2, 30))
    assert "More than fits here" in many
    assert "More than fits here" not in few
    for part in ("Do 0:", "Do 1:", "Measure next: Move the load by hand.", "Signature", *OUTCOMES):
        assert part in few


def test_it_is_one_page_of_the_investigation(site: Site) -> None:
    with browsing(site, "viewer") as client:
        answer = client.get(f"/investigations/{site.investigation}/report.pdf").raise_for_status()
    assert answer.headers["content-type"] == "application/pdf"
    for content in (answer.content, investigation_pdf(sheet(30))):
        assert content.startswith(b"%PDF-")
        assert content.count(b"/Type /Page ") == 1
