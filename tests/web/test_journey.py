"""What people do: the first ten minutes, diagnose, listen and confirm by keyboard, follow a trend."""

import gzip
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from app.http.security import COOKIE, csrf_token
from app.investigations import get_investigation, names_of
from benchmarks.harness.live import gearcase, started
from benchmarks.harness.site import Site, browsing
from benchmarks.harness.sounds import sound
from tests.web.conftest import Opened, settle, watched
from tests.web.reading import Markup

pytestmark = pytest.mark.browser

DIAGNOSIS = re.compile(r"/diagnoses/[0-9a-f]{32}$")


@pytest.fixture
def fresh(tmp_path: Path, site: Site) -> Iterator[Site]:
    """What `make run` starts: the starter library with its demonstration, and nothing else."""
    data_dir = tmp_path / "data"
    data_dir.mkdir()
    done = gearcase("starter", "--per-label", "1", "--processes", "1", data_dir=data_dir)
    assert done.code == 0, done.stderr
    assert "simulated 3 of 3 cases" in done.stderr  # how far it is, without a terminal too
    server = started(data_dir)
    yield Site(server, site.recording)
    server.stop()


def test_first_ten_minutes(browser: Browser, fresh: Site) -> None:
    """Open the printed address, see a finished diagnosis with its sound, sign in, send a recording, read it."""
    site, context = fresh, browser.new_context()
    with watched(context.new_page(), site, "/") as page:
        expect(page.get_by_text("This is a demonstration")).to_be_visible()
        expect(page.locator("section.verdict h1")).not_to_be_empty()
        expect(page.get_by_role("button", name="Listen", exact=True)).to_be_visible()
        page.get_by_role("link", name="Sign in").click()
        page.get_by_label("Key", exact=True).fill(site.server.keys["operator"])
        page.get_by_role("button", name="Sign in").click()
        page.goto(site.url + "/diagnoses/new")
        form = page.locator("main form[data-upload]")
        form.locator("input[type=file]").set_input_files(site.recording)
        expect(form.locator("[data-detected]")).to_have_text("axis 4, monday.wav: 0.13 MB, 8.0 s")
        form.get_by_label("Largest speed").fill("2,5")
        form.get_by_role("button", name="Diagnose").click()
        page.wait_for_url(DIAGNOSIS)
        expect(page.locator("section.verdict h1")).not_to_be_empty()
        expect(page.locator("#curl")).to_contain_text('"speed_rad_s": 2.5')
    context.close()


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
        expect(dialog.locator("[data-detected]")).to_contain_text(re.compile(r"dropped\.wav: .* s$"))
        dialog.get_by_label("Axis", exact=True).fill("bench")
        dialog.get_by_label("Largest speed").fill("2,5")
        dialog.get_by_role("button", name="Diagnose").click()
        page.wait_for_url(DIAGNOSIS)
        expect(page.locator(".crumbs")).to_contain_text("bench")


def test_diagnose_listen_confirm_by_keyboard(opened: Opened, site: Site) -> None:
    """No mouse: ? lists the keys, space plays, x corrects, z takes it back."""
    with opened("operator", f"/diagnoses/{site.diagnosis}") as page:
        expect(page.get_by_role("button", name="Listen", exact=True)).to_be_visible()
        page.keyboard.press("?")
        expect(page.locator("dialog#keys")).to_contain_text("It was tooth damage")
        page.keyboard.press("Escape")
        page.keyboard.press("Space")
        expect(page.locator("[data-play]")).to_have_text("Pause")
        page.keyboard.press("Space")
        expect(page.locator("[data-play]")).to_have_text("Listen")
        page.get_by_label("The right name").select_option("notch")
        page.locator("h1").first.click()
        page.keyboard.press("x")
        expect(page.get_by_text("Marked corrected")).to_be_visible()
        page.wait_for_load_state()  # a key that is pressed before the page's script runs is lost
        page.keyboard.press("z")
        expect(page.get_by_text("Marked corrected")).to_have_count(0)


def test_a_chosen_theme_stays(opened: Opened) -> None:
    with opened("viewer", "/fleet", color_scheme="light") as page:
        page.keyboard.press("t")
        page.reload()
        expect(page.locator("html")).to_have_attribute("data-theme", "dark")


