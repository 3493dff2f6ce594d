"""Take the pictures of the documents: `python -m docs.screenshots` starts a service of its own and a real Chromium."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import httpx
from playwright.sync_api import Browser, sync_playwright

IMAGES = Path(__file__).parent / "images"
WIDTH, HEIGHT = 1280, 860


def gearcase(data_dir: Path, *words: str) -> None:
    """Run one command of the command line."""
    subprocess.run([sys.executable, "-m", "app", *words, "--data-dir", str(data_dir)], check=True)  # noqa: S603


def serve(data_dir: Path) -> tuple[subprocess.Popen[str], str, str]:
    """Start the service; return it, its address and the admin key."""
    command = [sys.executable, "-m", "app", "serve", "--port", "0", "--data-dir", str(data_dir)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)  # noqa: S603
    key = ""
    for line in process.stdout or ():
        if line.startswith("Admin key"):
            key = line.split()[-1]
        if line.startswith("Open "):
            return process, line.split()[1].rstrip("/"), key
    raise RuntimeError("the service did not start")


def pages_of(url: str, key: str) -> dict[str, str]:
    """Return which page each picture shows."""
    with httpx.Client(base_url=url, headers={"Authorization": f"Bearer {key}"}) as client:
        diagnosis = client.get("/api/v1/diagnoses").raise_for_status().json()["items"][0]["id"]
        axis = client.get("/api/v1/axes").raise_for_status().json()["items"][0]["name"]
    return {
        "diagnosis": f"/diagnoses/{diagnosis}",
        "library": "/library",
        "map": "/library/map",
        "evaluation": "/library/evaluation",
        "try": f"/axes/{axis}/try?notch_mrad=1.2",
    }


def take(browser: Browser, url: str, key: str, pages: dict[str, str], scheme: str) -> None:
    """Take every picture in light or dark, and the diagnosis on a narrow screen."""
    for width, names in ((WIDTH, tuple(pages)), (390, ("diagnosis",))):
        context = browser.new_context(viewport={"width": width, "height": HEIGHT}, color_scheme=scheme)  # type: ignore[arg-type]
        context.add_cookies([{"name": "gearcase_key", "value": key, "url": url}])
        page = context.new_page()
        for name in names:
            page.goto(url + pages[name], timeout=120_000)
            page.wait_for_load_state("networkidle")
            page.wait_for_timeout(800)
            suffix = scheme if width == WIDTH else f"narrow-{scheme}"
            page.screenshot(path=IMAGES / f"{name}-{suffix}.png", full_page=name in ("evaluation",))
        context.close()


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
        process, url, key = serve(data_dir)
        try:
            pages = pages_of(url, key)
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
                for scheme in ("light", "dark"):
                    take(browser, url, key, pages, scheme)
                browser.close()
        finally:
            process.terminate()
            process.wait(30)
    print(json.dumps(sorted(path.name for path in IMAGES.glob("*.png"))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
