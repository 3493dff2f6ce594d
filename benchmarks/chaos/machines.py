"""Two machines: PostgreSQL and a worker in one network namespace, a worker in another, a cable between them.

The cable is pulled for a moment and for longer than a lease, the database stops for 10 s, a worker is killed; at the
end every case of a campaign is to be there once. Needs root; nothing leaves the two namespaces.
"""

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import func, select

from app.jobs.jobs import OVER, Jobs
from app.simulated.generation import KIND, Campaign
from benchmarks.chaos.orders import AXIS
from benchmarks.harness import postgres
from casebase.library import CaseLibrary
from casebase.store import leases
from casebase.store.models import Case
from sim.description.axis_document import read_axis

ADDRESSES = {"a": "10.213.77.1", "b": "10.213.77.2"}
SHORT_S, AWAY_S = 6.0, 10.0
PATIENCE_S = 300.0


class NoNamespacesError(Exception):
    """Why two machines cannot be made here."""


def ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise NoNamespacesError(f"ip {' '.join(words)}: {done.stderr.strip()}")


@contextmanager
def two_machines() -> Iterator[dict[str, str]]:
    """Make two namespaces with a cable between them; their names. Raises NoNamespacesError."""
    if os.geteuid() != 0 or not shutil.which("ip") or not shutil.which("setpriv"):
        raise NoNamespacesError("network namespaces need root, ip and setpriv")
    names = {each: f"gearcase-{os.getpid()}-{each}" for each in ADDRESSES}
    with ExitStack() as stack:
        for name in names.values():
            ip("netns", "add", name)
            stack.callback(ip, "netns", "del", name)
        ip("-n", names["a"], "link", "add", "cable", "type", "veth", "peer", "name", "cable", "netns", names["b"])
        for each, name in names.items():
            ip("-n", name, "addr", "add", f"{ADDRESSES[each]}/24", "dev", "cable")
            for device in ("lo", "cable"):
                ip("-n", name, "link", "set", device, "up")
        yield names


@dataclass
class Site:
    """Two machines, the library that they work on, and what went on."""

    names: Mapping[str, str]
    data_dir: Path
    library: CaseLibrary
    jobs: Jobs
    lease_s: float
    wrong: list[str] = field(default_factory=list)
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)

    def work(self, machine: str) -> subprocess.Popen[bytes]:
        environment = {
            **os.environ,
            "GEARCASE_DATABASE_URL": f"postgresql://{postgres.USER}@{ADDRESSES['a']}/chaos",
            "GEARCASE_LEASE_S": str(self.lease_s),
            "OMP_NUM_THREADS": "1",
        }
        command = [sys.executable, "-m", "app", "--data-dir", str(self.data_dir), "worker", "--name", machine]
        with (self.data_dir.parent / f"worker-{machine}.log").open("ab") as log:
            worker = subprocess.Popen(
                ["ip", "netns", "exec", self.names[machine], *command], env=environment, stderr=log
            )
        self.workers.append(worker)
        return worker

    def lease_of(self, machine: str) -> str | None:
        with self.library.reading() as session:
            return next((each.id for each in leases.held(session) if each.id.startswith(f"{machine}-")), None)

    def at_work(self, machine: str) -> bool:
        return self.lease_of(machine) in self.jobs.workers()

    def until(self, what: str, holds: Callable[[], bool]) -> float:
        """Wait until something is so; how long it took [s]."""
        started = time.monotonic()
        while not holds():
            if time.monotonic() - started > PATIENCE_S:
                raise TimeoutError(f"not in {PATIENCE_S:.0f} s: {what}")
            time.sleep(0.2)
        return time.monotonic() - started


def run(folder: Path, *, cases: int, duration_s: float, lease_s: float) -> tuple[list[str], list[str]]:
    """Go through it; what happened in words, and what was wrong."""
    words: list[str] = []
    with ExitStack() as stack:
        names = stack.enter_context(two_machines())
        server = stack.enter_context(postgres.server(ADDRESSES["a"], names["a"]))
        data_dir = folder / "data"
        library = CaseLibrary.open(data_dir, postgres.create_database(server.url, "chaos"))
        stack.callback(library.close)
        jobs = Jobs(library)
        site = Site(names, data_dir, library, jobs, lease_s)
        stack.callback(lambda: [(worker.kill(), worker.wait()) for worker in site.workers])
        campaign = Campaign(read_axis(AXIS), {"normal": cases}, seed=1, duration_s=duration_s)
        job = jobs.submit(KIND, campaign.to_document())
        first, _ = site.work("a"), site.work("b")
        _go_through(site, server, first, words)
        site.until("the campaign ends", lambda: jobs.get(job).state in OVER)
        ended = jobs.get(job)
        with library.reading() as session:
            there, keys = session.execute(select(func.count(), func.count(Case.key.distinct()))).one()
        words.append(f"{there} cases, {keys} different, of {cases}; the campaign is {ended.state}")
        if (ended.state, there, keys) != ("done", cases, cases):
            site.wrong.append(f"{ended.state}: {there} cases, {keys} different, of {cases}: {ended.error}")
        if site.lease_of("a") is not None:
            site.wrong.append("the killed worker has a lease")
    return words, site.wrong


def _go_through(site: Site, server: postgres.Server, first: subprocess.Popen[bytes], words: list[str]) -> None:
    site.until("both are at work", lambda: site.at_work("a") and site.at_work("b"))
    held = site.lease_of("a"), site.lease_of("b")
    _cable(site, "down")
    time.sleep(SHORT_S)
    _cable(site, "up")
    server.stop()
    time.sleep(AWAY_S)
    server.start()
    time.sleep(site.lease_s)
    if (site.lease_of("a"), site.lease_of("b")) != held:
        site.wrong.append(f"{SHORT_S:.0f} s without network or {AWAY_S:.0f} s without database cost a lease")
    words.append(f"{SHORT_S:.0f} s without network, {AWAY_S:.0f} s without database: leases as before")
    site.until("b is at work", lambda: site.at_work("b"))
    _cable(site, "down")
    took = site.until("b's lease ends", lambda: site.lease_of("b") != held[1])
    words.append(f"b cut off: its lease of {site.lease_s:.0f} s ended after {took:.1f} s")
    time.sleep(site.lease_s)
    _cable(site, "up")
    took = site.until("b begins anew", lambda: site.lease_of("b") not in (None, held[1]))
    words.append(f"b back: begun anew after {took:.1f} s")
    site.until("a is at work", lambda: site.at_work("a"))
    first.kill()
    took = site.until("a's lease ends", lambda: site.lease_of("a") is None)
    words.append(f"a killed: its lease of {site.lease_s:.0f} s ended after {took:.1f} s")


def _cable(site: Site, state: str) -> None:
    ip("-n", site.names["b"], "link", "set", "cable", state)
