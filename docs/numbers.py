"""Where the numbers come from: every constant of `sim` and `casebase` has its class in docs/numbers.toml.

A constant stands at the level of a module, or in a class as a `ClassVar` or a member of an enumeration.

python -m docs.numbers > docs/tuned.md
"""

import ast
import io
import sys
import tokenize
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import zip_longest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("sim", "casebase")
CLASSES = {
    "physics": "a law, a standard, a device or the geometry says it",
    "statistics": "a distribution or a level of error says it",
    "prior": "what is expected of a machine before anything of it is looked at",
    "numerics": "a grid, a tolerance or the length of a filter: finer changes nothing but the time it takes",
    "budget": "how much time, memory or input is spent at most",
    "presentation": "how much is shown, and how",
    "code": "the name of a place, a state or a format; its value means nothing",
    "tuned": "set by hand, or on the data that it names",
}
UNKNOWN = "unknown"
FOR_TOOLS = ("fmt:", "noqa", "type:")
LONGEST_VALUE = 120


@dataclass(frozen=True)
class Number:
    """One statement at the level of a module, or a constant of a class, that gives numbers their names.

    Args:
        module: path of the file below the root, with slashes.
        names: as they stand in the statement, joined by commas.
        value: source text of the value.
        said: what a comment or a docstring at the statement says; empty if neither is there.
    """

    module: str
    names: str
    value: str
    said: str


@dataclass(frozen=True)
class Origin:
    """What the table says of a number: its class, and its source, or the data that a tuned number was tuned on."""

    kind: str
    source: str


def numbers() -> Iterator[Number]:
    """Yield every such number of the packages, in the order of the files."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            yield from _of_module(path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"))


@cache
def _of_module(module: str, text: str) -> tuple[Number, ...]:
    body = ast.parse(text).body
    found = list(_of_body(module, text, body, ""))
    for kind in body:
        if isinstance(kind, ast.ClassDef):
            constants = [each for each in kind.body if not isinstance(each, ast.AnnAssign) or _is_constant(each)]
            found += _of_body(module, text, constants, f"{kind.name}.")
    return tuple(found)


def _is_constant(statement: ast.AnnAssign) -> bool:
    return ast.unparse(statement.annotation).startswith("ClassVar")


def _of_body(module: str, text: str, body: list[ast.stmt], prefix: str) -> Iterator[Number]:
    for statement, after in zip_longest(body, body[1:]):
        if isinstance(statement, ast.Assign):
            targets = statement.targets
        elif isinstance(statement, ast.AnnAssign):
            targets = [statement.target]
        else:
            continue
        if statement.value is None or not _has_number(statement.value):
            continue
        names = [node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)]
        comments = _comments(text)
        lines = range(statement.lineno, (statement.end_lineno or statement.lineno) + 1)
        said = [comments[line] for line in lines if line in comments]
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
            said.append(" ".join(after.value.value.split()))
        above = statement.lineno - 1
        if not said and above in comments and text.splitlines()[above - 1].lstrip().startswith("#"):
            said.append(comments[above])
        value = ast.unparse(statement.value)
        yield Number(module, ", ".join(prefix + name for name in names), value, "; ".join(said))


@cache
def _comments(text: str) -> dict[int, str]:
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    found = {token.start[0]: token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT}
    return {line: words for line, words in found.items() if not words.startswith(FOR_TOOLS)}


def _has_number(value: ast.expr) -> bool:
    literals = (node.value for node in ast.walk(value) if isinstance(node, ast.Constant))
    return any(isinstance(each, int | float) and not isinstance(each, bool) for each in literals)


def table() -> tuple[dict[str, str], dict[tuple[str, str], Origin]]:
    """Return the data that numbers were tuned on, by their short name, and what is said of each (module, names)."""
    document = tomllib.loads((ROOT / "docs" / "numbers.toml").read_text(encoding="utf-8"))
    data = document.pop("data")
    origins = {}
    for module, entries in document.items():
        for names, words in entries.items():
            kind, _, source = words.partition(": ")
            origins[module, names] = Origin(kind, source)
    return data, origins


def faults() -> list[str]:
    """Return what is wrong with the table, each with what would be right; nothing if it is whole and current."""
    data, origins = table()
    found = []
    there = set()
    for number in numbers():
        key = number.module, number.names
        there.add(key)
        origin = origins.get(key)
        where = f'["{number.module}"] "{number.names}"'
        if origin is None:
            found.append(f'{where} has no class: write "physics: its source", ..., or "tuned: its data"')
        elif origin.kind not in CLASSES:
            found.append(f"{where}: {origin.kind!r} is no class; there are {', '.join(CLASSES)}")
        elif origin.kind == "tuned" and origin.source not in (*data, UNKNOWN):
            found.append(f"{where}: {origin.source!r} is no data of the table [data], nor {UNKNOWN!r}")
        elif origin.kind not in ("tuned", "code") and not (origin.source or number.said):
            found.append(f"{where} is {origin.kind}, but neither its line nor the table says where it comes from")
    found += [f'["{module}"] "{names}" is no number any more' for module, names in origins.keys() - there]
    return sorted(found)


def counts() -> Counter[str]:
    """Return how many names there are of each class."""
    _, origins = table()
    counted: Counter[str] = Counter()
    for (_, names), origin in origins.items():
        counted[origin.kind] += len(names.split(", "))
    return counted


def tuned_page() -> str:
    """Return the page of the tuned numbers, as Markdown."""
    data, origins = table()
    counted = counts()
    rows = [number for number in numbers() if origins[number.module, number.names].kind == "tuned"]
    lines = [
        "# Where the numbers come from",
        "",
        "Printed by `python -m docs.numbers` from `docs/numbers.toml`, where every constant of a module or a class of",
        "`sim` and `casebase` has a class. This page lists those that no law, standard, distribution or budget gives:",
        "they were set by hand, or on data. A figure taken on the data of a number says less than one on other data.",
        "",
        "| class | numbers | what that means |",
        "| --- | --- | --- |",
        *(f"| {kind} | {counted[kind]} | {meaning} |" for kind, meaning in CLASSES.items()),
        f"| all | {counted.total()} |  |",
        "",
        "## The data",
        "",
        "| name | what it is | numbers |",
        "| --- | --- | --- |",
        *(f"| {name} | {words} | {_tuned_on(origins, name)} |" for name, words in data.items()),
        f"| {UNKNOWN} | nobody can say any more | {_tuned_on(origins, UNKNOWN)} |",
        "",
        "## The numbers",
    ]
    module = ""
    for number in rows:
        if number.module != module:
            module = number.module
            lines += [
                "",
                f"### {module}",
                "",
                "| number | value | what it is | tuned on |",
                "| --- | --- | --- | --- |",
            ]
        value = number.value if len(number.value) <= LONGEST_VALUE else number.value[:LONGEST_VALUE] + " ..."
        said = number.said.replace("|", "\\|")
        lines.append(f"| {number.names} | `{value}` | {said} | {origins[module, number.names].source} |")
    return "\n".join(lines) + "\n"


def _tuned_on(origins: dict[tuple[str, str], Origin], data: str) -> int:
    tuned = Origin("tuned", data)
    return sum(len(names.split(", ")) for (_, names), origin in origins.items() if origin == tuned)


if __name__ == "__main__":
    for fault in faults():
        sys.exit(fault)
    sys.stdout.write(tuned_page())
