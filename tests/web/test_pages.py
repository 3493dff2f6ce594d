"""Every page, for every role, in a real browser: clean console, nothing leaves the host, nobody is locked out."""

import json
import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.app.sounds import sound
from tests.web.conftest import Opened, Site, Tab, browsing, parts

pytestmark = pytest.mark.browser

AXE = Path(__file__).resolve().parents[2] / "node_modules" / "axe-core" / "axe.min.js"
SERIOUS = """async (options) => (await axe.run(options)).violations
    .filter((one) => ["serious", "critical"].includes(one.impact))
    .map((one) => [one.id, one.nodes[0].html.slice(0, 200)])"""
RULES = {
    "light": {"preload": False},
    "dark": {"preload": False, "runOnly": ["color-contrast", "link-in-text-block"]},
}
"""What axe looks at: everything in light; in dark what a change of colours can break. Preloading would make axe
itself put a style into the page, which the content security policy refuses."""
VIEWER_PAGES = (
    "/diagnoses",
    "/diagnoses/{diagnosis}",
    "/diagnoses/{diagnosis}?axis=orders&overlay={case}",
    "/library",
    "/library/map?recording={recording}",
    "/library/review",
    "/library/coverage",
    "/library/evaluation",
    "/cases/{case}",
    "/axes",
    "/axes/bench",
    "/axes/bench/try",
    "/investigations",
)
OPERATOR_PAGES = ("/diagnoses/new", "/investigations/new", "/jobs")
ADMIN_PAGES = ("/library/add", "/library/exchange", "/library/simulate", "/keys", "/audit")
EVERY_PAGE = (*VIEWER_PAGES, *OPERATOR_PAGES, *ADMIN_PAGES)


def address(site: Site, path: str) -> str:
    return path.format(diagnosis=site.diagnosis, case=site.case, recording=site.recorded)


@pytest.mark.parametrize("path", EVERY_PAGE)
def test_page_is_clean_and_accessible_and_fits(tab: Tab, site: Site, path: str) -> None:
    """No error, no foreign request, axe finds no serious fault in light and in dark, and 360 px are enough."""
    if not AXE.exists():
        pytest.skip("axe-core is not installed: make setup installs it")
    with tab(address(site, path)) as page:
        page.wait_for_load_state("networkidle")
        expect(page.locator("h1").first).to_be_visible()
        page.evaluate(AXE.read_text())
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            found = page.evaluate(SERIOUS, RULES[scheme])
            assert found == [], scheme
        page.set_viewport_size({"width": 360, "height": 700})
        assert page.evaluate("document.documentElement.scrollWidth") <= 360


@pytest.mark.parametrize("path", EVERY_PAGE)
def test_page_works_without_script(plain: Tab, site: Site, path: str) -> None:
    """Charts are drawn by the server and nothing waits for a script."""
    with plain(address(site, path)) as page:
        expect(page.locator("h1").first).to_be_visible()
        if path.startswith("/diagnoses/{diagnosis}"):
            assert page.locator("svg.chart").count() >= 4
            expect(page.locator("audio")).to_be_visible()


@pytest.mark.parametrize(
    ("role", "refused"), [("viewer", (*OPERATOR_PAGES, *ADMIN_PAGES)), ("operator", ADMIN_PAGES), ("admin", ())]
)
def test_roles_see_what_they_may_do(opened: Opened, site: Site, role: str, refused: tuple[str, ...]) -> None:
    """A role opens its pages, is refused the others in words, and is not offered what it may not do."""
    with browsing(site, role) as client:
        for path in EVERY_PAGE:
            answer = client.get(address(site, path))
            assert answer.status_code == (403 if path in refused else 200), (role, path)
            if path in refused:
                assert "needs the role" in answer.text
    with opened(role, "/library") as page:
        assert page.get_by_role("link", name="Keys").count() == (1 if role == "admin" else 0)
        assert page.get_by_role("link", name="Add a case").count() == (1 if role == "admin" else 0)


def test_pages_lead_to_sign_in(site: Site) -> None:
    """Without a key every page but the demonstration leads to the sign-in page, and back afterwards."""
    with browsing(site, None) as client:
        for path in EVERY_PAGE:
            answer = client.get(address(site, path))
            assert answer.status_code == 303, path
            assert "/sign-in?next=" in answer.headers["location"]
        assert client.get("/").status_code == 200


def test_forms_need_the_token(site: Site) -> None:
    """A form that another site made a signed-in browser send is refused, and nothing changes."""
    with browsing(site, "admin") as client:
        answer = client.post("/library/change", data={"action": "retire", "case_id": site.case})
        assert answer.status_code == 403
        made = client.post("/keys", data={"name": "stolen", "role": "admin", "csrf": "0" * 64})
        assert made.status_code == 403
    with site.server.client() as client:
        assert client.get(f"/api/v1/cases/{site.case}").json()["state"] == "confirmed"
        assert "stolen" not in client.get("/api/v1/keys").text


def test_cookie_is_hidden_from_scripts(site: Site) -> None:
    with browsing(site, None) as client:
        answer = client.post("/sign-in", data={"key": site.server.keys["viewer"], "next": "//elsewhere.example/"})
    assert answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


def test_hostile_words_stay_words(opened: Opened, site: Site) -> None:
    """Markup in a file name, gearbox, note or key name is shown as text, and no cell of a CSV is a formula."""
    evil = '<img src=x onerror="document.title=1">'
    with site.server.client() as client:
        metadata = {"gearbox": evil, "axis": "=cmd()", "label": "normal", "notes": evil, "verified_by": evil}
        files = parts(f"{evil}.wav", sound(11), json.dumps(metadata).encode())
        case = client.post("/api/v1/cases", files=files).raise_for_status().json()["id"]
        client.post("/api/v1/keys", json={"name": "=1+1" + evil, "role": "viewer"}).raise_for_status()
    for path in (f"/cases/{case}", "/library", "/keys", "/audit", "/axes", "/library/map"):
        with opened("admin", path) as page:
            assert page.title() != "1"
            assert page.locator("img[src=x]").count() == 0
    with browsing(site, "admin") as client:
        table = client.get("/audit.csv").text
    assert not re.search(r'(^|,)"?=', table, re.MULTILINE)
