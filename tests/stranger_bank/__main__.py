"""Write one half of the bank: `python -m tests.stranger_bank --half work --out DIR`.

DIR/HALF gets one 16 bit WAV and one JSON truth per recording, and DIR/HALF/truth.csv lists them
with the sets they are in. Recordings that are already there are kept.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time

from .bank import all_specs, cached, folder_of, truth_of, use_folder

_LEFT_OUT = ("events_s", "landings_s", "sizes")


def main() -> None:
    """Make what is missing and write the table of truth."""
    parser = argparse.ArgumentParser(prog="python -m tests.stranger_bank", description=__doc__)
    parser.add_argument("--half", choices=["work", "final"], required=True)
    parser.add_argument("--out", required=True, help="folder of the bank")
    args = parser.parse_args()
    use_folder(args.out)
    specs = all_specs(args.half)
    rows = []
    began = time.monotonic()
    for k, (spec, sets) in enumerate(specs.items(), 1):
        rec = cached(spec)
        truth = truth_of(rec)
        row = {"file": f"{spec.key}.wav", "sets": ";".join(sets), "half": args.half}
        row |= {n: v for n, v in truth.items() if n not in _LEFT_OUT}
        row["labels"] = "+".join(sorted(rec.labels))
        row["sizes"] = ";".join(f"{n}={v:.3g}" for n, v in rec.sizes)
        row["events"] = len(rec.events_s)
        rows.append(row)
        if k % 5 == 0 or k == len(specs):
            spent = time.monotonic() - began
            bar = "#" * (30 * k // len(specs))
            left = spent / k * (len(specs) - k)
            sys.stderr.write(f"\r[{bar:<30}] {k}/{len(specs)}  {spent:4.0f} s, {left:4.0f} s left ")
            sys.stderr.flush()
    sys.stderr.write("\n")
    path = folder_of(args.half) / "truth.csv"
    with path.open("w", newline="") as f:
        writer = csv.DictWriter(f, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    print(path)


if __name__ == "__main__":
    main()
