"""Every page, for every role, in a real browser: clean console, nothing leaves the host, nobody is locked out."""

import csv
import io
import json
import re
from pathlib import Path
from urllib.parse import urlencode

import pytest
from playwright.sync_api import Page, expect

from app.http.security import COOKIE, csrf_token
from benchmarks.harness.live import gearcase, sign_in
from benchmarks.harness.site import ADMIN_PAGES, EVERY_PAGE, OPERATOR_PAGES, Site, browsing, parts
from benchmarks.harness.sounds import sound, wav
from benchmarks.harness.worked_out import worked_out
from tests.signals.synthetic import disturbed
from tests.web.conftest import Tab, settle
from tests.web.reading import Markup

pytestmark = pytest.mark.browser

AXE = Path(__file__).resolve().parents[2] / "node_modules" / "axe-core" / "axe.min.js"
SERIOUS = """async (options) => (await axe.run(options)).violations
    .filter((one) => ["serious", "critical"].includes(one.impact))
    .map((one) => [one.id, one.nodes[0].html.slice(0, 200)])"""
NARROW = ["color-contrast", "scrollable-region-focusable"]
"""Rules that another width and other colours can break on a page that kept all of them wide and light."""
RAW = {"ambiguous", "not_in_library", "notch", "play", "bump", "case.retained", "diagnosis.given"}
"""Names of the interface for programs."""
OPTIONS = {"preload": False, "resultTypes": ["violations"]}
"""Preloading would make axe itself put a style into the page, which the content security policy refuses."""
BROKEN = """() => {
    const found = [];
    const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walk.nextNode()) {
        const node = walk.currentNode;
        if (!node.parentElement.checkVisibility()) continue;
        if (node.parentElement.closest("pre, code, svg, .filename, .name, .visually-hidden")) continue;
        for (const word of node.data.matchAll(/(?<![0-9_\\p{L}])\\p{L}{2,}(?![0-9_\\p{L}])/gu)) {
            const range = document.createRange();
            range.setStart(node, word.index);
            range.setEnd(node, word.index + word[0].length);
            const boxes = [...range.getClientRects()].filter((one) => one.width);
            if (new Set(boxes.map((one) => Math.round(one.top))).size > 1) found.push(word[0]);
        }
    }
    return found;
}"""
"""Words that stand on two lines without a hyphen or a space between."""
SIDEWAYS = """() => [...document.querySelectorAll("main, main .table-scroll")]
    .filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent.trim().slice(0, 80))"""


def address(site: Site, path: str) -> str:
    return path.format(
        diagnosis=site.diagnosis, case=site.case, recording=site.recorded, investigation=site.investigation
    )


@pytest.mark.parametrize("path", EVERY_PAGE)
def test_page_is_clean_and_accessible_and_fits(tab: Tab, site: Site, path: str) -> None:
    """No error, no foreign request; axe finds no serious fault, wide in light and narrow in dark; 360 px are enough."""
    check(tab, address(site, path))


def test_a_report_fits_a_telephone_without_a_script(only_page: Page, site: Site, tmp_path: Path) -> None:
    only_page.set_viewport_size({"width": 360, "height": 700})
    for path in (f"/diagnoses/{site.diagnosis}/report.html", f"/investigations/{site.investigation}/report.html"):
        with browsing(site, "viewer") as client:
            (tmp_path / "report.html").write_text(client.get(path).raise_for_status().text, "utf-8")
        only_page.goto((tmp_path / "report.html").as_uri())
        assert only_page.evaluate("() => document.documentElement.scrollWidth") <= 360, path
        assert only_page.evaluate(BROKEN) == [], path


def test_page_of_a_disturbed_recording_is_clean_and_accessible_and_fits(tab: Tab, site: Site) -> None:
    with site.server.client() as client:
        files = parts("field.wav", wav(disturbed().samples), b"{}")
        made = client.post("/api/v1/diagnoses", files=files).raise_for_status().json()
    assert {"silence", "bump"} <= {each["kind"] for each in made["disturbances"]}
    check(tab, f"/diagnoses/{made['id']}")


def check(tab: Tab, path: str) -> None:
    """Hold one page against axe and the width of a telephone."""
    with tab(path) as page:
        settle(page)
        expect(page.locator("h1").first).to_be_visible()
        check_as_it_is(page)


def check_as_it_is(page: Page) -> None:
    if not AXE.exists():
        pytest.skip("axe-core is not installed: make setup installs it")
    page.evaluate(AXE.read_text())
    assert page.evaluate(SERIOUS, OPTIONS) == []
    page.emulate_media(color_scheme="dark", reduced_motion="reduce")
    page.set_viewport_size({"width": 360, "height": 700})
    page.wait_for_function("() => document.documentElement.scrollWidth <= 360")
    assert page.evaluate(SERIOUS, {**OPTIONS, "runOnly": NARROW}) == []
    page.evaluate("() => document.querySelectorAll('main details').forEach((one) => (one.open = true))")
    assert page.evaluate(SIDEWAYS) == []
    assert page.evaluate(BROKEN) == []


def test_pages_need_no_script_and_have_one_word_for_a_verdict(site: Site) -> None:
    """Charts are drawn by the server, sounds have a player, and every form has a button that sends it."""
    with browsing(site, "admin") as client:
        for path in EVERY_PAGE:
            page = Markup(client.get(address(site, path)).raise_for_status().text)
            names = [tag for tag, _ in page.tags]
            assert "h1" in names, path
            assert not RAW & set(re.findall(r"[\w.]+", page.text)), path  # pages have own words
            assert names.count("form") <= sum(
                tag == "button" and given.get("type", "submit") == "submit" for tag, given in page.tags
            ), path
            plots = [given for _, given in page.tags if "data-plot" in given]
            assert len(plots) <= page.count("svg", class_="chart", role="img"), path
            assert all("audio" in names for _, given in page.tags if "data-audio" in given), path


