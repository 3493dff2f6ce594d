"""Ask the product what it makes of the bank: `python -m benchmarks.field_bank --half work`."""

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from benchmarks.field_bank import bank as banks
from benchmarks.field_bank import product, score


def main() -> None:
    """Make the sounds, fill the library, diagnose, print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.field_bank", description=__doc__)
    parser.add_argument("--half", choices=("work", "final"), default="work", help="final is run once, at the end")
    parser.add_argument("--seed", type=int, help="other machines, motions and sounds than those of this half")
    parser.add_argument("--library", choices=("measured", "starter+measured", "starter"), default="starter+measured")
    parser.add_argument("--gearboxes", type=int, choices=(2, 3, 5, 10), default=5, help="measured ones; not with axis")
    parser.add_argument("--source", choices=("own", "axis"), default="own", help="axis: the shared recordings")
    parser.add_argument("--only", metavar="KIND", help="undisturbed recordings and this kind, or foreign")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="ask only each Nth recording of a kind")
    parser.add_argument("--jobs", type=int, default=2, help="diagnoses at once")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "gearcase-field-bank")
    a = parser.parse_args()
    begin = time.monotonic()

    if a.seed is not None:
        banks.SEEDS[a.half] = a.seed
    kinds = ("undisturbed", "unseen", "foreign", *banks.kinds_of(a.half))
    if a.only not in (None, *kinds):
        parser.error(f"no such kind in this half: {a.only}; there are {', '.join(kinds)}")
    asked = banks.written(a.half, a.source, a.cache)
    if a.only:
        asked = [(f, q) for f, q in asked if q.group == "undisturbed" or a.only in (q.group, q.kind)]
    asked = thinned(asked, a.every)
    files, questions = [f for f, _ in asked], [q for _, q in asked]
    say(f"{len(files)} sounds in {files[0].parent}", begin)
    axis = None if a.source == "own" else banks.AXIS / "axis.toml"
    answers: dict[Path, product.Answer] = {}
    libraries = banks.libraries(a.half, a.source, a.gearboxes)
    for fold, known in enumerate(libraries):
        measured = known if a.library != "starter" else []
        data = product.library(a.cache, a.library != "measured", measured, axis)
        say(f"library {fold + 1} of {len(libraries)} is filled: {len(measured)} measured cases", begin)
        here = [f for f, q in asked if q.fold == fold]
        answers |= product.diagnose(data, here, axis, a.jobs)
        say(f"{len(here)} diagnosed", begin)
    rows = score.asked(questions, [answers[f] for f in files])
    boxes = f", {a.gearboxes} gearboxes" if a.source == "own" and a.library != "starter" else ""
    print(f"\nhalf {a.half}, source {a.source}, library {a.library}{boxes}\n\n{score.report(rows)}")
    print(f"\n{time.monotonic() - begin:.0f} s")


def thinned(asked: list[tuple[Path, banks.Question]], every: int) -> list[tuple[Path, banks.Question]]:
    """Return each Nth of a kind, and all undisturbed recordings, for the others are held against them."""
    seen: Counter[str] = Counter()
    kept = []
    for file, q in asked:
        kind = "foreign" if q.group == "foreign" else q.kind
        if q.group == "undisturbed" or seen[kind] % every == 0:
            kept.append((file, q))
        seen[kind] += 1
    return kept


def say(what: str, begin: float) -> None:
    """Tell progress on stderr."""
    print(f"{time.monotonic() - begin:6.0f} s  {what}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
