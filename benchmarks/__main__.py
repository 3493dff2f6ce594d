"""Run benchmarks: all, or those named: `python -m benchmarks features`."""

import importlib
import sys

from benchmarks import table

MODULES: tuple[str, ...] = (
    "simulation",
    "axis_simulation",
    "diagnosis",
)
"""One line per benchmark."""


def main(names: list[str]) -> int:
    """Run and print; 2 for an unknown name."""
    unknown = set(names) - set(MODULES)
    if unknown:
        print(f"no benchmark {', '.join(sorted(unknown))}; there are {', '.join(MODULES)}", file=sys.stderr)
        return 2
    for name in names or MODULES:
        module = importlib.import_module(f"benchmarks.{name}")
        print(table(f"{name}: {module.__doc__.splitlines()[0]}", module.run()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