def test_plots_become_interactive(opened: Opened, site: Site) -> None:
    """The drawing of the server gives way to a canvas; one cursor is read in every plot over time."""
    with opened("viewer", f"/diagnoses/{site.diagnosis}") as page:
        page.locator("#details > summary").click()
        for name in ("waveform", "crest"):
            page.locator(f"#plot-{name}").scroll_into_view_if_needed()
            expect(page.locator(f"#plot-{name} [data-ready] canvas")).to_be_visible()
        page.locator("#plot-waveform .u-over").hover()
        expect(page.locator("#plot-waveform .legend output").first).to_contain_text(" s")
        expect(page.locator("#plot-crest .legend output").first).to_contain_text(" s")


def test_evidence_leads_to_its_plot(opened: Opened, site: Site) -> None:
    """A row of the evidence names a plot of the page, and a click brings it into sight."""
    with opened("viewer", f"/diagnoses/{site.diagnosis}") as page:
        page.locator("#details > summary").click()
        link = page.locator("#evidence a[href^='#plot-']").first
        target = page.locator(str(link.get_attribute("href")))
        link.click()
        expect(target).to_be_in_viewport()


def test_paper_is_white_and_holds_the_words(opened: Opened, site: Site) -> None:
    """Printed from dark: dark words on white, no navigation, no buttons, all of the verdict."""
    with opened("operator", f"/diagnoses/{site.diagnosis}", color_scheme="dark") as page:
        settle(page)
        verdict = page.locator("section.verdict").inner_text()
        page.emulate_media(media="print")
        assert page.locator("section.verdict").inner_text() == verdict
        for gone in (".masthead", "footer", "#listen", "button:visible"):
            expect(page.locator(gone).locator("visible=true")).to_have_count(0)
        colours = page.evaluate(
            """() => [document.documentElement, document.querySelector(".verdict")]
                .map((one) => [getComputedStyle(one).backgroundColor, getComputedStyle(one).color])"""
        )
        for ground, ink in colours:
            assert ground == "rgb(255, 255, 255)"
            assert max(int(part) for part in re.findall(r"\d+", ink)) < 64
        assert page.pdf().startswith(b"%PDF-")


def test_forms_work_without_script(opened: Opened, site: Site) -> None:
    """Send a recording, read its diagnosis and confirm it, with no script at all."""
    with opened("operator", "/diagnoses/new", java_script_enabled=False) as page:
        form = page.locator("main form")
        form.get_by_label("Recording", exact=True).set_input_files(site.recording)
        form.get_by_role("button", name="Diagnose", exact=True).click()
        expect(page.locator("section.verdict h1")).not_to_be_empty()
        expect(page.locator("audio")).to_be_visible()
        page.get_by_role("button", name="tooth damage").click()
        expect(page.get_by_text("Marked confirmed")).to_be_visible()


def test_sound_is_asked_to_be_held_against_sound_as_new(opened: Opened, site: Site) -> None:
    """Two recordings as new may be chosen; what is kept says which was which."""
    new = [{"name": f"{month}.wav", "mimeType": "audio/wav", "buffer": sound(seed)}
           for seed, month in enumerate(("may", "june"), start=1)]  # fmt: skip
    with opened("operator", "/investigations/new") as page:
        page.get_by_label("Axis or robot").select_option("axis/bench")
        page.get_by_label("Sound", exact=True).set_input_files(site.recording)
        page.get_by_label("Sound as new").set_input_files(new)  # type: ignore[arg-type]
        page.get_by_role("button", name="Investigate").click()
        page.wait_for_url("**/jobs/*")
        identity = page.url.rsplit("/", 1)[1]
    with site.library().reading() as session:
        row = get_investigation(session, identity)
        assert names_of(row, "as_new") == ["may.wav", "june.wav"]
        assert names_of(row, "sound") == [site.recording.name]
    with site.server.client() as client:
        client.delete(f"/api/v1/jobs/{identity}").raise_for_status()


