"""Export and import: nothing is lost on the way, and a bundle from elsewhere is not trusted."""

import hashlib
import json
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from casebase.description import condition_of
from casebase.errors import BundleError
from casebase.library import CaseLibrary
from casebase.search.case_filter import CaseFilter
from casebase.store.bundle import MANIFEST, SCHEMA, BundleLimits, export_cases, import_cases
from signals.features import EXTRACTOR_VERSION
from signals.reading.decode import read_recording
from signals.recording import Recording
from tests.casebase.sounds import MOTION, add_sound, write_sound


def test_cases_survive_the_journey(library: CaseLibrary, tmp_path: Path) -> None:
    for seed, label in enumerate(("normal", "notch", "notch")):
        add_sound(library, write_sound(tmp_path / f"{seed}.wav", seed), label, gearbox=f"g{seed}")
    with library.reading() as session:
        assert export_cases(library, session, tmp_path / "all.zip", CaseFilter()).cases == 3
        here = library.reuse.reasoner(session).table
        sent = {case.recording.samples_sha256 for case in library.retrieve.cases(session, CaseFilter()).items}
    other = CaseLibrary.open(tmp_path / "other")
    imported = import_cases(other, tmp_path / "all.zip", "bert")
    assert (len(imported.case_ids), imported.known, imported.refused) == (3, 0, {})
    again = import_cases(other, tmp_path / "all.zip", "bert")
    assert (again.case_ids, again.known) == ((), 3)
    with other.reading() as session:
        there = other.reuse.reasoner(session).table
        samples = {case.recording.samples_sha256 for case in other.retrieve.cases(session, CaseFilter()).items}
        cases = other.retrieve.cases(session, CaseFilter(label="notch")).items
    assert samples == sent
    assert sorted(zip(here.labels, here.gearboxes, strict=True)) == sorted(
        zip(there.labels, there.gearboxes, strict=True)
    )
    assert {case.verified_by for case in cases} == {"opened"}
    assert {case.recording.speed_rad_s for case in cases} == {2.5}
    assert {condition_of(case.recording.description).motion for case in cases} == {MOTION}
    assert there.extractor_version == EXTRACTOR_VERSION
    other.close()


def manifest(*cases: dict[str, object]) -> str:
    """Return a manifest that declares these cases."""
    return json.dumps({"schema": SCHEMA, "cases": list(cases)})


def linked(bundle: zipfile.ZipFile) -> None:
    """Add a symbolic link."""
    info = zipfile.ZipInfo("audio/link")
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    bundle.writestr(info, "/etc/passwd")


def doubled(bundle: zipfile.ZipFile) -> None:
    """Add the same name twice, the second time in another spelling."""
    bundle.writestr("audio/a", b"1")
    bundle.writestr("audio/./a", b"2")


FROM_TOMORROW: dict[str, object] = {"audio": "audio/a", "sha256": "0" * 64, "label": "notch"}
FROM_TOMORROW["recording"] = {"recorded_at": "2099-01-01T00:00:00Z"}
MALICIOUS: dict[str, tuple[Callable[[zipfile.ZipFile], None], str]] = {
    "absolute": (lambda bundle: bundle.writestr("/etc/cron.d/x", b"x"), "leads out"),
    "parent": (lambda bundle: bundle.writestr("audio/../../x", b"x"), "leads out"),
    "backslash": (lambda bundle: bundle.writestr("..\\x", b"x"), "leads out"),
    "link": (linked, "is a link"),
    "twice": (doubled, "twice"),
    "bomb": (lambda bundle: bundle.writestr("audio/zeros", bytes(30_000_000)), "claim to hold"),
    "many": (lambda bundle: [bundle.writestr(f"audio/{n}", b"") for n in range(200)] and None, "at most 100"),
    "no manifest": (lambda bundle: bundle.writestr("audio/a", b"x"), "has no 'manifest.json'"),
    "no json": (lambda bundle: bundle.writestr(MANIFEST, b"\xff{"), "no JSON"),
    "other schema": (lambda bundle: bundle.writestr(MANIFEST, b'{"schema": "x"}'), "schema"),
    "many cases": (lambda bundle: bundle.writestr(MANIFEST, manifest(*[{}] * 200)), "at most 100"),
    "case without audio": (lambda bundle: bundle.writestr(MANIFEST, manifest({"label": "notch"})), "lacks audio"),
    "future": (lambda bundle: bundle.writestr(MANIFEST, manifest(FROM_TOMORROW)), "recorded_at.*future"),
}


