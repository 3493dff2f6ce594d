"""Where the numbers come from: every number has a class, and the page that lists the tuned ones is current."""

from pathlib import Path

import pytest

from docs import numbers


def test_every_number_at_the_level_of_a_module_has_a_class_and_a_source() -> None:
    assert numbers.faults() == []


def test_the_page_of_tuned_numbers_is_printed_from_the_table() -> None:
    page = (numbers.ROOT / "docs" / "tuned.md").read_text(encoding="utf-8")
    assert page == numbers.tuned_page(), "run: python -m docs.numbers > docs/tuned.md"


MODULE = '''"""A module."""
FIRST, SECOND = 1.0, 2  # of something
BARE = 6
NAME: str = "7"
SURE = True
THIRD: float = 3.0
"""What the third
is."""
# what the fourth is
FOURTH = 4  # noqa: S101


def inside() -> int:
    return 5


class Kind:
    share: ClassVar[float] = 0.5  # of it
    field: float = 0.7
    CODE = 3
'''


@pytest.fixture
def house(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one module, no class for its numbers, and one for a number that it no longer has."""
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "module.py").write_text(MODULE)
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "numbers.toml").write_text('[data]\nbank = "a bank"\n["sim/module.py"]\nGONE = "code"\n')
    monkeypatch.setattr(numbers, "ROOT", tmp_path)
    return tmp_path


def test_numbers_are_found_with_what_stands_beside_them(house: Path) -> None:
    assert [(each.names, each.said) for each in numbers.numbers()] == [
        ("FIRST, SECOND", "of something"),
        ("BARE", ""),
        ("THIRD", "What the third is."),
        ("FOURTH", "what the fourth is"),
        ("Kind.share", "of it"),
        ("Kind.CODE", ""),
    ]


def test_a_number_without_a_class_and_a_class_without_a_number_are_named(house: Path) -> None:
    bare, first, fourth, gone, code, share, third = numbers.faults()
    assert all("has no class" in each for each in (bare, first, fourth, code, share, third))
    assert gone == '["sim/module.py"] "GONE" is no number any more'


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        ("physics", "neither its line nor the table"),
        ("tuned", "no data"),
        ("tuned: another bank", "no data"),
        ("guessed: by me", "no class"),
        ("tuned: bank", ""),
        ("tuned: unknown", ""),
        ("budget: a day", ""),
        ("code", ""),
    ],
)
def test_a_class_needs_a_source_and_a_tuned_number_its_data(house: Path, words: str, fault: str) -> None:
    (house / "sim" / "module.py").write_text("NUMBER = 5\n")
    table = f'[data]\nbank = "a bank"\n["sim/module.py"]\nNUMBER = "{words}"\n'
    (house / "docs" / "numbers.toml").write_text(table)
    found = numbers.faults()
    assert [fault in each for each in found] == [True] * bool(fault)
