"""What is typed of a recording is held against axis, library and sound; what is contradicted is named and not used."""

import json
import math
from contextlib import closing
from dataclasses import replace

import pytest
from sqlalchemy import select

from benchmarks.harness.live import LiveServer, gearcase
from benchmarks.harness.sounds import sound
from casebase.description import Labelling, RecordingDescription
from casebase.library import CaseLibrary
from casebase.reasoning.plausibility import Expected, Known, held_against
from casebase.store.models import Case, StoredRecording
from signals.condition import OperatingCondition
from signals.features import EXTRACTOR_VERSION
from signals.motion import Motion
from signals.recording_quality.quality import FlagLevel
from tests.casebase.conftest import library
from tests.casebase.made import extraction, recording
from tests.field.libraries import Library
from tests.shared_data import shared

__all__ = ["library"]

AXIS = Expected(
    speed_rad_s=Known(2.2, 2.9, "the 24 measured cases of 'axis-a'"),
    payload_kg_m2=Known(20.0, 50.0, "the 24 measured cases of 'axis-a'"),
    motion_period_s=Known(6.4, 7.0, "the 24 measured cases of 'axis-a'"),
    ratio=80.0,
)
HEARD = Motion(period_in_sound_s=7.0)


@pytest.mark.parametrize(
    ("unit", "factor", "named"),
    [
        ("degrees per second", 180 / math.pi, "/ 57.3 = 2.37 rad/s"),
        ("turns per minute", 30 / math.pi, "/ 9.55 = 2.37 rad/s"),
        ("rad/s of the motor", 80.0, "/ 80 = 2.37 rad/s"),
        ("turns per minute of the motor", 80 * 30 / math.pi, "/ 764 = 2.37 rad/s"),
        ("thousandths of rad/s", 1000.0, "/ 1000 = 2.37 rad/s"),
        ("turns per second", 1 / (2 * math.pi), "* 6.28 = 2.37 rad/s"),
    ],
)
def test_mistaken_unit_of_the_speed_is_named(unit: str, factor: float, named: str) -> None:
    usable, (flag,) = held_against(OperatingCondition(speed_rad_s=2.37 * factor), HEARD, AXIS)
    assert flag.name == "speed_contradicts"
    assert f"{named} if it is in {unit};" in flag.reason
    assert flag.reason.endswith("give the largest speed of the output in rad/s; the value is not used")
    assert usable == OperatingCondition()


@pytest.mark.parametrize(
    ("factor", "named"), [(1000.0, "in g m2"), (1e6, "in kg mm2"), (80**-2, "in kg m2 as felt at the motor")]
)
def test_mistaken_unit_of_the_payload_is_named(factor: float, named: str) -> None:
    given = OperatingCondition(payload_kg_m2=32.0 * factor, speed_rad_s=2.5)
    usable, (flag,) = held_against(given, HEARD, AXIS)
    assert (flag.name, named in flag.reason, "= 32 kg m2" in flag.reason) == ("payload_contradicts", True, True)
    assert usable == OperatingCondition(speed_rad_s=2.5)


def test_period_is_judged_where_the_sound_does_not_tell_it() -> None:
    """Where it does, the sound is right whatever the library knows."""
    given = OperatingCondition(motion_period_s=6700.0)
    usable, (flag,) = held_against(given, Motion(), AXIS)
    assert (flag.name, flag.severity) == ("period_contradicts", FlagLevel.POOR)
    assert "6700 / 1000 = 6.7 s if it is in milliseconds" in flag.reason
    assert usable == OperatingCondition()
    assert held_against(given, Motion(period_in_sound_s=6700.0), AXIS) == (given, ())


def test_motor_cannot_be_outrun() -> None:
    """A speed within the factor of what is known, but beyond what the motor allows."""
    limited = replace(AXIS, top_speed_rad_s=3.0)
    assert held_against(OperatingCondition(speed_rad_s=3.3), HEARD, limited)[1] == ()
    usable, (flag,) = held_against(OperatingCondition(speed_rad_s=5.0), HEARD, limited)
    assert "the motor's speed limit allows 3 rad/s" in flag.reason
    assert usable.speed_rad_s is None


def test_without_axis_and_cases_only_impossible_strokes_are_contradicted() -> None:
    """At 135.7 rad/s and 7 s a joint turns 38 times each way; a shaft that goes round may."""
    nothing = Expected()
    for given in (
        OperatingCondition(speed_rad_s=12.0, payload_kg_m2=32000.0, motion_period_s=0.1),
        OperatingCondition(speed_rad_s=135.7, steady=True),
    ):
        assert held_against(given, HEARD, nothing) == (given, ())
    assert held_against(OperatingCondition(speed_rad_s=135.7), Motion(), nothing)[1] == ()
    usable, (flag,) = held_against(OperatingCondition(speed_rad_s=135.7), HEARD, nothing)
    assert (usable.speed_rad_s, "37.8 turns each way" in flag.reason) == (None, True)