def test_an_investigation_is_started_from_a_diagnosis_and_leads_back(opened: Opened, site: Site) -> None:
    with opened("operator", f"/diagnoses/{site.diagnosis}") as page:
        page.get_by_role("link", name="Investigate", exact=True).click()
        expect(page.get_by_label("Axis or robot")).to_have_value("axis/bench")
        page.get_by_role("button", name="Investigate").click()
        page.wait_for_url("**/jobs/*")
        identity = page.url.rsplit("/", 1)[1]
        page.goto(f"{site.url}/investigations/{identity}")
        page.locator(".crumbs a").last.click()
        page.wait_for_url(DIAGNOSIS)
        expect(page.locator(f'a[href$="/investigations/{identity}"]')).to_be_visible()
    with site.server.client() as client:
        client.delete(f"/api/v1/jobs/{identity}").raise_for_status()


def beginning_of_the_sound(page: Page) -> float:
    """Where the sound begins in the preview, in pixels: the first column of the canvas with the colour of its line."""
    left: float = page.evaluate(
        """() => {
            const canvas = document.querySelector("[data-preview] canvas");
            const probe = document.querySelector("[data-preview] .series.s3");
            const colour = getComputedStyle(probe).stroke.match(/[\\d.]+/g).slice(0, 3).map(Number);
            const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            for (let x = 0; x < canvas.width; x++)
                for (let y = 0; y < canvas.height; y++) {
                    const at = 4 * (y * canvas.width + x);
                    if (data[at + 3] > 200 && colour.every((one, k) => Math.abs(one - data[at + k]) < 12)) return x;
                }
            return NaN;
        }"""
    )
    return left


def test_sound_and_log_lie_over_each_other_before_anything_is_asked(opened: Opened, site: Site) -> None:
    """The log's courses are drawn, what it can show is said; the sound moves over it by its offset, which is kept."""
    rows = "".join(f"{t:.2f},{np.cos(t):.6f},{5 * np.sin(t):.6f}\n" for t in np.arange(2000) / 100)
    log = {"name": "log.csv", "mimeType": "text/csv", "buffer": f"t [s],Torque [Nm],Angle [rad]\n{rows}".encode()}
    with opened("operator", "/investigations/new") as page:
        page.get_by_label("Axis or robot").select_option("axis/bench")
        page.get_by_label("Log of the drive").set_input_files(log)  # type: ignore[arg-type]
        preview = page.get_by_role("region", name="Preview")
        expect(preview.get_by_text("2000 rows, 19.99 s")).to_be_visible(timeout=60_000)
        expect(preview.get_by_text("motor speed, at most 5 rad/s")).to_be_visible()
        expect(preview.get_by_text("100 rows per second for 20 s of one encoder")).to_be_visible()
        page.get_by_label("Sound", exact=True).set_input_files(site.recording)
        expect(preview.get_by_text("level of the sound")).to_be_visible()
        begins = []
        for offset in ("0", "5", "10"):
            page.get_by_label("Start of the sound").fill(offset)
            expect(preview.locator("canvas")).to_have_count(1)
            page.wait_for_function(
                "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
            )
            begins.append(beginning_of_the_sound(page))
        assert begins[1] - begins[0] > 20.0
        assert begins[2] - begins[1] == pytest.approx(begins[1] - begins[0], abs=4.0)
        page.get_by_role("button", name="Investigate").click()
        page.wait_for_url("**/jobs/*")
        identity = page.url.rsplit("/", 1)[1]
    with site.library().reading() as session:
        assert get_investigation(session, identity).inputs["sound_offset_s"] == 10.0
    with site.server.client() as client:
        client.delete(f"/api/v1/jobs/{identity}").raise_for_status()


def test_job_is_followed_and_cancelled(opened: Opened, site: Site) -> None:
    """Ask for simulated cases: the job's page follows by itself what happens to it, and offers what can be done."""
    with opened("admin", "/library/simulate?axis=bench&normal=1&notch=0&play=0") as page:
        page.get_by_role("button", name="Simulate").click()
        page.wait_for_url("**/jobs/*")
        expect(page.get_by_role("button", name="Cancel")).to_be_visible()
        with site.server.client() as client:
            client.delete(f"/api/v1/jobs/{page.url.rsplit('/', 1)[1]}").raise_for_status()
        page.get_by_role("button", name="Resume").click()
        page.get_by_role("button", name="Cancel").click()
        expect(page.get_by_role("button", name="Resume")).to_be_visible()