@pytest.mark.parametrize("kind", MALICIOUS)
def test_a_bundle_that_breaks_a_rule_is_refused_whole(sqlite_library: CaseLibrary, tmp_path: Path, kind: str) -> None:
    fill, message = MALICIOUS[kind]
    with zipfile.ZipFile(tmp_path / "in.zip", "w", zipfile.ZIP_DEFLATED) as bundle:
        fill(bundle)
    with pytest.raises(BundleError, match=message):
        import_cases(sqlite_library, tmp_path / "in.zip", "eve", limits=BundleLimits(entries=100))
    assert list(sqlite_library.audio.hashes()) == []


def test_a_size_that_lies_is_found_while_reading(sqlite_library: CaseLibrary, tmp_path: Path) -> None:
    path = tmp_path / "in.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as bundle:
        bundle.writestr(MANIFEST, " " * 50_000_000 + manifest())
    data = bytearray(path.read_bytes())
    directory = data.rindex(b"PK\x01\x02")
    data[directory + 24 : directory + 28] = (1000).to_bytes(4, "little")
    path.write_bytes(data)
    with pytest.raises(BundleError):
        import_cases(sqlite_library, path, "eve")


def test_audio_that_is_not_what_was_declared_is_refused(sqlite_library: CaseLibrary, tmp_path: Path) -> None:
    entry = {"audio": "audio/a", "sha256": "0" * 64, "label": "notch", "recording": {}}
    with zipfile.ZipFile(tmp_path / "in.zip", "w") as bundle:
        bundle.writestr("audio/a", b"RIFF")
        bundle.writestr(MANIFEST, manifest(entry))
    with pytest.raises(BundleError, match="SHA-256 differs"):
        import_cases(sqlite_library, tmp_path / "in.zip", "eve")


def repeated(tmp_path: Path, count: int) -> Path:
    """Write a bundle of one sound under as many names, with cases of three gearboxes."""
    audio = write_sound(tmp_path / "a.wav", 1).read_bytes()
    case = {"sha256": hashlib.sha256(audio).hexdigest(), "label": "notch"}
    cases = [
        {**case, "audio": f"audio/{number}", "recording": {"gearbox": f"g{number % 3}"}} for number in range(count)
    ]
    with zipfile.ZipFile(tmp_path / "in.zip", "w") as bundle:
        for number in range(count):
            bundle.writestr(f"audio/{number}", audio)
        bundle.writestr(MANIFEST, manifest(*cases))
    return tmp_path / "in.zip"


def test_a_sound_is_decoded_once_however_often_it_comes(
    sqlite_library: CaseLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded: list[Path] = []

    def counted(path: Path, *, channel: int) -> Recording:
        decoded.append(path)
        return read_recording(path, channel=channel)

    monkeypatch.setattr("casebase.store.bundle.read_recording", counted)
    imported = import_cases(sqlite_library, repeated(tmp_path, 90), "anna")
    assert (len(imported.case_ids), imported.known, list(imported.refused)) == (1, 29, ["audio/1", "audio/2"])
    assert len(decoded) == 1


def test_an_import_that_takes_too_long_says_what_is_left(sqlite_library: CaseLibrary, tmp_path: Path) -> None:
    imported = import_cases(sqlite_library, repeated(tmp_path, 1), "anna", limits=BundleLimits(total_seconds=0.0))
    assert (imported.case_ids, list(imported.refused)) == ((), ["audio/0"])
    assert list(sqlite_library.audio.hashes()) == []


def test_no_zip_at_all_is_said(sqlite_library: CaseLibrary, tmp_path: Path) -> None:
    (tmp_path / "in.zip").write_bytes(b"not a zip")
    with pytest.raises(BundleError, match="no readable ZIP"):
        import_cases(sqlite_library, tmp_path / "in.zip", "eve")
