"""The fleet and the pages of gearboxes say what the rows say; nothing is worked out twice."""

import re
from collections import Counter
from collections.abc import Iterator
from datetime import timedelta
from unittest.mock import patch

import numpy as np
import pytest

from app import fleet
from benchmarks.harness.inside import Inside, inside
from casebase.reasoning.trend import COLOUR, DECIDING
from casebase.store.models import now
from sim.mechanisms.mechanism import SECURED
from tests.casebase.kept import keep

API = "/api/v1"
STAGE = {"name": "output", "driver_teeth": 12, "driven_teeth": 96}
AXIS = {"name": "arm", "motor": {"inertia_kg_m2": 0.006}, "stages": [STAGE], "load": {"inertia_kg_m2": 40.0}}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    """Five gearboxes, a month of recordings each, and an axis that was never heard."""
    rng, today = np.random.default_rng(1), now()
    with inside(tmp_path_factory.mktemp("fleet") / "data") as found:
        for name in ("arm", "never heard"):
            found.ask("POST", f"{API}/axes", json={**AXIS, "name": name}).raise_for_status()
        with found.service.library.transaction("test") as session:
            for gearbox in ("good", "worn", "rising", "silent"):
                for day in range(30):
                    told = {name: float(rng.standard_normal()) for name in DECIDING}
                    if gearbox == "rising" and day >= 20:
                        told["notch_bump_12_200_hz"] += 4
                    label = "play" if gearbox == "worn" and day >= 28 else "normal"
                    at = today - timedelta(days=30 - day + (100 if gearbox == "silent" else 0))
                    keep(session, "arm", gearbox, at, told, label)
            keep(session, "arm", "strange", today, {}, verdict="not_in_library")
        yield found


def rows(page: str) -> list[tuple[str, str]]:
    """State and gearbox of each line of the fleet."""
    found = re.findall(r"<tr>(.*?)</tr>", page, re.DOTALL)[1:]
    texts = [
        [re.sub(r"<[^>]+>", "", cell).strip() for cell in re.findall(r"<td.*?</td>", one, re.DOTALL)] for one in found
    ]
    return [(cells[0], cells[1]) for cells in texts]


def test_the_worst_stands_first(service: Inside) -> None:
    page = service.browse("GET", "/fleet").text
    assert rows(page) == [
        ("Fault likely", "arm, worn"),
        ("Watch", "arm, rising"),
        ("Not recorded for 101 days", "arm, silent"),
        ("Cannot say", "arm, strange"),
        ("Cannot say", "never heard"),
        ("Good", "arm, good"),
    ]
    assert SECURED in page


def test_the_place_of_an_impact_is_said_by_its_time(service: Inside) -> None:
    found = {"notch_phase": 90.0, "motion_period": 4.0}
    evidence = [{"kind": "event", "quantity": name, "value": value, "unit": "1"} for name, value in found.items()]
    with service.service.library.transaction("test") as session:
        keep(session, "timed", "g1", now(), {}, "notch", evidence=evidence)
    for path in ("/fleet", "/axes/timed/gearboxes/g1"):
        page = service.browse("GET", path).text
        assert "1\N{NO-BREAK SPACE}s after the first reversal" in page, path
        assert "when the impact comes" not in page, path


def test_whoever_is_signed_in_comes_to_the_fleet(service: Inside) -> None:
    assert service.browse("GET", "/").headers["location"] == "/fleet"


def test_only_what_changed_is_worked_out_again(service: Inside) -> None:
    service.browse("GET", "/fleet")
    with patch.object(fleet, "histories_of", wraps=fleet.histories_of) as asked:
        service.browse("GET", "/fleet")
        assert asked.call_count == 0
        with service.service.library.transaction("test") as session:
            keep(session, "arm", "good", now(), {}, "normal")
        service.browse("GET", "/fleet")
        assert [call.args[1] for call in asked.call_args_list] == [[("arm", "good")]]


def test_the_page_of_a_gearbox_has_all_of_it(service: Inside) -> None:
    page = service.browse("GET", "/axes/arm/gearboxes/worn").text
    assert SECURED in page
    assert page.count('<td data-label="Recorded">') == 30
    assert service.browse("GET", "/axes/arm/gearboxes/nobody").status_code == 404


def test_older_recordings_are_on_the_next_page(service: Inside) -> None:
    with service.service.library.transaction("test") as session:
        for day in range(60):
            keep(session, "many", None, now() - timedelta(days=day), {}, "normal")
    first = service.browse("GET", "/axes/many/gearboxes").text
    older = re.search(r'href="\?history=1&amp;before=(\w+)"', first)
    assert older is not None
    second = service.browse("GET", f"/axes/many/gearboxes?history=1&before={older[1]}").text
    assert (first.count('data-label="Recorded"'), second.count('data-label="Recorded"')) == (50, 10)
    assert "before=" not in second


