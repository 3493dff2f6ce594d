"""The container image: built, run read-only with PostgreSQL and two workers, killed, restarted and asked.

python -m benchmarks.image                        prints what was shown, ends with 1 where an answer is wrong
python -m benchmarks.image --base IMAGE           on a base with Python 3.11 that is here already

It needs root, podman and runc, and debootstrap where the base of the Dockerfile cannot be had: all are packages of
Debian. Port 8000 has to be free.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx

from benchmarks.harness import postgres
from benchmarks.harness.plane_robot import log, parts
from benchmarks.harness.sounds import sound

IMAGE, BASE = "gearcase", "python:3.11-slim-bookworm"
LIMITS = ["--ulimit", "nofile=1024:1024", "--ulimit", "nproc=1024:1024"]
"""What a machine may give that is a container itself."""
API = "http://127.0.0.1:8000/api/v1"
MOST_BYTES, STOPPED_S, PATIENCE_S = 1_000_000_000, 10.0, 120.0
OF_THE_MACHINE = ("/etc/pip.conf", "/etc/xdg/pip", "/etc/ssl/certs")
"""How packages are got here; without a trace in the image."""


def podman(*words: str, check: bool = True) -> str:
    command = ["podman", "--runtime", "runc", *words]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if check and done.returncode != 0:
        raise SystemExit(f"{' '.join(command[:6])}...: {done.stderr[-2000:]}")
    return done.stdout.strip()


def missing() -> str:
    """Why it cannot be done here; empty where it can."""
    needed = [tool for tool in ("podman", "runc") if shutil.which(tool) is None]
    if os.geteuid() != 0:
        return "the image is built as root"
    return f"not here: {', '.join(needed)}; apt-get install them" if needed else ""


def base() -> str:
    """Return an image with Python 3.11: that of the Dockerfile, or one made of Debian's packages."""
    if subprocess.run(["podman", "pull", "--quiet", BASE], capture_output=True, check=False).returncode == 0:
        return BASE
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "root"
        packages = "--include=python3,python3-venv,ca-certificates"
        subprocess.run(["debootstrap", "--variant=minbase", packages, "bookworm", root], check=True)
        for each in ("var/cache/apt", "var/lib/apt/lists", "usr/share/doc", "usr/share/locale", "usr/share/man"):
            shutil.rmtree(root / each)
        (root / "usr/bin/python").symlink_to("python3")
        subprocess.run(f"tar -C {root} -c . | podman import - {IMAGE}-base", shell=True, check=True)
    return f"localhost/{IMAGE}-base"


def build(on: str, options: list[str]) -> None:
    mounts = [f"--volume={each}:{each}:ro" for each in OF_THE_MACHINE if Path(each).exists()]
    with tempfile.NamedTemporaryFile("w") as npm:
        if certificates := os.environ.get("NODE_EXTRA_CA_CERTS"):
            npm.write(f"cafile={certificates}\n")
            npm.flush()
        words = ["build", "--format=docker", "--isolation=chroot", "--network=host", f"--build-arg=BASE={on}"]
        podman(*words, *mounts, f"--volume={npm.name}:/root/.npmrc:ro", *options, "--tag", IMAGE, ".")


@contextmanager
def running(name: str, url: str, volume: str, *words: str) -> Iterator[str]:
    """Run a container read-only, without capabilities; remove it afterwards."""
    options = ["--read-only", "--read-only-tmpfs=false", "--cap-drop=all", "--security-opt=no-new-privileges"]
    options += ["--network=host", f"--volume={volume}:/data", f"--env=GEARCASE_DATABASE_URL={url}", *LIMITS]
    podman("run", "--detach", f"--name={name}", *options, IMAGE, *words)
    try:
        yield name
    finally:
        podman("rm", "--force", "--time=0", name, check=False)


def until(what: Callable[[], object]) -> float:
    """Wait until something is so; return how long that took [s]."""
    began = time.monotonic()
    while time.monotonic() - began < PATIENCE_S:
        try:
            if what():
                break
        except httpx.HTTPError:
            pass
        time.sleep(0.1)
    return time.monotonic() - began