def kept(library: CaseLibrary, seed: int, speed: float | None, axis: str | None, **how: str) -> None:
    """Keep a case that moves at this speed."""
    taken = recording(seed)
    heard = replace(extraction([1.0], version=EXTRACTOR_VERSION), motion=Motion(period_in_sound_s=6.0 + seed))
    described = RecordingDescription(axis=axis, condition=OperatingCondition(speed_rad_s=speed))
    with library.transaction("test") as session:
        row = library.retain.recording(session, taken.samples.tobytes(), taken, heard, described)
        library.retain.case(session, row, Labelling("normal", **how))


def test_library_knows_what_its_measured_cases_of_the_axis_have(library: CaseLibrary) -> None:
    """Nothing of a quantity that fewer than three have; simulated, retired and other axes' cases do not count."""
    for seed, speed in enumerate((2.0, 3.0)):
        kept(library, seed, speed, "axis-a")
    kept(library, 2, 9.0, "axis-b")
    kept(library, 3, 9.0, None)
    kept(library, 4, 9.0, "axis-a", origin="simulated")
    kept(library, 5, 9.0, "axis-a", state="retired")
    kept(library, 6, 9.0, "axis-a", quarantine_reason="doubted")
    with library.reading() as session:
        assert library.retrieve.measured(session, "axis-a") == Expected()
    kept(library, 7, None, "axis-a")
    with library.reading() as session:
        found = library.retrieve.measured(session, "axis-a")
        assert found == Expected(motion_period_s=Known(6.0, 13.0, "the 3 measured cases of 'axis-a'"))
    kept(library, 8, 2.5, "axis-a")
    with library.reading() as session:
        found = library.retrieve.measured(session, "axis-a")
        assert found.speed_rad_s == Known(2.0, 3.0, "the 3 measured cases of 'axis-a'")
        assert found.payload_kg_m2 is None


def test_over_http_the_typed_value_stays_in_the_description(live_server: LiveServer) -> None:
    """The description of an axis is enough; and a contradicted speed is none of what the next one is held against."""
    axis = {
        "name": "slow one",
        "motor": {"inertia_kg_m2": 0.006},
        "load": {"inertia_kg_m2": 40.0},
        "motion": {"load_speed_rad_s": 2.5},
    }
    with live_server.client() as client:
        client.post("/api/v1/axes", json=axis).raise_for_status()
        metadata = {"axis": "slow one", "speed_rad_s": 143.2, "payload_kg_m2": 41.0, "label": "normal"}
        sent = {"files": {"file": ("x.wav", sound(80))}, "data": {"metadata": json.dumps(metadata)}}
        case = client.post("/api/v1/cases", **sent).raise_for_status().json()  # type: ignore[arg-type]
        client.delete(f"/api/v1/cases/{case['id']}").raise_for_status()
    taken = case["recording"]
    assert [flag["name"] for flag in taken["quality"] if "contradicts" in flag["name"]] == ["speed_contradicts"]
    (flag,) = (flag for flag in taken["quality"] if flag["name"] == "speed_contradicts")
    assert "the description of 'slow one' (2.5 rad/s); 143.2 / 57.3 = 2.5 rad/s" in flag["reason"]
    assert (taken["speed_rad_s"], taken["payload_kg_m2"]) == (None, 41.0)
    assert taken["description"]["extra"]["contradicted"] == {"speed_rad_s": 143.2}
    assert "speed_rad_s" not in taken["description"]["condition"]


@pytest.mark.parametrize(
    ("option", "value", "flag", "words"),
    [
        ("--speed", 135.7, "speed_contradicts", "135.7 / 57.3 = 2.37 rad/s if it is in degrees per second"),
        ("--payload", 32000.0, "payload_contradicts", "32000 / 1000 = 32 kg m2 if it is in g m2"),
        ("--speed", 2.37, None, ""),
    ],
)
def test_speeds_and_payloads_of_the_field(
    measured: Library, option: str, value: float, flag: str | None, words: str
) -> None:
    """What was typed wrong changes nothing but the flag: the diagnosis is the one without it."""
    file = shared("data", "field", "14-speed-and-period-mistakes", "00_plain.wav")
    how = ("diagnose", file, "--axis", shared("data", "axis_recordings", "axis.toml"), "--json")
    typed, silent = (
        json.loads(gearcase(*how, *more, data_dir=measured.data_dir).stdout)[0] for more in ((option, str(value)), ())
    )
    flags = {each["name"]: each["reason"] for each in typed["quality"] if each["name"].endswith("_contradicts")}
    assert list(flags) == ([flag] if flag else [])
    assert words in flags.get(str(flag), "")
    if flag is not None:
        assert typed["hypotheses"] == silent["hypotheses"]
        with closing(CaseLibrary.open(measured.data_dir)) as opened, opened.reading() as session:
            row = session.get_one(StoredRecording, typed["recording"]["id"])
        assert list(row.description["extra"]["contradicted"].values()) == [value]


def test_nothing_contradicts_what_the_library_was_made_of(measured: Library) -> None:
    """No measured recording of the axis is flagged by what the others have."""
    with closing(CaseLibrary.open(measured.data_dir)) as opened, opened.reading() as session:
        rows = session.scalars(select(StoredRecording).join(Case)).all()
    assert len(rows) == 24
    assert all(row.speed_rad_s for row in rows)
    assert not [flag for row in rows for flag in row.quality if str(flag["name"]).endswith("_contradicts")]
