"""What is known of a mechanism stands in its own file: no other module knows one by its name."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim.mechanisms import MECHANISMS

ROOT = Path(__file__).parents[3]
NAMED = re.compile(rf"({'|'.join(MECHANISMS)})(@.*)?")
QUOTED = re.compile(rf"[\"'](?:{'|'.join(MECHANISMS)})")
KINDS_OF_THE_DIAGNOSIS = {
    "signals/recording_quality/quality.py": {"clipping"},  # disturbances, by the words of its document
}
FREE_OF_KINDS = ("search", "estimation", "assessment", "pooling", "next_measurement")


def modules(*folders: str) -> Iterator[Path]:
    for folder in folders:
        yield from sorted((ROOT / folder).rglob("*.py"))


def names_in(source: str) -> set[str]:
    """Names of mechanisms among the strings of a module."""
    if not QUOTED.search(source):
        return set()
    texts = (node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant))
    return {found[1] for text in texts if isinstance(text, str) and (found := NAMED.fullmatch(text))}


def test_a_name_is_seen_in_every_kind_of_string() -> None:
    source = (
        """a = "backlash"; b = f"torque_ripple{a}@motor"; c = ("hysteresis@output.torque_n_m", "clipping of a sound")"""
    )
    assert names_in(source) == {"backlash", "torque_ripple", "hysteresis"}


def test_no_module_beside_their_own_knows_a_mechanism_by_its_name() -> None:
    known = {
        path.relative_to(ROOT).as_posix(): names
        for path in modules("sim", "app", "casebase", "signals", "docs")
        if "mechanisms" not in path.relative_to(ROOT).parts and (names := names_in(path.read_text(encoding="utf-8")))
    }
    assert known == KINDS_OF_THE_DIAGNOSIS


@pytest.mark.parametrize("folder", FREE_OF_KINDS)
def test_what_weighs_mechanisms_knows_none_of_them(folder: str) -> None:
    """It reads what all of them say of themselves, and never asks which one it is."""
    for path in modules(f"sim/investigation/{folder}"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        classes = [name.name for node in imports if node.module == "sim.mechanisms" for name in node.names]
        assert set(classes) <= {"MECHANISMS"}, path.name
