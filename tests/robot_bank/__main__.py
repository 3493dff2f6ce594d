"""Run the bank of robots through the command line: `python -m tests.robot_bank --count 150 --seed 1`.

Results are kept as lines of JSON in out/robot_bank, one file per state of the product and the generator, so that a run
that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from tests.robot_bank import wrong_input
from tests.robot_bank.plan import Entry, plan
from tests.robot_bank.product import ROOT, investigate, peak_mib, takes_robots
from tests.robot_bank.scenario import KINDS, write
from tests.robot_bank.score import judge, tables

KEPT = ("verdict", "findings", "unexplained", "parameters", "gain", "joints", "remarks")


def _state() -> str:
    """Return a short hash of the sources of the product and of the generator."""
    digest = hashlib.sha256()
    for folder in ("app", "casebase", "sim", "tests/robot_bank"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def run_entry(entry: Entry) -> dict[str, Any]:
    """Run one case; the result is JSON data."""
    scenario = entry.scenario()
    with tempfile.TemporaryDirectory() as name:
        write(scenario, Path(name))
        said = investigate(Path(name))
    document = said.document
    return {
        "key": f"{entry.seed} {entry.kind} {entry.level}",
        "answer": scenario.answer(),
        "document": None if document is None else {key: document.get(key) for key in KEPT},
        "failure": said.failure,
        "seconds": said.seconds,
        "peak_mib": peak_mib(),
    }


def _line(result: dict[str, Any]) -> str:
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


def _wrong_inputs(seed: int) -> None:
    """Print for each wrong input whether the answer was clear."""
    clear = 0
    scenario = wrong_input.base(seed)
    for case in wrong_input.CASES:
        with tempfile.TemporaryDirectory() as name:
            mentions = case.spoil(scenario, Path(name))
            verdict = wrong_input.judge(case, mentions, investigate(Path(name)))
        clear += verdict.clear
        print(f"{'clear' if verdict.clear else 'LACKING':8s} {case.name}", flush=True)
        for lack in verdict.lacking:
            print(f"           wanted: {lack}")
        if not verdict.clear:
            print(f"           said: {verdict.words}")
    print(f"{clear} of {len(wrong_input.CASES)} answers are clear")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.robot_bank", description=__doc__)
    parser.add_argument("--count", type=int, default=150, help="cases; of every 150 a hundred hide something")
    parser.add_argument("--seed", type=int, default=1, help="of the bank")
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=[], help="only these kinds")
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side")
    parser.add_argument("--wrong-input", action="store_true", help="instead: descriptions that do not fit their log")
    parser.add_argument("--write", type=Path, help="instead: write the files of the cases and answers.json there")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "robot_bank", help="where results are kept")
    options = parser.parse_args()
    if options.write is None and not takes_robots():
        parser.error("`gearcase investigate` has no option --robot")
    return options


def _write(entries: list[Entry], folder: Path) -> None:
    answers = []
    for entry in entries:
        scenario = entry.scenario()
        write(scenario, folder / str(entry.seed))
        answers.append(scenario.answer())
        (folder / "answers.json").write_text(json.dumps(answers, indent=1))
        print(f"{entry.seed} {entry.kind} {entry.level}", flush=True)


def main() -> None:
    """Run what is missing and print all tables."""
    options = _arguments()
    if options.wrong_input:
        _wrong_inputs(options.seed)
        return
    entries = plan(options.count, options.seed, tuple(options.kind))
    if options.write is not None:
        _write(entries, options.write)
        return
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / f"{_state()}.jsonl"
    done = {}
    if file.exists():
        done = {result["key"]: result for result in map(json.loads, file.read_text().splitlines())}
    keys = [f"{entry.seed} {entry.kind} {entry.level}" for entry in entries]
    todo = [entry for entry, key in zip(entries, keys, strict=True) if key not in done]
    bar = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with ProcessPoolExecutor(options.jobs) as pool, Progress(*bar) as progress, file.open("a") as kept:
        task = progress.add_task("robots", total=len(todo))
        for future in as_completed([pool.submit(run_entry, entry) for entry in todo]):
            result = future.result()
            done[result["key"]] = result
            kept.write(json.dumps(result) + "\n")
            kept.flush()
            progress.console.print(_line(result), highlight=False, soft_wrap=True)
            progress.advance(task)
    results = [done[key] for key in keys]
    scored = [(result["answer"], judge(result["answer"], result["document"])) for result in results]
    print(tables(scored, [r["seconds"] for r in results], max(r["peak_mib"] for r in results)))
    print(f"results: {file}")


if __name__ == "__main__":
    main()
