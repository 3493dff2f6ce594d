"""Recordings from the field, folder by folder: what is right stands in the README of each.

M is a library of 24 measured recordings of four gearboxes, S the simulated starter, M+S both. A recording that has
something wrong gets its true label or an honest doubt, never a wrong label as `diagnosed`.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.harness.live import gearcase
from benchmarks.shared_data import SHARED
from signals.features import extract
from signals.reading.decode import read_recording
from tests.field.libraries import Library, recordings
from tests.field.libraries import known as known_answer
from tests.shared_data import shared

NO_LABEL = ("not_in_library", "unusable")
ALL_THREE = ("measured", "starter_and_measured", pytest.param("starter", marks=pytest.mark.slow))
WITH_MEASURED = ("starter_and_measured", pytest.param("measured", marks=pytest.mark.slow))


@pytest.fixture
def library(request: pytest.FixtureRequest) -> Library:
    """The library that a test names."""
    found: Library = request.getfixturevalue(request.param)
    return found


def of_field(folder: str, file: str) -> Path:
    return shared("data", "field", folder, file)


def whole(label: str) -> Path:
    """The recording that most files of the field were made of."""
    return shared("data", "axis_recordings", {"normal": "g04_normal_0", "notch": "g04_notch_1"}[label] + ".wav")


def of_whole(library: Library, label: str) -> dict[str, Any]:
    """The diagnosis of that recording."""
    return known_answer(library, whole(label))


def kinds(entry: dict[str, Any]) -> set[str]:
    return {each["kind"] for each in entry["disturbances"]}


def flag(entry: dict[str, Any], name: str) -> dict[str, Any]:
    """The quality flag of this name."""
    found: dict[str, Any] = next(each for each in entry["quality"] if each["name"] == name)
    return found


def told(entry: dict[str, Any]) -> str:
    """What is seen of a failed test."""
    known = ("verdict", "label", "probability", "novelty", "disturbances", "remarks", "hypotheses")
    return json.dumps({name: entry[name] for name in known})


def true_or_doubtful(entry: dict[str, Any], truth: str) -> bool:
    """Whether the label is the true one, the answer is ambiguous, or a flag says why there is no label."""
    if entry["verdict"] == "diagnosed":
        return bool(entry["label"] == truth)
    return entry["verdict"] == "ambiguous" or bool(entry["disturbances"])


@pytest.mark.parametrize("library", ALL_THREE, indirect=True)
@pytest.mark.parametrize("file", ["mm-M1F1-int8-AFsp.aif", "mm-music161.wav", "paa-speech_music_sample.wav"])
def test_01_what_is_no_gearbox_gets_no_label(library: Library, file: str) -> None:
    entry = library.asked(of_field("01-starter-spoils-novelty", file))
    assert entry["verdict"] in NO_LABEL, told(entry)
    assert entry["label"] is None


def test_01_the_starter_does_not_change_what_is_known_of_the_unknown(
    measured: Library, starter_and_measured: Library
) -> None:
    alone, with_starter = measured.evaluation(), starter_and_measured.evaluation()
    assert with_starter["left_out_class_called_new"] == alone["left_out_class_called_new"]
    assert with_starter["known_called_new"] == alone["known_called_new"]
    assert alone["left_out_class_called_new"]["notch"]["value"] >= 0.75


@pytest.mark.parametrize("library", WITH_MEASURED, indirect=True)
@pytest.mark.parametrize("period", [False, True])
@pytest.mark.parametrize(
    ("file", "label", "lead_s", "period_s"),
    [
        ("notch_lead_0.50s.wav", "notch", 0.5, 7.0),
        ("normal_lead_2s_dither.wav", "normal", 2.0, 6.39),
        ("play_lead_2s_-40dB.wav", "play", 2.0, 5.88),
    ],
)
def test_02_lead_in_is_left_out_and_said(
    library: Library, file: str, label: str, lead_s: float, period_s: float, period: bool
) -> None:
    words = ("--period", str(period_s)) if period else ()
    entry = library.asked(of_field("02-lead-in", file), *words)
    assert (entry["verdict"], entry["label"]) == ("diagnosed", label), told(entry)
    (silence,) = (each for each in entry["disturbances"] if each["kind"] == "silence")
    assert silence["start_s"] == 0.0
    assert silence["end_s"] == pytest.approx(lead_s, abs=0.15)
    assert f"{lead_s:.1f} s at the start are silent" in flag(entry, "silence")["reason"]


@pytest.mark.parametrize("library", WITH_MEASURED, indirect=True)
@pytest.mark.parametrize(
    ("file", "truth"),
    [
        ("g04_normal_0_brake_click_each_stop.wav", "normal"),
        ("normal_10_speech+0dB.wav", "normal"),
        ("normal_12_handling.wav", "normal"),
        ("normal_brake_at_end.wav", "normal"),
        ("normal_one_mic_bump.wav", "normal"),
        ("notch_wind.wav", "notch"),
    ],
)
def test_04_disturbances_become_no_fault(library: Library, file: str, truth: str) -> None:
    entry = library.asked(of_field("04-disturbances-become-faults", file))
    # a brake that clicks at each stop is in step with the motion, so it is the machine's, and no case has it
    new = "brake_click" in file and entry["verdict"] == "not_in_library" and entry["label"] is None
    assert new or true_or_doubtful(entry, truth), told(entry)


@pytest.mark.parametrize("library", WITH_MEASURED, indirect=True)
@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("normal_10_speech+0dB.wav", "foreign_sound"),
        ("normal_12_handling.wav", "handling"),
        ("normal_one_mic_bump.wav", "bump"),
        ("notch_wind.wav", "wind"),
    ],
)
def test_04_disturbances_are_named(library: Library, file: str, kind: str) -> None:
    assert kind in kinds(library.asked(of_field("04-disturbances-become-faults", file)))


@pytest.mark.parametrize("library", WITH_MEASURED, indirect=True)
@pytest.mark.parametrize(
    ("file", "kind"), [("normal_08_agc.wav", "automatic_gain"), ("play_09_phone_hp200.wav", "low_band_missing")]
)
def test_05_what_telephones_do_is_named_and_nothing_is_sure(library: Library, file: str, kind: str) -> None:
    entry = library.asked(of_field("05-phone-agc-highpass", file))
    assert kind in kinds(entry), told(entry)
    assert entry["verdict"] != "diagnosed", told(entry)


@pytest.mark.parametrize("library", WITH_MEASURED, indirect=True)
@pytest.mark.parametrize("file", ["notch_17_cut_03s.wav", "notch_17_cut_05s.wav"])
def test_06_less_than_a_cycle_excludes_nothing(library: Library, file: str) -> None:
    entry = library.asked(of_field("06-less-than-a-cycle", file))
    assert entry["verdict"] in ("ambiguous", "unusable"), told(entry)


def assert_same(entry: dict[str, Any], other: dict[str, Any]) -> None:
    """Assert that two files have the same sound in them: nothing differs but by resampling."""
    assert (entry["verdict"], entry["label"]) == (other["verdict"], other["label"]), told(entry)
    assert entry["probability"] == pytest.approx(other["probability"], abs=1e-3)
    assert entry["novelty"]["distance"] == pytest.approx(other["novelty"]["distance"], rel=1e-2)


@pytest.mark.parametrize("file", ["90_ch0_dead_zero.wav", "91_ch0_dead_hum.wav", "92_ch0_noise_floor.wav"])
def test_12_the_channel_that_has_the_machine_is_used(measured: Library, file: str) -> None:
    entry = measured.asked(of_field("12-dead-first-channel", file))
    assert_same(entry, of_whole(measured, "notch"))
    assert entry["recording"]["channel"] == 1
    assert kinds(entry) == {"dead_channel"}
    (asked,) = measured.diagnosed(of_field("12-dead-first-channel", file), words=("--channel", "0"))
    assert asked.get("label") is None, asked
    reason = asked["error"] if "error" in asked else flag(asked, "dead_channel")["reason"]
    assert reason.startswith("channel 0")
    assert "channel 1" in reason


@pytest.fixture(scope="module")
def changed(measured: Library, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """A copy of M to which is added."""
    return measured.copied(tmp_path_factory.mktemp("added"))


@pytest.mark.parametrize("file", ["gain-6dB.wav"])
def test_13_the_same_recording_is_one_case(changed: Library, file: str) -> None:
    path = of_field("13-same-recording-twice", file)
    found = json.loads(gearcase("cases", "list", "--json", data_dir=changed.data_dir).stdout)
    (there,) = (each for each in found if each["recording"]["file_name"] == "g00_play_0.wav")
    for label, gearbox in (("normal", "g98"), ("play", "g97"), ("normal", "g00")):
        words = ("--label", label, "--gearbox", gearbox, "--json")
        done = gearcase("cases", "add", path, *words, data_dir=changed.data_dir)
        assert done.code != 0
        assert there["id"] in json.loads(done.stdout)[0]["error"]
    done = gearcase("cases", "add", path, "--label", "play", "--gearbox", "g00", "--json", data_dir=changed.data_dir)
    assert done.code == 0
    assert json.loads(done.stdout)[0]["id"] == there["id"]
    evaluation = changed.evaluation()
    assert (evaluation["cases"], evaluation["gearboxes"]) == (24, 4)


@pytest.mark.parametrize("file", ["exact copy.WAV", "gain-6dB.wav", "same_as_flac.flac"])
def test_13_a_case_that_is_asked_again_has_no_vote(measured: Library, file: str) -> None:
    entry = measured.asked(of_field("13-same-recording-twice", file))
    assert any("this is case" in remark and "play, gearbox g00" in remark for remark in entry["remarks"])
    assert entry["label"] == "play", told(entry)
    assert entry["novelty"]["distance"] > 0


@pytest.mark.parametrize("library", WITH_MEASURED, indirect=True)
@pytest.mark.parametrize("period_s", ["3.5", "14.0"])
def test_14_a_period_that_the_sound_contradicts_is_no_fault(library: Library, period_s: str) -> None:
    entry = library.asked(of_field("14-speed-and-period-mistakes", "00_plain.wav"), "--period", period_s)
    assert entry["label"] in (None, "notch"), told(entry)
    assert "7.003 s" in flag(entry, "motion_contradicts")["reason"]


@pytest.mark.parametrize("library", WITH_MEASURED, indirect=True)
def test_17_floating_point_tagged_as_integer_is_no_fault(library: Library) -> None:
    entry = library.asked(of_field("17-wrong-tags", "23_float_declared_int.wav"))
    assert entry["verdict"] in NO_LABEL, told(entry)


FILES = [row["file"] for half in (False, True) for row in recordings(held_out=half)] if SHARED.exists() else []


@pytest.mark.parametrize("file", FILES[::3])
def test_good_recordings_have_no_disturbance(file: str) -> None:
    """Made in a quiet room, with nothing beside the machine."""
    extraction = extract(read_recording(shared("data", "axis_recordings", file)))
    assert [each.disturbance for each in extraction.quality if each.disturbance is not None] == []
