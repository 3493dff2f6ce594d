"""Run the cases of a bank through the command line, two side by side, and print its tables.

Results are kept as lines of JSON in a file, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, Protocol

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchmarks.robot_bank.product import ROOT, investigate, peak_mib
from benchmarks.robot_bank.score import judge, tables

KEPT = ("verdict", "findings", "unexplained", "parameters", "gain", "joints", "remarks")


class Case(Protocol):
    """A case of a bank, made and written when it is its turn."""

    @property
    def key(self) -> str:
        """What tells it from all others."""

    def write(self, folder: Path) -> dict[str, Any]:
        """Write the files that a customer has and return the answer."""


def state(*folders: str) -> str:
    """Return a short hash of the sources of the product and of the files of other folders."""
    digest = hashlib.sha256()
    for folder in ("app", "casebase", "sim", *folders):
        for file in sorted((ROOT / folder).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def run_case(case: Case) -> dict[str, Any]:
    """Run one case; the result is JSON data."""
    with tempfile.TemporaryDirectory() as name:
        answer = case.write(Path(name))
        said = investigate(Path(name))
    document = said.document
    return {
        "key": case.key,
        "answer": answer,
        "document": None if document is None else {key: document.get(key) for key in KEPT},
        "failure": said.failure,
        "seconds": said.seconds,
        "peak_mib": peak_mib(),
    }


def line(result: dict[str, Any]) -> str:
    """Return one run as a line."""
    answer, judgement = result["answer"], judge(result["answer"], result["document"])
    hidden = answer["hidden"][0]["location"] if answer["hidden"] else ""
    invented = f" invented: {', '.join(judgement.invented)}" if judgement.invented else ""
    off = "".join(f" {size.name} off by {size.error:.2g}" for size in judgement.sizes if size.covered is False)
    failure = f" {result['failure']}" if result["failure"] else ""
    return (
        f"{judgement.outcome:11s} {answer['kind']:18s} {hidden:18s} {answer['level']:6s} {answer['drives']:9s} "
        f"{answer['motion']:10s} seed {answer['seed']} {result['seconds']:.0f} s{invented}{off}{failure}"
    )


def run(cases: Sequence[Case], file: Path, jobs: int) -> None:
    """Run the cases that are not in the file and print all tables."""
    file.parent.mkdir(parents=True, exist_ok=True)
    done = {}
    if file.exists():
        done = {result["key"]: result for result in map(json.loads, file.read_text().splitlines())}
    todo = [case for case in cases if case.key not in done]
    bar = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with ProcessPoolExecutor(jobs) as pool, Progress(*bar) as progress, file.open("a") as kept:
        task = progress.add_task("robots", total=len(todo))
        for future in as_completed([pool.submit(run_case, case) for case in todo]):
            result = future.result()
            done[result["key"]] = result
            kept.write(json.dumps(result) + "\n")
            kept.flush()
            progress.console.print(line(result), highlight=False, soft_wrap=True)
            progress.advance(task)
    results = [done[case.key] for case in cases]
    scored = [(result["answer"], judge(result["answer"], result["document"])) for result in results]
    print(tables(scored, [r["seconds"] for r in results], max(r["peak_mib"] for r in results)))
    print(f"results: {file}")


def write(cases: Sequence[Case], folder: Path) -> None:
    """Write the files of the cases, and answers.json."""
    answers = []
    for case in cases:
        answers.append(case.write(folder / case.key.split()[0]))
        (folder / "answers.json").write_text(json.dumps(answers, indent=1))
        print(case.key, flush=True)