def test_review_is_applied_and_taken_back(opened: Opened, site: Site) -> None:
    """Quarantine what is far from reality, all together, and take it back: the library is what it was."""
    with site.server.client() as client, opened("admin", "/library/review") as page:
        before = client.get("/api/v1/cases?limit=100").json()["items"]
        page.get_by_role("button", name="Quarantine them").click()
        expect(page.get_by_text("is done. It can be taken back below.")).to_be_visible()
        changed = client.get("/api/v1/cases?limit=100").json()["items"]
        assert {one["origin"] for one in changed if one["quarantine_reason"]} == {"simulated"}
        page.get_by_role("button", name="Take back").first.click()
        expect(page.get_by_text("is taken back.")).to_be_visible()
        after = client.get("/api/v1/cases?limit=100").json()["items"]
        assert [one["quarantine_reason"] for one in after] == [one["quarantine_reason"] for one in before]


def test_better_model_is_accepted_once(opened: Opened, site: Site) -> None:
    """The story has overlay and residual as a pair with the noise floor; accepting it twice makes one revision."""
    path = f"/investigations/{site.investigation}"
    with opened("admin", path) as page:
        expect(page.get_by_role("heading", level=1)).to_contain_text("Found: friction asymmetry at motor, ")
        cause = page.get_by_role("figure", name="Friction asymmetry at motor: torque over speed")
        expect(cause.locator("[data-ready] canvas")).to_be_visible()
        for folded in ("Details", "Measurement, model and residual", "Where the residual is"):
            page.locator("summary", has_text=folded).click()
        for title in ("Motor torque: measured and simulated", "Motor torque: residual", "Motor torque by speed"):
            page.get_by_role("region", name=title).scroll_into_view_if_needed()
            expect(page.get_by_role("region", name=title).locator("[data-ready] canvas")).to_be_visible()
        expect(page.get_by_role("region", name="Motor torque: residual").get_by_text("noise floor")).to_be_visible()
        expect(page.get_by_text("rolling bearings were not examined")).to_be_visible()
        page.get_by_role("button", name="Update the description").click()
        page.wait_for_url("**/axes/one*body")
        expect(page.get_by_text("Revision 2,")).to_be_visible()  # the first is the description as it was given
        page.goto(site.url + path)
        expect(page.get_by_role("button", name="Update the description")).to_have_count(0)
        page.get_by_role("link", name="revision 2 of").click()
        page.wait_for_url("**/axes/one*body")
    with browsing(site, "admin") as client:
        token = csrf_token(client.cookies[COOKIE])
        assert client.post(f"{path}/accept", data={"csrf": token}).status_code == 303
        assert "Revision 3," not in client.get("/axes/one%20body").text


def test_error_is_a_sentence_with_the_way_out(opened: Opened, site: Site) -> None:
    with browsing(site, "viewer") as client:
        answer = client.get("/diagnoses/none")
        assert answer.status_code == 404
        assert "No diagnosis has the id" in answer.text
        assert "To the start" in answer.text
    with browsing(site, "operator") as client:
        told = {"csrf": csrf_token(client.cookies[COOKIE]), "speed_rad_s": "fast"}
        files = {"file": ("bench.wav", site.recording.read_bytes())}
        answer = client.post("/diagnoses/new", data=told, files=files, headers={"Referer": f"{site.url}/library"})
        assert answer.status_code == 422
        page = Markup(answer.text)
        assert "must be a number such as 2.5, got 'fast'. Leave it empty if it is not known." in page.text
        assert f"{site.url}/library" in page.links


def test_script_weight() -> None:
    """All scripts together, but for the one of /docs, stay under 150 KB compressed."""
    folder = Path(__file__).resolve().parents[2] / "app" / "web" / "static"
    if not (folder / "vendor").exists():
        pytest.skip("browser libraries are not installed: make setup installs them")
    scripts = [path for path in folder.rglob("*.js") if not path.name.startswith("swagger-ui")]
    size = sum(len(gzip.compress(path.read_bytes())) for path in scripts)
    print(f"scripts: {size / 1000:.0f} kB compressed")
    assert size < 150_000
