"""Lists of pages are searched, sorted and cut where the rows are; names are chosen, and new ones asked about."""

import re
from collections.abc import Iterator

import pytest
from sqlalchemy import insert

from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.sounds import sound
from benchmarks.large.library import Size
from benchmarks.large.pages import built
from casebase.store.models import AxisRevision, RobotRevision

API = "/api/v1"
LISTS = ("/library", "/diagnoses", "/fleet", "/axes", "/jobs", "/investigations", "/audit")
MANY = 60


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    """More of everything than a page shows."""
    with inside(tmp_path_factory.mktemp("lists") / "data") as found:
        built(found, Size(cases=MANY, gearboxes=MANY, waiting=MANY, heard=3, others=5 * MANY))
        revision = {"revision": 1, "document": {"mechanisms": []}, "created_by": "test"}
        with found.service.library.transaction("test") as session:
            session.execute(insert(AxisRevision), [{"name": f"axis {k}", **revision} for k in range(MANY)])
            session.add(RobotRevision(name="robot 7", urdf="", **{**revision, "document": {"joints": []}}))
        yield found


def rows(page: str) -> list[str]:
    """The words of each line of the table."""
    found = re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)[1:]
    return [" ".join(re.sub(r"<(?!a )[^>]+>", " ", one).split()) for one in found]


@pytest.mark.parametrize("path", LISTS)
def test_each_order_of_a_list_comes_page_by_page(service: Inside, path: str) -> None:
    page = service.browse("GET", path).text
    orders = re.findall(r'value="(\w*)"', page.partition('id="sort"')[2].partition("</select>")[0])
    firsts = {}
    for order in orders:
        first = service.browse("GET", f"{path}?sort={order}").text
        then = re.search(r'href="(\?[^"]+)">The next', first)
        assert then is not None
        second = service.browse("GET", path + then[1].replace("&amp;", "&")).text
        assert len(rows(first)) == 50
        assert 0 < len(rows(second)) <= 50
        assert not {*rows(first)} & {*rows(second)}
        firsts[order] = tuple(rows(first))
    assert firsts[""] == tuple(rows(page))
    assert len({*firsts.values()}) > 1


def test_every_word_that_is_searched_stands_in_each_row(service: Inside) -> None:
    for path, words in (
        ("/library", ("backlash", "g8")),
        ("/diagnoses", ("recording", "7.wav")),
        ("/fleet", ("a7",)),
        ("/axes", ("axis", "7")),
        ("/jobs", ("Simulation", "done")),
        ("/investigations", ("one body",)),
        ("/audit", ("Case", "added")),
    ):
        found = rows(service.browse("GET", path, params={"search": " ".join(words)}).text)
        assert found, path
        assert all(word in row for row in found for word in words), path
        assert "None fits." in service.browse("GET", path, params={"search": "%_"}).text, path


def test_a_name_that_nothing_knows_is_asked_about(service: Inside) -> None:
    def sent(path: str, **told: str) -> tuple[int, str]:
        files = {"file": ("new.wav", sound(91))}
        answer = service.browse("POST", path, data=told, files=files)
        return answer.status_code, answer.text

    label = {"label": "normal", "verification": "opened"}
    for path, more in (("/diagnoses/new", {}), ("/library/add", label)):
        for told in ({"axis": "a33"}, {"axis": "a3", "gearbox": "g3e"}, {"gearbox": "G 3"}):
            status, page = sent(path, **more, **told)
            assert status == 422
            assert "Choose one of the list" in page
    assert service.ask("GET", f"{API}/diagnoses?axis=a33").json()["items"] == []
    status, _ = sent("/diagnoses/new", axis="a33", new_axis="1", gearbox="first of it")
    assert status == 303
    assert sent("/diagnoses/new", axis="a33", gearbox="g8")[0] == 303
    assert sent("/diagnoses/new", axis="a33", gearbox="simulated-7")[0] == 303  # no gearbox of a list
    names = service.browse("GET", "/names/gearbox?axis=a33").json()
    assert names == ["g8", "first of it"]
    assert service.browse("GET", "/names/axis?search=A33").json() == ["a33"]


def test_the_same_sound_again_leads_to_its_first_diagnosis(service: Inside) -> None:
    files = {"file": ("twice.wav", sound(93))}
    first, again = (
        service.browse("POST", "/diagnoses/new", data={}, files=files).headers["location"] for _ in range(2)
    )
    pages = [service.browse("GET", path).text for path in (first, again)]
    assert [f'href="{first}"' in page for page in pages] == [False, True]


def test_numbers_of_a_recording_have_units_to_choose(service: Inside) -> None:
    told = {"speed_rad_s": "30", "speed_rad_s.unit": "rpm", "payload_kg_m2": "50000 kg cm2"}
    made = service.browse("POST", "/diagnoses/new", data=told, files={"file": ("units.wav", sound(92))})
    kept = service.ask("GET", f"{API}{made.headers['location']}").json()["recording"]
    assert kept["speed_rad_s"] == pytest.approx(3.14159, rel=1e-4)
    assert kept["payload_kg_m2"] == pytest.approx(5.0)