def test_evaluation_with_simulated_cases_stands_beside_that_without(site: Site) -> None:
    with browsing(site, "viewer") as client:
        both = Markup(worked_out(client.get, "/library/evaluation"))
        alone = Markup(worked_out(client.get, "/library/evaluation?origin=measured"))
        assert "right in <a" in client.get("/library").text
    with site.server.client("viewer") as client:
        document = client.get("/api/v1/library/evaluation").json()
    assert "without" in both.ids
    assert "without" not in alone.ids
    assert document["without_simulated"]["left_out_class_called_new"].keys() == document["confusion"].keys()
    printed = json.loads(gearcase("evaluate", "--json", data_dir=site.server.data_dir).stdout)
    assert printed["without_simulated"] == document["without_simulated"]
    assert printed["accuracy_by_origin"].keys() == {"measured", "simulated", "both"}
    assert printed["accuracy_by_origin"]["measured"] == document["without_simulated"]["accuracy"]


@pytest.mark.parametrize(
    ("role", "refused"), [("viewer", (*OPERATOR_PAGES, *ADMIN_PAGES)), ("operator", ADMIN_PAGES), ("admin", ())]
)
def test_roles_see_what_they_may_do(site: Site, role: str, refused: tuple[str, ...]) -> None:
    """A role opens its pages, is refused the others in words, and is not offered what it may not do."""
    with browsing(site, role) as client:
        for path in EVERY_PAGE:
            answer = client.get(address(site, path))
            assert answer.status_code == (403 if path in refused else 200), (role, path)
            if path in refused:
                assert "needs the role" in answer.text
        links = Markup(client.get("/library").text).links
        assert {"/keys", "/library/add"} <= links or role != "admin"
        assert not {"/keys", "/library/add"} & links or role == "admin"
        story = Markup(client.get(f"/investigations/{site.investigation}").text)
        offered = f"/investigations/{site.investigation}/accept" in story.forms
        assert offered == (role == "admin" and "Accepted as" not in story.text)


def test_pages_lead_to_sign_in(site: Site) -> None:
    """Without a key every page but the demonstration leads to the sign-in page, and back afterwards."""
    with browsing(site, None) as client:
        for path in EVERY_PAGE:
            answer = client.get(address(site, path))
            assert answer.status_code == 303, path
            assert "/sign-in?next=" in answer.headers["location"]
        assert client.get("/").status_code == 200


def test_signing_in_leads_to_no_other_site(site: Site) -> None:
    with browsing(site, None) as client:
        answer = sign_in(client, site.server.keys["viewer"], "//elsewhere.example/")
    assert answer.headers["location"] == "/"


EVIL = '<img src=x onerror="document.title=1">'


def plant(site: Site) -> list[str]:
    """Put markup and formulas into every field that takes words; return pages that show only what was planted."""
    told = {"gearbox": EVIL, "axis": "=cmd()", "label": "normal", "notes": EVIL, "verified_by": EVIL}
    with site.server.client() as client:
        files = parts(f"{EVIL}.wav", sound(11), json.dumps(told).encode())
        case = client.post("/api/v1/cases", files=files).raise_for_status().json()["id"]
        files = parts(f"{EVIL}.wav", sound(12), json.dumps({"axis": EVIL, "gearbox": EVIL}).encode())
        diagnosis = client.post("/api/v1/diagnoses", files=files).raise_for_status().json()["id"]
        verdict = {"verdict": "corrected", "label": "notch", "verified_by": EVIL, "note": EVIL}
        client.patch(f"/api/v1/diagnoses/{diagnosis}", json=verdict).raise_for_status()
        client.post("/api/v1/keys", json={"name": "=1+1" + EVIL, "role": "viewer"}).raise_for_status()
    with browsing(site, "admin") as client:
        token = csrf_token(client.cookies[COOKIE])
        for text in (EVIL, "=2+5"):
            mark = {"text": text, "at": "2026-11-20T14:03", "gearbox": EVIL, "csrf": token}
            assert client.post("/axes/bench/marks", data=mark).status_code == 303
    return [f"/cases/{case}", f"/diagnoses/{diagnosis}", f"/diagnoses/{diagnosis}/report.html", "/axes/%3Dcmd()"]


def test_hostile_words_stay_words(tab: Tab, site: Site) -> None:
    """Markup in a file name or any field is shown as text on every page, and no cell of a CSV is a formula."""
    own = plant(site)
    searched = f"/library?{urlencode({'gearbox': EVIL, 'axis': EVIL})}"
    shown = 0
    with browsing(site, "admin") as client:
        for path in (*own, searched, *(address(site, page) for page in EVERY_PAGE)):
            answer = client.get(path).raise_for_status()
            page = Markup(answer.text)
            assert not any("onerror" in given or given.get("src") == "x" for _, given in page.tags), path
            shown += EVIL in page.text
        table = client.get("/audit.csv").text
    assert shown >= len(own)
    cells = [cell for row in csv.reader(io.StringIO(table)) for cell in row]
    assert any("=1+1" in cell for cell in cells)
    assert not any(cell.startswith(("=", "+", "-", "@", "\t", "\r")) for cell in cells)
    with tab(own[0]) as opened_page:
        assert opened_page.title() != "1"
        assert opened_page.locator("img[src=x]").count() == 0
