"""`--axis` at every verb: a file or a stored name. `--steady` says the same there as `steady` over HTTP."""

import json
from pathlib import Path

import pytest

from benchmarks.harness.live import gearcase
from benchmarks.harness.sounds import sound

TOML = "[motor]\ninertia_kg_m2 = 0.3\n[load]\ninertia_kg_m2 = 0.0\n[motion]\nperiod_s = 2.0\n"


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library that knows an axis and has a case."""
    folder = tmp_path_factory.mktemp("axes")
    (folder / "axis.toml").write_text(f'name = "bench"\n{TOML}')
    (folder / "a.wav").write_bytes(sound(1))
    assert gearcase("axes", "add", folder / "axis.toml", data_dir=folder / "data").code == 0
    return folder / "data"


VERBS = (
    ("diagnose", "a.wav"),
    ("cases", "add", "a.wav", "--label", "normal"),
    ("simulate", "--out", "run"),
    ("generate", "--per-label", "1"),
    ("investigate",),
    ("fit",),
    ("compare",),
    ("size", "a.wav", "--label", "notch"),
)


@pytest.mark.parametrize("words", VERBS, ids=lambda words: words[0])
def test_what_is_neither_file_nor_stored_is_said_with_what_is(data_dir: Path, words: tuple[str, ...]) -> None:
    done = gearcase(*words, "--axis", "bensh", data_dir=data_dir)
    assert done.code == 2
    assert "there is no file bensh, and no axis is known as 'bensh'; near it is 'bench'; described are" in done.stderr


@pytest.mark.parametrize("given", ["bench", "axis.toml"])
def test_a_file_and_a_stored_name_say_the_same(data_dir: Path, given: str, tmp_path: Path) -> None:
    axis = data_dir.parent / given if given.endswith("toml") else given
    done = gearcase("simulate", "--axis", axis, "--duration", "1", "--out", tmp_path, "--json", data_dir=data_dir)
    assert done.code == 0, done.stderr
    assert json.loads(done.stdout)["axis"] == "bench"
    found = gearcase("diagnose", data_dir.parent / "a.wav", "--axis", axis, "--json", data_dir=data_dir)
    (entry,) = json.loads(found.stdout)
    assert entry["recording"]["axis"] == "bench"
    assert not any("no axis is described" in remark for remark in entry["remarks"])


def test_a_folder_of_the_same_name_is_no_axis(data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bench").mkdir()
    monkeypatch.chdir(tmp_path)
    words = ("simulate", "--axis", "bench", "--duration", "1", "--out", "run", "--json")
    assert gearcase(*words, data_dir=data_dir).code == 0
