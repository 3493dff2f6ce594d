"""Fails where the house is larger than its budget in pyproject.toml, and says where it is largest.

Statements are those of the syntax tree without docstrings. A constant is a number (not -1, 0, 1, 2) that a name in
capitals or a default of an argument binds.
"""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

PACKAGES = ("app", "casebase", "signals", "sim")
CAPITALS = re.compile(r"_?[A-Z][A-Z0-9_]*")
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def numbers(node: ast.AST) -> int:
    """Count the tuned numbers below a node."""
    return sum(
        isinstance(one, ast.Constant) and type(one.value) in (int, float) and one.value not in (-1, 0, 1, 2)
        for one in ast.walk(node)
    )


def constants(node: ast.AST) -> int:
    """Count the numbers that a node binds to a name in capitals or to an argument's default."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return sum(numbers(one) for one in (*node.args.defaults, *node.args.kw_defaults) if one is not None)
    if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
        return 0
    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
    names = [one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)]
    return numbers(node.value) if names and all(map(CAPITALS.fullmatch, names)) else 0


def sizes(files: list[str]) -> dict[str, Counter[str]]:
    """Count what has a budget, by folder or document."""
    found: dict[str, Counter[str]] = {
        name: Counter()
        for name in (
            "statements",
            "constants",
            "files_in_a_folder",
            "words",
            "lines_of_tests",
            "lines_of_tests_and_benchmarks",
        )
    }
    for name in files:
        path = Path(name)
        if not path.exists():
            continue
        if path.suffix == ".md":
            found["words"][name] += len(path.read_text().split())
        if path.suffix != ".py":
            continue
        for what in ("lines_of_tests", "lines_of_tests_and_benchmarks"):
            if path.parts[0] in what.split("_"):
                found[what][str(path.parent)] += path.read_text().count("\n")
        if path.parts[0] in PACKAGES:
            nodes = list(ast.walk(ast.parse(path.read_text())))
            docstrings = sum(isinstance(one, DOCUMENTED) and ast.get_docstring(one) is not None for one in nodes)
            folder = str(path.parent)
            found["statements"][folder] += sum(isinstance(one, ast.stmt) for one in nodes) - docstrings
            found["constants"][folder] += sum(map(constants, nodes))
            found["files_in_a_folder"][folder] += 1
    return found


def main() -> int:
    """Compare with the budget; 1 where it is exceeded."""
    budget = tomllib.loads(Path("pyproject.toml").read_text())["tool"]["gearcase"]["size"]
    tracked = subprocess.run(["git", "ls-files"], capture_output=True, text=True, check=True).stdout.splitlines()  # noqa: S607
    exceeded = False
    for what, where in sizes(tracked).items():
        size = max(where.values()) if what == "files_in_a_folder" else sum(where.values())
        largest = ", ".join(f"{name} {count}" for name, count in where.most_common(4))
        print(f"{what.replace('_', ' ')}: {size} of {budget[what]}; most in {largest}")
        exceeded |= size > budget[what]
    return int(exceeded)


if __name__ == "__main__":
    sys.exit(main())
