"""What the pages of a library of 10,000 cases cost, the worst first.

python -m benchmarks.large                on SQLite
python -m benchmarks.large --postgres     on PostgreSQL
python -m benchmarks.large --only /fleet  one page, or several
"""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from benchmarks.harness import postgres
from benchmarks.harness.inside import Inside, inside
from benchmarks.large.library import Size
from benchmarks.large.pages import Cost, built, cost_of


@contextmanager
def service(on_postgres: bool) -> Iterator[Inside]:
    """An empty service."""
    with tempfile.TemporaryDirectory() as folder:
        if not on_postgres:
            with inside(Path(folder) / "data") as found:
                yield found
            return
        with postgres.running_server() as url, inside(Path(folder) / "data", database_url(url)) as found:
            yield found


def database_url(server: str) -> str:
    """Return the URL of a new database."""
    return str(postgres.create_database(server, "large"))


def lines(costs: Sequence[Cost]) -> list[str]:
    """Write a table."""
    head = f"{'page':<62}{'first':>10}" + "".join(f"{word:>9}" for word in ("ready", "page", "SQL", "most", ""))
    found = [f"{head}{'stmts':>6}{'rows':>8}{'kB read':>9}{'kB sent':>9}"]
    for one in sorted(costs, key=lambda each: -each.over):
        name = one.path if len(one.path) < 61 else f"{one.path[:58]}..."
        times = "".join(f"{1000 * each:9.1f}" for each in (one.page_s, one.sql_s, one.bound_s))
        first = f"{1000 * one.first_s:8.0f}{'' if one.first_status == 200 else '!'}"
        ready = f"{one.ready_s:8.1f}s" if one.ready_s else ""
        word = "" if one.over <= 1 else "NOT kept"
        found.append(
            f"{name:<62}{first:>10}{ready:>9}{times}{word:>9}{one.statements:6d}{one.rows:8d}"
            f"{one.read / 1000:9.0f}{one.sent / 1000:9.0f}"
        )
    kept = sum(one.over <= 1 for one in costs)
    found.append(f"{kept} of {len(costs)} pages take at most 1.5 times their SQL and 50 ms; times in ms, wall clock")
    return found


def main(words: Sequence[str] | None = None) -> int:
    """Measure; 1 where a page takes longer than it may."""
    parser = argparse.ArgumentParser(prog="benchmarks.large", description=__doc__)
    parser.add_argument("--postgres", action="store_true")
    parser.add_argument("--cases", type=int, default=Size().cases)
    parser.add_argument("--only", nargs="+", help="pages of which the address contains one of these")
    given = parser.parse_args(words)
    with service(given.postgres) as found:
        site = built(found, Size(cases=given.cases))
        pages = [page for page in site.pages.values() if not given.only or any(one in page for one in given.only)]
        costs = []
        for page in pages:
            costs.append(cost_of(found, page))
            print(".", end="", file=sys.stderr, flush=True)
    print("\n".join(["", *lines(costs)]))
    return int(any(one.over > 1 for one in costs))


if __name__ == "__main__":
    sys.exit(main())
