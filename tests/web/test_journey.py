"""What people do: the first ten minutes, diagnose, listen and confirm by keyboard, follow a trend."""

import gzip
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.web.conftest import Opened, Site, browsing

pytestmark = pytest.mark.browser


def test_first_ten_minutes(opened: Opened, site: Site) -> None:
    """Open the printed address, see a finished diagnosis with its sound, sign in, drop a recording, read, confirm."""
    with opened(None, "/") as page:
        expect(page.get_by_text("This is a demonstration")).to_be_visible()
        expect(page.locator("section.verdict h1")).not_to_be_empty()
        expect(page.get_by_role("button", name="Listen")).to_be_visible()
        page.get_by_role("link", name="Sign in").click()
        page.get_by_label("Key", exact=True).fill(site.server.keys["operator"])
        page.get_by_role("button", name="Sign in").click()
        page.goto(site.url + "/diagnoses/new")
        form = page.locator("main form[data-upload]")
        form.locator("input[type=file]").set_input_files(site.recording)
        expect(form.locator("[data-detected]")).to_have_text("axis 4, monday.wav: 8000 Hz, 1 channel, 8.0 s")
        form.get_by_label("Largest speed").fill("2,5")
        form.get_by_role("button", name="Diagnose").click()
        page.wait_for_url("**/diagnoses/*")
        expect(page.locator("section.verdict h1")).not_to_be_empty()
        expect(page.locator("#curl")).to_contain_text('"speed_rad_s": 2.5')


def test_dropped_recording_is_diagnosed(opened: Opened, site: Site) -> None:
    """A file dropped on any page opens the form with what was detected."""
    content = list(site.recording.read_bytes())
    with opened("operator", "/library") as page:
        page.evaluate(
            """bytes => {
                const data = new DataTransfer();
                data.items.add(new File([new Uint8Array(bytes)], "dropped.wav", {type: "audio/wav"}));
                const options = {dataTransfer: data, bubbles: true, cancelable: true};
                for (const kind of ["dragenter", "dragover", "drop"])
                    document.body.dispatchEvent(new DragEvent(kind, options));
            }""",
            content,
        )
        dialog = page.locator("dialog#diagnose")
        expect(dialog).to_be_visible()
        expect(dialog.locator("[data-detected]")).to_contain_text("dropped.wav: 8000 Hz")
        dialog.get_by_role("button", name="Diagnose").click()
        page.wait_for_url("**/diagnoses/*")


def test_diagnose_listen_confirm_by_keyboard(opened: Opened, site: Site) -> None:
    """No mouse: ? lists the keys, space plays, c confirms, z takes it back."""
    with opened("operator", f"/diagnoses/{site.diagnosis}") as page:
        expect(page.get_by_role("button", name="Listen")).to_be_visible()
        page.keyboard.press("?")
        expect(page.locator("dialog#keys")).to_contain_text("Confirm the diagnosis")
        page.keyboard.press("Escape")
        page.keyboard.press("Space")
        expect(page.locator("[data-play]")).to_have_text("Pause")
        page.keyboard.press("Space")
        expect(page.locator("[data-play]")).to_have_text("Listen")
        page.get_by_label("Label, if corrected").fill("notch")
        page.locator("h1").first.click()
        page.keyboard.press("x")
        expect(page.get_by_text("Marked corrected")).to_be_visible()
        page.keyboard.press("z")
        expect(page.get_by_text("Marked corrected")).to_have_count(0)


def test_plots_become_interactive(opened: Opened, site: Site) -> None:
    """The drawing of the server gives way to a canvas whose cursor is linked to the other plots over time."""
    with opened("viewer", f"/diagnoses/{site.diagnosis}") as page:
        page.locator("[data-plot]").first.scroll_into_view_if_needed()
        expect(page.locator("[data-plot][data-ready] canvas").first).to_be_visible()


def test_hundred_thousand_points_draw_within_a_frame_or_six(opened: Opened, site: Site) -> None:
    """100,000 points are drawn in less time than a person notices; the figure is printed, the bound is generous."""
    with opened("viewer", f"/diagnoses/{site.diagnosis}") as page:
        page.wait_for_load_state("networkidle")
        took = page.evaluate(
            """() => {
                const x = Array.from({length: 100000}, (_, k) => k / 8000);
                const y = x.map((t) => Math.sin(t * 40) * Math.random());
                const host = document.createElement("div");
                document.body.append(host);
                const began = performance.now();
                new uPlot({width: 900, height: 240, series: [{}, {stroke: "red"}]}, [x, y], host);
                return performance.now() - began;
            }"""
        )
        print(f"100,000 points drawn in {took:.0f} ms")
        assert took < 1000


def test_error_is_a_sentence_with_the_way_out(opened: Opened, site: Site) -> None:
    with browsing(site, "viewer") as client:
        answer = client.get("/diagnoses/none")
        assert answer.status_code == 404
        assert "no diagnosis has the id" in answer.text
        assert "To the start" in answer.text


def test_report_is_one_file(site: Site) -> None:
    """The report names no address to fetch anything from, and the PDF is one."""
    with browsing(site, "viewer") as client:
        page = client.get(f"/diagnoses/{site.diagnosis}/report.html").text
        assert "<script" not in page
        assert page.count("src=") == page.count('src="data:image/png;base64,') == 1
        assert "http" not in page.replace("http://www.w3.org", "")
        assert client.get(f"/diagnoses/{site.diagnosis}/report.pdf").content.startswith(b"%PDF-")


def test_script_weight() -> None:
    """All scripts together stay under 150 KB compressed."""
    folder = Path(__file__).resolve().parents[2] / "app" / "web" / "static"
    if not (folder / "vendor").exists():
        pytest.skip("browser libraries are not installed: make setup installs them")
    size = sum(len(gzip.compress(path.read_bytes())) for path in folder.rglob("*.js"))
    print(f"scripts: {size / 1000:.0f} kB compressed")
    assert size < 150_000
