"""A few of the crash points that `make chaos` tries all of, and that none is forgotten."""

import json
import subprocess
import sys

from app.main import ROUTERS
from benchmarks.chaos.orders import MAKES_NOTHING, ORDERS


def test_every_post_has_its_crash_points() -> None:
    """A new route is one line in `benchmarks.chaos.orders`."""
    posts = {
        route.path  # type: ignore[attr-defined]
        for router in ROUTERS
        for route in router.routes
        if "POST" in route.methods  # type: ignore[attr-defined]
    }
    assert posts == {name.partition(" ")[0] for name in ORDERS} | set(MAKES_NOTHING)


def test_orders_of_jobs_are_done_once_wherever_they_were_killed() -> None:
    """On SQLite; `make chaos` has PostgreSQL too."""
    names = ["/simulations", "/investigations", "job: resumed"]
    words = ["-m", "benchmarks.chaos", "crash-points", "--json", "--database", "sqlite", "--most", "2", "--only"]
    done = subprocess.run([sys.executable, *words, *names], capture_output=True, text=True, check=False)
    assert (done.returncode, json.loads(done.stdout.splitlines()[-1])) == (0, []), done.stderr[-3000:]
    assert done.stdout.count("   2 of") == len(names)
