"""Take the pictures of the documents: `python -m docs.screenshots` starts a service of its own and a real Chromium."""

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path

import httpx
import numpy as np
from PIL import Image
from playwright.sync_api import Browser, sync_playwright

from benchmarks.harness.telemetry_of import one_body, swing

IMAGES = Path(__file__).parent / "images"
WIDTH, HEIGHT = 1280, 860
COLOURS = 128
PATIENCE_MS = 300_000.0
AXIS = """name = "wrist"
[motor]
inertia_kg_m2 = 0.3
coulomb_friction_n_m = 1.0
viscous_friction_n_m_s_per_rad = 0.02
[load]
inertia_kg_m2 = 0.0
"""


@dataclass(frozen=True)
class Picture:
    """One picture: its name, the page, and which part of the page comes first."""

    name: str
    page: str
    first: str = ""


def gearcase(data_dir: Path, *words: str) -> None:
    """Run one command of the command line."""
    subprocess.run([sys.executable, "-m", "app", *words, "--data-dir", str(data_dir)], check=True)  # noqa: S603


@contextmanager
def serving(data_dir: Path) -> Iterator[tuple[str, str]]:
    """Start the service; yield its address and the admin key."""
    command = [sys.executable, "-m", "app", "serve", "--port", "0", "--show-key", "--data-dir", str(data_dir)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)  # noqa: S603
    key = url = ""
    for line in process.stdout or ():
        if line.startswith("Admin key"):
            key = line.split()[-1]
        if line.startswith("Open "):
            url = line.split()[1].rstrip("/")
            break
    try:
        if not url:
            raise RuntimeError("the service did not start")
        yield url, key
    finally:
        process.terminate()
        process.wait(60)


def friction(client: httpx.Client) -> str:
    """Ask what the description of one body lacks, whose friction rises with speed in one direction; return the id."""
    _, _, speed, _ = swing()
    telemetry = one_body(0.3, 1.0, 0.02, 7, extra=0.006 * np.abs(speed))
    columns = {"time_s": telemetry.time_s, **telemetry.channels}
    table = np.stack(list(columns.values()), axis=1)
    target = StringIO()
    np.savetxt(target, table, "%.9g", ",", header=",".join(columns), comments="")
    return investigate(client, {"axis": ("axis.toml", AXIS), "telemetry": ("telemetry.csv", target.getvalue())})


def investigate(client: httpx.Client, files: Mapping[str, tuple[str | None, str | bytes]]) -> str:
    """Ask for an investigation, wait for it, and return its id."""
    job = client.post("/api/v1/investigations", files=files).raise_for_status().json()
    with client.stream("GET", f"/api/v1/jobs/{job['id']}/events", timeout=1800.0) as stream:
        for _ in stream.iter_lines():
            pass  # the stream ends when the job has
    found = client.get(f"/api/v1/jobs/{job['id']}").raise_for_status().json()
    if found["error"] or not found["result"]:
        raise RuntimeError(f"the investigation is {found['state']}: {found['error']}")
    return str(job["id"])


def pictures(diagnosis: str, investigation: str) -> tuple[Picture, ...]:
    """Return what is shown of which page."""
    story = f"/investigations/{investigation}"
    return (
        Picture("diagnosis-light", "/"),
        Picture("plots-light", f"/diagnoses/{diagnosis}", first="#plots"),
        Picture("investigation-light", story),
        Picture("report-light", f"{story}/report.html"),
    )


def take(browser: Browser, url: str, key: str, picture: Picture) -> None:
    """Take one picture as soon as every plot in sight is drawn."""
    context = browser.new_context(
        viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light", reduced_motion="reduce"
    )
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.goto(f"{url}/sign-in")
    page.get_by_label("Key", exact=True).fill(key)
    page.get_by_role("button", name="Sign in").click()
    page.get_by_role("button", name="Sign out").wait_for()
    page.goto(url + picture.page)
    if picture.first:
        page.evaluate("document.querySelectorAll('details').forEach((one) => (one.open = true))")
        page.locator(picture.first).first.evaluate("one => one.scrollIntoView({block: 'start'})")
    page.wait_for_load_state("networkidle")
    page.wait_for_function(
        """() => [...document.querySelectorAll("[data-plot]")]
            .filter((one) => one.checkVisibility())
            .filter((one) => one.getBoundingClientRect().bottom > 0 && one.getBoundingClientRect().top < innerHeight)
            .every((one) => one.dataset.ready)"""
    )
    picture_of(page.screenshot()).save(IMAGES / f"{picture.name}.png", optimize=True)
    context.close()


def picture_of(content: bytes) -> Image.Image:
    """Return a screenshot in few colours: a page has no more, and the file is a third."""
    return Image.open(BytesIO(content)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)


def main() -> int:
    """Make all pictures."""
    path = shutil.which("chromium") or shutil.which("google-chrome")
    if path is None:
        print("no Chromium on the path", file=sys.stderr)
        return 1
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        data_dir = Path(folder)
        gearcase(data_dir, "starter")
        with serving(data_dir) as (url, key), httpx.Client(base_url=url, timeout=120.0) as client:
            client.headers["Authorization"] = f"Bearer {key}"
            shown = client.get("/api/v1/diagnoses").raise_for_status().json()["items"][0]["id"]
            wanted = pictures(shown, friction(client))
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
                for picture in wanted:
                    take(browser, url, key, picture)
                browser.close()
    print(json.dumps({one.name: (IMAGES / f"{one.name}.png").stat().st_size for one in wanted}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
