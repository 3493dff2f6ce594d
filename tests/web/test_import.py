"""Many recordings at once: a dropped folder becomes a table, the table cases, and one undo takes them back."""

from collections import Counter
from pathlib import Path

import pytest
from playwright.sync_api import BrowserContext, Page, Route, expect

from benchmarks.harness.live import LiveServer
from benchmarks.harness.site import Site
from benchmarks.harness.sounds import sound
from tests.web.conftest import Opened, Tab
from tests.web.test_pages import check_as_it_is

pytestmark = pytest.mark.browser

KINDS = {"good": "normal", "Backlash": "play", "tooth damage": "notch", "pitting": "pitting"}
BOXES = ("g11", "g12", "g13")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 recordings of three gearboxes, a folder each, and a file that is no recording."""
    top = tmp_path_factory.mktemp("recordings") / "november"
    for number, box in enumerate(BOXES):
        (top / "axis 9" / box).mkdir(parents=True)
        for kind, name in enumerate(KINDS):
            for k in (1, 2):
                content = sound(1000 + 100 * number + 10 * kind + k, impacts=name != "good")
                (top / "axis 9" / box / f"{name} {k}.wav").write_bytes(content)
    (top / "Thumbs.db").write_bytes(b"no sound")
    return top


def drop(page: Page, *paths: Path) -> None:
    """What a mouse does that lets folders or files go over a page."""
    session = page.context.new_cdp_session(page)
    for kind in ("dragEnter", "dragOver", "drop"):
        data = {"items": [], "files": [str(path) for path in paths], "dragOperationsMask": 1}
        session.send("Input.dispatchDragEvent", {"type": kind, "x": 200, "y": 300, "data": data})


def cases(server: LiveServer) -> Counter[tuple[str, str]]:
    """How many cases of axis 9 the library has, by gearbox and label."""
    with server.client() as client:
        items = client.get("/api/v1/cases?axis=axis%209&limit=200").raise_for_status().json()["items"]
    return Counter((each["recording"]["gearbox"], each["label"]) for each in items)


def test_a_folder_becomes_cases_and_one_undo_takes_all_back(opened: Opened, site: Site, folder: Path) -> None:
    wanted = Counter({(box, label): 2 for box in BOXES for label in KINDS.values()})
    corrected = wanted - Counter({("g13", "pitting"): 1}) + Counter({("g13", "scored_face"): 1})
    with opened("admin", "/library/add") as page:
        drop(page, folder)
        rows, status = page.locator(".many tbody tr"), page.locator(".many [data-status]")
        expect(rows).to_have_count(24)
        expect(status).to_contain_text("no recordings: 1")
        expect(page.locator("[data-found]:empty")).to_have_count(0, timeout=120_000)
        expect(rows.first.locator("[data-found]")).to_contain_text("Cycle of")
        row = rows.filter(has_text="g13/pitting 2.wav")
        row.get_by_label("Label of").select_option("+")
        page.get_by_role("textbox", name="Name of the new label").fill("Scored face")
        page.keyboard.press("Enter")
        expect(row.get_by_label("Label of")).to_have_value("scored_face")
        page.get_by_label("Verified, the same for all").select_option("opened")
        expect(page.locator("input[name=recorded_at][value='']")).to_have_count(0)
        page.get_by_label("Recorded, the same for all").fill("2026-01-02T03:04")
        for attempt in range(2):
            page.get_by_role("button", name="Keep all as cases").click()
            expect(status).to_contain_text("24 of 24 recordings done; gearboxes with cases: 3", timeout=120_000)
            assert cases(site.server) == corrected, attempt
            with site.server.client() as client:
                known = client.get("/api/v1/cases?axis=axis%209").json()["items"]
            assert all(each["recording"]["recorded_at"] == "2026-01-02T03:04:00Z" for each in known)
            page.get_by_role("button", name="Undo").click()
            expect(status).to_contain_text("24 recordings.")
            assert cases(site.server) == Counter()
        page.get_by_role("button", name="Keep all as cases").click()
        page.get_by_role("link", name="See them in the library").click(timeout=120_000)
        expect(page.get_by_text("24 cases were kept.")).to_be_visible()
        page.get_by_role("button", name="Undo").click()
        expect(page.get_by_text("Taken back: all")).to_be_visible()
    assert cases(site.server) == Counter()


def test_faults_stand_at_their_row_and_a_busy_service_is_asked_again(
    contexts: dict[str | None, BrowserContext], site: Site, tmp_path: Path
) -> None:
    known, asked = tmp_path / "g1 notch.wav", Counter[str]()
    known.write_bytes(sound(1))  # of the library, where it is normal
    (tmp_path / "g9 pitting.wav").write_bytes(b"no sound")
    (tmp_path / "g9 corrosion.wav").write_bytes(sound(77))

    def busy_at_first(route: Route) -> None:
        key = route.request.headers["idempotency-key"]
        asked[key] += 1
        answer = {"status": 503, "headers": {"Retry-After": "1"}, "json": {"detail": "busy"}}
        route.fulfill(**answer) if asked[key] == 1 else route.continue_()  # type: ignore[arg-type]

    page = contexts["admin"].new_page()
    page.route("**/api/v1/cases", busy_at_first)
    page.goto(site.url + "/fleet")
    drop(page, *sorted(tmp_path.iterdir()))
    rows = page.locator(".many tbody tr")
    expect(rows).to_have_count(3)
    page.get_by_label("Verified, the same for all").focus()
    page.keyboard.type("by ear")
    page.get_by_role("button", name="Keep all as cases").press("Enter")
    states = rows.locator("[data-state]")
    expect(states.nth(0)).to_contain_text("this sound is case", timeout=60_000)
    expect(states.nth(1)).to_have_text("kept", timeout=60_000)
    expect(states.nth(2)).to_contain_text("WAV", timeout=60_000)
    assert set(asked.values()) == {2}
    page.get_by_role("button", name="Undo").press("Enter")
    expect(states.nth(1)).to_have_text("taken back")
    page.close()


NAMES = {
    "axis-a/SN 4711/tight-backlash2.wav": ("play", "SN 4711", "axis-a"),
    "bench_g1_not_good_3.wav": ("", "g1", "bench"),
    "4711-normal-01.wav": ("normal", "4711", ""),
    "4711-tooth_damage-02.wav": ("notch", "4711", ""),
    "20261130 normal wear.wav": ("normal_wear", "", ""),
    "playback good.wav": ("normal", "", ""),
}


def test_names_of_files_and_folders_say_what_a_recording_is(tab: Tab, tmp_path: Path) -> None:
    """The filled table is accessible, and fits a telephone."""
    for name in NAMES:
        (tmp_path / "all" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "all" / name).write_bytes(sound(5, seconds=3))
    with tab("/library/add") as page:
        drop(page, tmp_path / "all")
        rows = page.locator(".many tbody tr")
        expect(rows).to_have_count(len(NAMES))
        expect(page.locator("[data-found]:empty")).to_have_count(0, timeout=60_000)
        expect(rows.last.locator("[data-found]")).to_contain_text("The same as all/")
        for name, wanted in NAMES.items():
            lists = (page.get_by_label(f"{each} of all/{name}") for each in ("Label", "Gearbox", "Axis"))
            found = tuple(each.input_value() for each in lists)
            assert found == wanted, name
        check_as_it_is(page)


def test_several_dropped_recordings_of_an_operator_are_diagnosed(opened: Opened, folder: Path) -> None:
    with opened("operator", "/library") as page:
        drop(page, *sorted((folder / "axis 9" / "g11").glob("good *")))
        expect(page.locator(".many select[name=label]")).to_have_count(0)
        lists = page.locator(".many td select[name=gearbox]")
        lists.first.select_option("+")
        page.get_by_role("textbox", name="Name of the new gearbox").fill("G-1")
        page.keyboard.press("Enter")
        page.get_by_role("textbox", name="No gearbox G-1 is known").press("Enter")
        expect(lists.first).to_have_value("g1")  # is asked about, not taken as another
        expect(page.locator(".primary:visible")).to_have_count(1)
        page.get_by_role("button", name="Diagnose all").click()
        expect(page.get_by_role("link", name="diagnosed")).to_have_count(2, timeout=60_000)