def test_an_exchange_ends_the_history_on_the_page(service: Inside) -> None:
    with service.service.library.transaction("test") as session:
        keep(session, "arm", "old", now() - timedelta(days=2), {}, "play")
    mark = {"text": "worn out", "at": f"{now():%Y-%m-%dT%H:%M}", "gearbox": "old", "back": "old"}
    refused = service.browse("POST", "/axes/arm/marks", data={**mark, "kind": "repair", "successor": "new"})
    assert "Only an exchange has a new gearbox" in refused.text
    assert service.browse("POST", "/axes/arm/marks", data={**mark, "kind": "theft"}).status_code == 422
    later = service.browse("POST", "/axes/arm/marks", data={**mark, "kind": "repair", "at": "2199-01-01T06:00"})
    assert (later.status_code, "must not lie in the future" in later.text) == (422, True)
    made = service.browse("POST", "/axes/arm/marks", data={**mark, "kind": "exchange", "successor": "new"})
    assert made.headers["location"] == "/axes/arm/gearboxes/old"
    assert "its history ends here" in service.browse("GET", "/axes/arm/gearboxes/old").text
    states = {gearbox: state for state, gearbox in rows(service.browse("GET", "/fleet").text)}
    assert "arm, old" not in states
    assert states["arm, new"] == "Cannot say"
    assert "and not recorded yet" in service.browse("GET", "/axes/arm/gearboxes/new").text


def test_what_changed_at_once_is_asked_and_each_answer_is_one_click(service: Inside) -> None:
    """Some bands rise and others fall from one recording on: another gearbox, or another place."""
    rng, today = np.random.default_rng(2), now()
    with service.service.library.transaction("test") as session:
        for gearbox in ("swapped", "heard from elsewhere"):
            for back in range(30, 0, -1):
                told = {name: float(rng.standard_normal()) for name in (*DECIDING, *COLOUR)}
                for band, by in ((COLOUR[3], 5.0), (COLOUR[7], -5.0), (COLOUR[9], 4.0)):
                    told[band] += by * (back <= 10)
                label = "play" if back == 20 else "normal"
                keep(session, "arm", gearbox, today - timedelta(days=back), told, label)
    for gearbox, kind, button, left in (
        ("swapped", "exchange", "The gearbox was exchanged", 10),
        ("heard from elsewhere", "microphone", "The microphone was moved", 30),
    ):
        path = f"/axes/arm/gearboxes/{gearbox}"
        page = service.browse("GET", path).text
        assert "Its sound changed at once about" in page
        assert button in page
        form = page.partition(f'name="kind" value="{kind}"')[2].partition("</form>")[0]
        said = dict(re.findall(r'name="(at|text)" value="([^"]*)"', form))
        given = {**said, "kind": kind, "gearbox": gearbox, "back": gearbox}
        assert service.browse("POST", "/axes/arm/marks", data=given).status_code == 303
        page = service.browse("GET", path).text
        assert "changed at once" not in page
        assert "No change is certain over its 10 recordings." in page
        assert page.count('<td data-label="Recorded">') == left


def test_a_trend_is_seen_from_day_to_day_with_another_over_it(service: Inside) -> None:
    path, day = "/axes/arm/gearboxes/rising?chart=0", (now() - timedelta(days=10)).date()
    whole = service.browse("GET", path).json()
    part = service.browse("GET", f"{path}&from={day}&with=good").json()
    assert len(whole["x"]) == 30
    assert (len(whole["series"]), [one["name"] for one in part["series"]][1:]) == (1, ["good"])
    assert min(part["x"]) >= 19
    linked = service.browse("GET", f"/axes/arm/gearboxes/rising?from={day}&with=good").text
    assert f'name="from" type="date" value="{day}"' in linked
    assert f"?chart=0&amp;from={day}&amp;with=good" in linked
    assert service.browse("GET", f"{path}&from=monday").status_code == 422


def test_a_note_has_the_zone_of_the_browser(service: Inside) -> None:
    mark = {"text": "oiled", "at": "2026-01-02T08:00", "zone": "Asia/Tokyo"}
    assert service.browse("POST", "/axes/arm/marks", data={**mark, "zone": "nowhere"}).status_code == 422
    assert service.browse("POST", "/axes/arm/marks", data=mark).status_code == 303
    assert "2026-01-01T23:00:00+00:00" in service.browse("GET", "/axes/arm").text


def test_a_large_fleet_is_read_page_by_page_and_state_by_state(service: Inside) -> None:
    whole = rows(service.browse("GET", "/fleet").text)
    good = [row for row in whole if row[0] == "Good"]
    with patch("app.web.page.ROWS", 2):
        first = service.browse("GET", "/fleet").text
        assert rows(first) == whole[:2]
        assert f"1 to 2 of {len(whole)}." in first
        then = re.search(r'href="(\?first=\d+)">The next', first)
        assert then is not None
        assert rows(service.browse("GET", f"/fleet{then[1]}").text) == whole[2:4]
    assert rows(service.browse("GET", "/fleet?state=good").text) == good
    assert f'<a href="?state=good">Good: {len(good)}</a>' in first
    for words, count in Counter(row[0].partition(" for ")[0] for row in whole).items():
        assert f">{words}: {count}<" in first
    assert service.browse("GET", "/fleet?state=unheard").status_code == 422


def test_no_fault_after_a_fault_is_not_all_clear(service: Inside) -> None:
    with service.service.library.transaction("test") as session:
        keep(session, "arm", "healed", now() - timedelta(days=2), {}, "notch")
        newest = keep(session, "arm", "healed", now(), {}, "normal")
        newest.erased_at, identity = now(), newest.id
    page = service.browse("GET", f"/diagnoses/{identity}").text
    first = page.partition('class="glance"')[2].partition('id="revise"')[0]
    assert "Tooth damage was named" in first
    assert "Nothing to do" not in first
    assert "verdict normal" not in first
