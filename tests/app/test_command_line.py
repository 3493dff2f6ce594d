"""The command line: exit codes, one JSON document on stdout, words on stderr."""

import json
import os
import signal
import subprocess
import sys
from functools import partial
from importlib.metadata import version
from pathlib import Path

import httpx
import numpy as np
import pytest

from app.cli import run
from app.commands.faults import sentence
from app.commands.serve import FIRST_KEY, RULE
from benchmarks.harness.live import gearcase
from benchmarks.harness.sounds import sound
from benchmarks.harness.telemetry_of import one_body
from sim.description.axis_document import write_axis
from sim.experiment.paper_axis import PAPER_AXIS
from tests.app.alarms.receivers import wait_for


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library of three normal recordings and three with impacts."""
    folder = tmp_path_factory.mktemp("local")
    for label, impacts in (("normal", False), ("notch", True)):
        files = []
        for seed in range(3):
            path = folder / f"{label}{seed}.wav"
            path.write_bytes(sound(seed + 100 * impacts, impacts=impacts))
            files.append(path)
        words = ("cases", "add", *files, "--label", label, "--gearbox", "g1", "--json")
        done = gearcase(*words, data_dir=folder / "data")
        assert done.code == 0, done.stderr
        assert {entry["recording"]["media_type"] for entry in json.loads(done.stdout)} == {"audio/wav"}
    return folder / "data"


def test_help_imports_nothing_heavy() -> None:
    program = "import sys; from app.cli import run; run(['--help']); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not {"numpy", "sqlalchemy", "fastapi", "matplotlib"} & set(done.stderr.split())


def test_service_imports_nothing_that_only_some_requests_need() -> None:
    program = "import sys, app.main; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    heavy = {"matplotlib", "numba", "scipy.stats", "scipy.signal", "scipy.interpolate", "alembic", "pyarrow"}
    assert not heavy & set(done.stdout.split())


@pytest.mark.parametrize("before", [True, False])
def test_data_dir_before_or_after_the_verb(tmp_path: Path, before: bool) -> None:
    option = ["--data-dir", str(tmp_path / "here")]
    verb = ["keys", "create", "--role", "viewer", "--name", "x"]
    assert run([*option, *verb] if before else [*verb, *option]) == 0
    assert (tmp_path / "here" / "gearcase.db").is_file()


def test_data_dir_by_environment_and_module(tmp_path: Path) -> None:
    environment = {**os.environ, "GEARCASE_DATA_DIR": str(tmp_path / "there")}
    command = [sys.executable, "-m", "app", "keys", "list", "--json"]
    done = subprocess.run(command, capture_output=True, check=True, env=environment)
    assert json.loads(done.stdout) == []
    assert (tmp_path / "there" / "gearcase.db").is_file()


@pytest.mark.parametrize("shown", [True, False])
def test_address_and_key_stand_together_at_the_end(tmp_path: Path, shown: bool) -> None:
    """Between two rules; the key itself only if asked for, as `make run` does: without a terminal, output is a log."""
    words = ["serve", "--port", "0", "--no-worker", "--data-dir", str(tmp_path / "data"), "--log-folder", str(tmp_path)]
    words += ["--show-key"] if shown else []
    service = subprocess.Popen(
        [sys.executable, "-m", "app", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert service.stdout is not None
    printed: list[str] = []
    for line in service.stdout:
        printed.append(line.rstrip())
        if printed.count(RULE) == 2:
            break
    first, key, opened, log, _ = printed[-5:]
    assert first == RULE
    assert ("gearcase_" in key) == shown
    path = tmp_path / "data" / FIRST_KEY
    assert shown != path.exists()
    if not shown:
        assert str(path) in key
        assert path.stat().st_mode & 0o777 == 0o600
    bearer = key.split()[-1] if shown else path.read_text().strip()
    assert str(tmp_path) in log
    url, headers = opened.removeprefix("Open "), {"Authorization": f"Bearer {bearer}"}
    assert httpx.get(f"{url}api/v1/keys", headers=headers).status_code == 200
    service.terminate()
    _, stderr = service.communicate(timeout=60)
    assert stderr == ""
    entries = [json.loads(line) for line in (tmp_path / "service.log").read_text().splitlines()]
    assert "/api/v1/keys" in {entry.get("path") for entry in entries}


def test_ctrl_c_leaves_one_sentence_of_what_is_kept(tmp_path: Path) -> None:
    """As a terminal sends it: to the command and to the processes that it started."""
    axis = tmp_path / "axis.toml"
    axis.write_text(write_axis(PAPER_AXIS))
    words = ["generate", "--axis", str(axis), "--per-label", "200", "--processes", "2", "--json"]
    running = subprocess.Popen(
        [sys.executable, "-m", "app", *words, "--data-dir", str(tmp_path / "data")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),  # a background job ignores it
    )
    children = Path(f"/proc/{running.pid}/task/{running.pid}/children")
    wait_for(lambda: len(children.read_text().split()) > 2, "its processes")
    os.killpg(running.pid, signal.SIGINT)
    out, words_of_it = running.communicate(timeout=60)
    assert "library" in json.loads(out)["error"]
    assert "Traceback" not in words_of_it
    assert words_of_it.splitlines()[-1].startswith("gearcase: stopped")


def test_key_is_alone_on_stdout(data_dir: Path) -> None:
    done = gearcase("keys", "create", "--role", "operator", "--name", "bench", data_dir=data_dir)
    assert done.stdout.startswith("gearcase_")
    assert len(done.stdout.split()) == 1
    listed = json.loads(gearcase("keys", "list", "--json", data_dir=data_dir).stdout)
    assert [(key["name"], key["role"]) for key in listed] == [("bench", "operator")]
    assert done.stdout.strip() not in json.dumps(listed)


def test_diagnose_answers_per_file_with_failures(data_dir: Path, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.wav", tmp_path / "bad.wav"
    good.write_bytes(sound(300, impacts=True))
    bad.write_bytes(b"this is no sound")
    done = gearcase("diagnose", good, bad, tmp_path / "none.wav", "--json", data_dir=data_dir)
    entries = json.loads(done.stdout)
    assert [entry["file"] for entry in entries] == [str(good), str(bad), str(tmp_path / "none.wav")]
    assert entries[0]["verdict"] in ("diagnosed", "ambiguous", "not_in_library")
    assert entries[0]["neighbours"]
    assert "no sound file" in entries[1]["error"]
    assert "no such file" in entries[2]["error"]
    assert done.code == 2


def test_same_sound_as_a_known_fault_ends_with_3(data_dir: Path) -> None:
    known = data_dir.parent / "notch0.wav"
    words = ("diagnose", known, "--gearbox", "g1", "--json")
    found = json.loads(gearcase(*words, data_dir=data_dir).stdout)[0]
    assert found["neighbours"][0]["label"] == "notch"
    done = gearcase(*words, "--fail-on", "fault", data_dir=data_dir)
    assert (done.code == 3) == (found["label"] == "notch")
    assert gearcase("diagnose", data_dir.parent / "normal0.wav", "--fail-on", "fault", data_dir=data_dir).code == 0


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("nonsense",), 2),
        (("diagnose",), 2),
        (("keys", "create", "--role", "emperor", "--name", "x"), 2),
        (("keys", "revoke", "0" * 32), 2),
        (("cases", "add", "x.wav", "--label", "NOT A LABEL"), 2),
        (("diagnose", "x.wav", "--axis", "missing.toml"), 2),
        (("diagnose", "x.wav", "--speed", "-1"), 2),
    ],
)
def test_bad_input_is_2_and_says_so_on_stderr(data_dir: Path, words: tuple[str, ...], code: int) -> None:
    done = gearcase(*words, data_dir=data_dir)
    assert done.code == code
    assert done.stderr.strip()
    assert "Traceback" not in done.stderr


def test_doctor_finds_what_is_missing(tmp_path: Path) -> None:
    folder, path = tmp_path / "data", tmp_path / "x.wav"
    path.write_bytes(sound(1))
    for faults in ({"database"}, {"keys", "library"}):
        empty = gearcase("doctor", "--json", data_dir=folder)
        assert (empty.code, {each["what"] for each in json.loads(empty.stdout) if each["fault"]}) == (1, faults)
        assert folder.exists() == (faults != {"database"})
        gearcase("cases", "list", data_dir=folder)
    gearcase("keys", "create", "--role", "admin", "--name", "me", data_dir=folder)
    gearcase("cases", "add", path, "--label", "normal", data_dir=folder)
    assert gearcase("doctor", "--thorough", data_dir=folder).code == 0
    audio = next((folder / "audio").glob("??/*"))
    audio.write_bytes(b"changed")
    assert gearcase("doctor", data_dir=folder).code == 0
    assert gearcase("doctor", "--thorough", data_dir=folder).code == 1
    audio.unlink()
    assert "missing" in gearcase("doctor", data_dir=folder).stdout


def listed(data_dir: Path) -> list[dict[str, object]]:
    cases = json.loads(gearcase("cases", "list", "--json", data_dir=data_dir).stdout)
    return sorted(
        ({"label": case["label"], **case["recording"]} for case in cases), key=lambda case: case["file_sha256"]
    )


def test_exported_cases_are_imported_once(data_dir: Path, tmp_path: Path) -> None:
    bundle, other = tmp_path / "cases.zip", tmp_path / "other"
    assert "6 cases" in gearcase("cases", "export", bundle, data_dir=data_dir).stdout
    assert gearcase("cases", "export", bundle, data_dir=data_dir).code == 2
    assert "6 new cases" in gearcase("cases", "import", bundle, data_dir=other).stdout
    assert "0 new cases, 6 were here" in gearcase("cases", "import", bundle, data_dir=other).stdout
    same = ("label", "file_sha256", "samples_sha256", "gearbox", "file_name", "speed_rad_s")
    assert [[case[key] for key in same] for case in listed(other)] == [
        [case[key] for key in same] for case in listed(data_dir)
    ]


def test_backup_comes_back_whole(data_dir: Path, tmp_path: Path) -> None:
    folder, copy = tmp_path / "backup", tmp_path / "copy"
    assert gearcase("backup", folder, data_dir=data_dir).code == 0
    assert gearcase("restore", folder, data_dir=data_dir).code == 2  # not empty
    assert gearcase("restore", folder, data_dir=copy).code == 0
    assert listed(copy) == listed(data_dir)
    words = ("diagnose", data_dir.parent / "notch0.wav", "--gearbox", "g1", "--json")
    here, there = (json.loads(gearcase(*words, data_dir=each).stdout)[0] for each in (data_dir, copy))
    assert here["hypotheses"] == there["hypotheses"]


@pytest.mark.parametrize("words", ["--json cases list", "cases --json list", "cases list --json"])
def test_json_stands_anywhere(tmp_path: Path, words: str) -> None:
    """Programs put the switch before or after the verb; stdout is one document either way."""
    assert json.loads(gearcase(*words.split(), data_dir=tmp_path).stdout) == []


def test_json_says_what_was_wrong(data_dir: Path, tmp_path: Path) -> None:
    done = gearcase("restore", tmp_path / "nowhere", "--json", data_dir=tmp_path / "new")
    assert json.loads(done.stdout) == {"error": done.stderr.removeprefix("gearcase: ").strip(), "exit_code": done.code}
    assert done.code == 2


def test_json_of_a_fault_of_ours_is_a_document_too(data_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr("app.commands.frame.print_json", broken)
    done = gearcase("cases", "list", "--json", data_dir=data_dir)
    assert done.code == 1
    assert "ZeroDivisionError: on purpose" in json.loads(done.stdout)["error"]
    assert "Traceback" in done.stderr


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "map.toml: no such file"),
        (b"\xaa\x00", "map.toml: this is no UTF-8 text"),
        (b"[time_s]\ncolumn = 1\n", "no channel is named beside time_s"),
    ],
)
def test_a_channel_map_that_cannot_be_read_is_said(tmp_path: Path, content: bytes | None, words: str) -> None:
    (tmp_path / "axis.toml").write_text("[motor]\ninertia_kg_m2 = 0.3\n[load]\ninertia_kg_m2 = 0.0\n")
    (tmp_path / "log.csv").write_text("t,i\n" + "".join(f"{n},0.5\n" for n in range(200)))
    if content is not None:
        (tmp_path / "map.toml").write_bytes(content)
    asked = ("investigate", "--axis", tmp_path / "axis.toml", "--telemetry", tmp_path / "log.csv")
    done = gearcase(*asked, "--channels", tmp_path / "map.toml", data_dir=tmp_path)
    assert (done.code, words in done.stderr) == (2, True), done.stderr


def test_no_telemetry_is_dropped(tmp_path: Path) -> None:
    """Several recordings of one axis become one document; one that is bad is named."""
    (tmp_path / "axis.toml").write_text("[motor]\ninertia_kg_m2 = 0.3\n[load]\ninertia_kg_m2 = 0.0\n")
    files = [tmp_path / day / "telemetry.csv" for day in ("monday", "friday")]
    for seed, path in enumerate(files):
        path.parent.mkdir()
        recording = one_body(0.3, 1.0, 0.02, seed)
        rows = np.column_stack([recording.time_s, *recording.channels.values()])[:6000]
        header = ",".join(("time_s", *recording.channels))
        np.savetxt(path, rows, delimiter=",", header=header, comments="")
    words = ["investigate", "--axis", tmp_path / "axis.toml", *(w for path in files for w in ("--telemetry", path))]
    done = gearcase(*words, "--json", data_dir=tmp_path)
    assert done.code == 0, done.stderr
    assert [one["name"] for one in json.loads(done.stdout)["recordings"]] == [str(path) for path in files]
    (tmp_path / "text.csv").write_text("nothing\n1\n")
    bad = gearcase(*words, "--telemetry", tmp_path / "text.csv", data_dir=tmp_path)
    assert (bad.code, "text.csv: " in bad.stderr) == (2, True)


def test_version(tmp_path: Path) -> None:
    done = gearcase("--version", data_dir=tmp_path)
    assert (done.code, done.stdout.strip()) == (0, version("gearcase"))


def test_a_missing_file_is_named_without_numbers_of_the_system(tmp_path: Path) -> None:
    path = tmp_path / "telemetry.csv"
    with pytest.raises(FileNotFoundError) as missing:
        path.read_bytes()
    assert sentence(missing.value) == f"{path}: no such file"
