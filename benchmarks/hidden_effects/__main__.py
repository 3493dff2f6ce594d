"""Run the bank of hidden effects through the command line: `python -m benchmarks.hidden_effects`.

Results are kept as lines of JSON in out/hidden_effects, one file per state of the product, so that a run that was
stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchmarks.hidden_effects.bank import BANK_SEED, Entry, full_bank
from benchmarks.hidden_effects.figure import draw
from benchmarks.hidden_effects.product import ROOT, investigate, investigate_folder, peak_mib
from benchmarks.hidden_effects.scoring import Scored, complete, judge, several_table, tables

KEPT = ("verdict", "findings", "unexplained", "parameters", "gain", "rejected", "remarks")


def _state_of_product() -> str:
    """Return a short hash of the product's source and of the generator's."""
    digest = hashlib.sha256()
    for folder in ("app", "casebase", "sim", "benchmarks/hidden_effects/generator"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def run_entry(entry: Entry) -> dict[str, Any]:
    """Run one entry of the bank; the result is JSON data."""
    scenario = entry.scenario()
    said = investigate(scenario)
    result = {
        "seed": entry.seed,
        "answer": scenario.answer(),
        "document": _kept(said.document),
        "failure": said.failure,
        "seconds": said.seconds,
        "peak_mib": peak_mib(),
    }
    if scenario.second_telemetry is not None:
        result["alone"] = _kept(said.document["recordings"][0] if said.document else None)
    return result


def _kept(document: Mapping[str, Any] | None) -> dict[str, Any] | None:
    return {key: document.get(key) for key in KEPT} if document else None


def _read(file: Path) -> dict[int, dict[str, Any]]:
    if not file.exists():
        return {}
    results = [json.loads(line) for line in file.read_text().splitlines()]
    return {result["seed"]: result for result in results}


def _judged(results: Sequence[dict[str, Any]], document: str = "document") -> list[Scored]:
    """Judge results by a document of theirs; "alone" is what the first of several recordings says by itself."""
    return [(result["answer"], judge(result["answer"], result[document])) for result in results]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden_effects", description=__doc__)
    parser.add_argument("--runs", type=int, help="only the first N of the bank")
    parser.add_argument("--seed", type=int, default=BANK_SEED, help="first seed of the bank")
    parser.add_argument("--jobs", type=int, default=2, help="worker processes")
    parser.add_argument("--group", help="only this group, such as null or mechanics")
    parser.add_argument("--effect", help="only scenarios that hide this, such as backlash")
    parser.add_argument("--level", help="only scenarios of this size, such as third")
    parser.add_argument("--folder", type=Path, help="instead: recordings with an answers.json, by the same rule")
    parser.add_argument("--twice", action="store_true", help="with --folder: run each twice, compare the documents")
    parser.add_argument("--figure", type=Path, help="also draw the results, as PNG or SVG")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "hidden_effects", help="where results are kept")
    return parser.parse_args()


def _wanted(options: argparse.Namespace) -> list[Entry]:
    bank = [
        entry
        for entry in full_bank(options.seed)
        if options.group in (None, entry.group)
        and options.level in (None, entry.level)
        and (options.effect is None or options.effect in entry.effects)
    ]
    return bank[: options.runs]


def _run(todo: Sequence[Entry], jobs: int, file: Path) -> None:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with (
        ProcessPoolExecutor(jobs) as pool,
        Progress(*columns) as progress,
        file.open("a") as kept,
    ):
        task = progress.add_task("hidden effects", total=len(todo))
        for future in as_completed([pool.submit(run_entry, entry) for entry in todo]):
            result = future.result()
            kept.write(json.dumps(result) + "\n")
            kept.flush()
            progress.console.print(_line(result), highlight=False, soft_wrap=True)
            progress.advance(task)


def _line(result: dict[str, Any]) -> str:
    """Return one run as a line."""
    answer, judgement = result["answer"], judge(result["answer"], result["document"])
    hidden = "+".join(h["mechanism"] for h in answer["hidden"]) or answer["group"]
    mark = {"right": "ok   ", "failed": "FAIL "}.get(judgement.outcome, "  -  ")
    said = ", ".join(judgement.wrong_names)
    off = ", ".join(f"{c.name} off by {c.error:.3g}" for c in judgement.sizes if not c.within)
    return (
        f"{mark}{answer['id']:>10s} {hidden:36s} {answer['level']:8s} {judgement.outcome:12s}"
        f" {result['seconds']:5.1f} s {said} {off}"
    )


def _run_folder(folder: Path, twice: bool) -> None:
    """Run recordings that come with an answers.json."""
    results, alike = [], 0
    for given in json.loads((folder / "answers.json").read_text()):
        said = investigate_folder(folder / given["id"])
        results.append({"answer": complete(given), "document": said.document, "seconds": said.seconds})
        print(_line(results[-1]), said.failure or "")
        if twice:
            alike += said.document == investigate_folder(folder / given["id"]).document
    print(tables(_judged(results), [r["seconds"] for r in results]))
    print(f"largest memory of a run: {peak_mib():.0f} MiB")
    if twice:
        print(f"the same document from the same bytes: {alike} of {len(results)}")


def main() -> None:
    """Run what is wanted and not yet done, then print the tables."""
    options = _arguments()
    if options.folder:
        _run_folder(options.folder, options.twice)
        return
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / f"{_state_of_product()}.jsonl"
    done = _read(file)
    bank = _wanted(options)
    todo = [e for e in bank if e.seed not in done]
    if len(todo) < len(bank):
        print(f"{len(bank) - len(todo)} of {len(bank)} results are already in {file}")
    _run(todo, options.jobs, file)
    done = _read(file)
    results = [done[entry.seed] for entry in bank]
    print()
    print(tables(_judged(results), [r["seconds"] for r in results]))
    several = [result for result in results if "alone" in result]
    if several:
        print(f"\n{several_table(_judged(several, 'alone'), _judged(several))}\n")
    print(f"largest memory of a run: {max((r['peak_mib'] for r in results), default=0.0):.0f} MiB")
    for result in results:
        if result["failure"]:
            print(f"\n{result['answer']['id']} failed: {result['failure']}")
    if options.figure:
        draw(_judged(results), options.figure)


if __name__ == "__main__":
    main()