def shown(url: str, volume: str) -> Iterator[tuple[str, object, bool]]:
    """Yield what was asked, the answer, and whether that is right."""
    size = int(podman("image", "inspect", "--format={{.Size}}", IMAGE))
    yield "size of the image [MB]", size // 1_000_000, size < MOST_BYTES
    with running("gearcase-service", url, volume, "serve", "--no-worker") as service:
        took_s = until(lambda: httpx.get("http://127.0.0.1:8000/readyz").is_success)
        yield "ready after a first start [s]", round(took_s, 1), took_s < PATIENCE_S
        key = json.loads(
            podman("exec", service, "gearcase", "keys", "create", "--name=image", "--role=admin", "--json")
        )["key"]
        client = httpx.Client(headers={"Authorization": f"Bearer {key}"}, timeout=PATIENCE_S)
        first, later = (_diagnosed(client, seed) for seed in (1, 2))
        yield "first and second diagnosis [s]", f"{first:.1f}, {later:.1f}", first < 2.0
        answer = client.post(f"{API}/investigations", files=parts(telemetry=("log.csv", log(60.0))))
        yield "an investigation of a robot is accepted", answer.status_code, answer.status_code == 202
        job = answer.json()["id"]
        with running("gearcase-worker-1", url, volume, "worker") as one:
            until(lambda: client.get(f"{API}/jobs/{job}").json()["state"] == "running")
            time.sleep(2.0)
            for name in (service, one):
                well = subprocess.run(["podman", "--runtime", "runc", "healthcheck", "run", name], check=False)
                yield f"health of {name}", well.returncode, well.returncode == 0
            began = time.monotonic()
            podman("stop", "--time=30", one)
            took_s = time.monotonic() - began
            yield "a worker in an investigation stops within [s]", round(took_s, 1), took_s < STOPPED_S
            podman("start", one)
            until(lambda: client.get(f"{API}/jobs/{job}").json()["state"] == "running")
            with running("gearcase-worker-2", url, volume, "worker"):
                podman("kill", one)
                until(lambda: client.get(f"{API}/jobs/{job}").json()["state"] in ("done", "failed"))
                state = client.get(f"{API}/jobs/{job}").json()["state"]
                yield "the job of a killed worker, by another", state, state == "done"
        podman("kill", service)
        podman("start", service)
        until(lambda: httpx.get("http://127.0.0.1:8000/readyz").is_success)
        count = len(client.get(f"{API}/diagnoses").json()["items"])
        yield "diagnoses after a kill of the service", count, count == 2
        began = time.monotonic()
        podman("stop", "--time=30", service)
        yield "the service stops within [s]", round(time.monotonic() - began, 1), time.monotonic() - began < STOPPED_S


def _diagnosed(client: httpx.Client, seed: int) -> float:
    began = time.monotonic()
    client.post(f"{API}/diagnoses", files={"file": ("a.wav", sound(seed), "audio/wav")}).raise_for_status()
    return time.monotonic() - began


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", help="image to build on")
    parser.add_argument("--built", action="store_true", help="the image is there; only run it")
    asked, options = parser.parse_known_args()
    if reason := missing():
        print(f"No image here: {reason}")
        return 2
    if not asked.built:
        began = time.monotonic()
        build(asked.base or base(), options)
        print(f"built in [s]: {time.monotonic() - began:.0f}")
    wrong = 0
    podman("volume", "create", f"{IMAGE}-image-test")
    try:
        with postgres.server("127.0.0.1"):
            url = f"postgresql+psycopg://{postgres.USER}@127.0.0.1:5432/postgres"
            for what, found, right in shown(url, f"{IMAGE}-image-test"):
                print(f"{'' if right else 'WRONG '}{what}: {found}", flush=True)
                wrong += not right
    finally:
        podman("volume", "rm", "--force", f"{IMAGE}-image-test", check=False)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
