"""The page *Simulate*: sliders change what they say, the description stays as it is, and nothing is stored."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import expect
from sqlalchemy import func, select

from app.web.pages.simulate import moved, simulate, sliders
from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.site import AXIS, Site, browsing
from casebase.store.models import Base
from sim.description.axis import Axis, MechanismEntry
from sim.description.axis_document import parse_axis, read_axis
from sim.experiment.paper_axis import PAPER_AXIS
from tests.web.conftest import Opened

PLAIN = read_axis(parse_axis(AXIS))
WORN = replace(
    PLAIN,
    mechanisms=(
        MechanismEntry("tooth_damage", "output", {"angle_rad": 0.7, "depth_rad": 0.0004, "flank": -1.0}),
        MechanismEntry("backlash", "output", {"gap_rad": 0.0009}),
        MechanismEntry("backlash", "transfer", {"gap_rad": 0.002}),
    ),
)
SECONDS = 4.0


def with_sliders(axis: Axis, **values: float) -> Axis:
    return moved(axis, {**{one.name: one.start for one in sliders(axis)}, **values})


@pytest.mark.parametrize("axis", [PAPER_AXIS, PLAIN, WORN])
def test_an_axis_whose_sliders_stand_at_the_description_is_the_described_one(axis: Axis) -> None:
    assert with_sliders(axis) is axis


def test_a_slider_replaces_what_the_description_has_at_the_last_gear() -> None:
    """The damaged tooth keeps its place and its flank, the other gear its gap."""
    assert {one.name: one.start for one in sliders(WORN)} == {
        "gap_mrad": 0.9, "notch_mrad": 0.4, "error_mrad": 0.0, "order": 12.0, "friction": 1.0
    }  # fmt: skip
    left = with_sliders(WORN, gap_mrad=0.2, notch_mrad=1.0).mechanisms
    assert [(entry.name, entry.location) for entry in left] == [
        ("backlash", "transfer"),
        ("backlash", "output"),
        ("tooth_damage", "output"),
    ]
    assert left[1].parameters == {"gap_rad": pytest.approx(0.0002)}
    assert {name: left[2].parameters[name] for name in ("angle_rad", "depth_rad", "flank")} == {
        "angle_rad": 0.7,
        "depth_rad": 0.001,
        "flank": -1.0,
    }


def test_each_slider_is_heard() -> None:
    healthy = simulate(PAPER_AXIS, SECONDS)
    for name in ("gap_mrad", "notch_mrad"):
        assert simulate(with_sliders(PAPER_AXIS, **{name: 0.8}), SECONDS).crest.largest > 1.5 * healthy.crest.largest
    for values in ({"error_mrad": 0.1}, {"error_mrad": 0.1, "order": 50.0}):
        erring = simulate(with_sliders(PAPER_AXIS, **values), SECONDS)
        assert erring.sound.std() > 1.1 * healthy.sound.std()
    stiff = simulate(with_sliders(PAPER_AXIS, friction=3.0), SECONDS)
    assert abs(stiff.torque_n_m).max() > abs(healthy.torque_n_m).max()


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Inside]:
    with inside(tmp_path / "data") as found:
        yield found


def rows(service: Inside) -> dict[str, int]:
    with service.service.library.reading() as session:
        tables = Base.metadata.sorted_tables
        return {one.name: session.scalar(select(func.count()).select_from(one)) or 0 for one in tables}


def test_diagnosing_stores_nothing(service: Inside) -> None:
    """The paper's axis needs not to be stored either."""
    before = rows(service)
    page = service.browse("GET", "/simulate?gap_mrad=1&diagnose=true")
    assert page.status_code == 200
    assert "Nothing was stored" in page.text
    assert "No answer" in page.text  # an empty library knows nothing
    assert rows(service) == before


def test_a_sound_is_sent_whole_or_in_part(service: Inside) -> None:
    whole = service.browse("GET", "/simulate/sound.wav").content
    part = service.browse("GET", "/simulate/sound.wav", headers={"Range": "bytes=100-199"})
    assert (part.status_code, part.content) == (206, whole[100:200])
    assert service.browse("GET", "/simulate/sound.wav?gap_mrad=1").content != whole


@pytest.mark.parametrize("path", ["/simulate", "/simulate/sound.wav"])
def test_who_may_look_may_simulate(site: Site, path: str) -> None:
    for role, status in (("viewer", 200), (None, 303)):
        with browsing(site, role) as client:
            assert client.get(path).status_code == status


@pytest.mark.browser
def test_sliders_are_seen_and_heard_at_once(opened: Opened, site: Site) -> None:
    """The other sound begins where the first one is; a diagnosis names its nearest cases."""
    with opened("viewer", "/simulate?axis=bench") as page:
        expect(page.get_by_role("heading", name="Crest factor below 200 Hz")).to_be_visible()
        before = page.locator("#result .series.s1").nth(2).get_attribute("d")
        page.locator("#gap_mrad-range").fill("1.5")
        expect(page.locator("#gap_mrad")).to_have_value("1.5")
        expect(page.locator("#result .series.s1").nth(2)).not_to_have_attribute("d", str(before))
        healthy, played = page.locator("audio").all()
        assert "gap_mrad=1.5" in str(played.get_attribute("src"))
        assert "gap_mrad=0.0" in str(healthy.get_attribute("src"))
        healthy.evaluate("async (one) => { one.currentTime = 1.5; await one.play(); }")
        page.get_by_role("button", name="Hear the other one").click()
        expect(page.locator("[data-playing]")).to_contain_text("As set")
        assert healthy.evaluate("(one) => one.paused")
        assert played.evaluate("(one) => one.currentTime") > 1.4
        page.get_by_role("button", name="Diagnose this").click()
        expect(page.locator("#verdict")).not_to_be_empty()
        expect(page.locator("#result table").first.locator("tbody tr")).not_to_have_count(0)
