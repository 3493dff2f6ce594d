"""What was simulated stays simulated, whoever makes a case of it and however."""

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import soundfile

from app.recordings.intake import RecordingMetadata, take_in
from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.live import gearcase
from benchmarks.harness.sounds import sound, wav
from casebase.description import Labelling
from casebase.origins import DEMO, simulated
from casebase.store.artifacts import add_artifact

API = "/api/v1"
AXIS = {
    "name": "bench",
    "motor": {"inertia_kg_m2": 0.006},
    "stages": [{"name": "output", "driver_teeth": 12, "driven_teeth": 600, "stiffness_n_m_per_rad": 1.5e5}],
    "load": {"inertia_kg_m2": 40.0},
}


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Inside]:
    """A service with a demonstration, as the starter makes it."""
    path = tmp_path / "demonstration.wav"
    path.write_bytes(sound(7, impacts=True))
    with inside(tmp_path / "data") as found:
        library = found.service.library
        known = RecordingMetadata(axis="bench", gearbox="demonstration", speed_rad_s=2.5)
        intake = take_in(library, path, path.name, "audio/wav", known)
        with library.transaction("starter") as session:
            diagnosis = intake.diagnose(library, session)
            content = {"diagnosis_id": diagnosis.id, "recording_id": diagnosis.recording.id}
            add_artifact(session, DEMO, content)
        found.ask("POST", f"{API}/axes", json=AXIS).raise_for_status()
        yield found


def demonstration(service: Inside) -> str:
    found: str = service.ask("GET", f"{API}/diagnoses").json()["items"][0]["id"]
    return found


def origins(service: Inside) -> list[tuple[str, str]]:
    return [(case["label"], case["origin"]) for case in service.ask("GET", f"{API}/cases").json()["items"]]


def send(service: Inside, content: bytes, **told: Any) -> dict[str, Any]:
    parts = {"file": ("sent.wav", content), "metadata": (None, json.dumps({"label": "notch", **told}))}
    answer: dict[str, Any] = service.ask("POST", f"{API}/cases", files=parts).raise_for_status().json()
    return answer


def test_anybody_may_take_the_recording_of_the_demonstration_and_no_other(service: Inside) -> None:
    """As the README says, without a key; the name leads to the sound that the library keeps."""
    free = service.anonymous("GET", "/demonstration.wav")
    assert free.status_code == 302
    assert service.anonymous("GET", free.headers["location"]).content == sound(7, impacts=True)
    other = service.ask("POST", f"{API}/diagnoses", files={"file": ("x.wav", sound(8))}).json()["recording"]["id"]
    assert service.anonymous("GET", f"/recordings/{other}/sound").status_code == 303


def test_confirmed_by_a_key_press_it_is_a_simulated_case(service: Inside) -> None:
    page = f"/diagnoses/{demonstration(service)}"
    revised = service.browse("POST", f"{page}/revise", data={"verdict": "corrected", "label": "notch"})
    assert revised.status_code == 303
    how = {"verification": "unverified"}
    kept = service.browse("POST", f"{page}/retain", data=how)
    assert kept.status_code == 303
    assert origins(service) == [("notch", "simulated")]
    assert "simulated" in service.browse("GET", kept.headers["location"]).text
    assert service.browse("POST", f"{page}/retain", data=how).headers["location"] == kept.headers["location"]


def test_over_http_it_is_a_simulated_case(service: Inside) -> None:
    asked = {"diagnosis_id": demonstration(service), "label": "notch"}
    assert service.ask("POST", f"{API}/cases", json=asked).json()["origin"] == "simulated"
    assert origins(service) == [("notch", "simulated")]


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_sent_again_as_a_file_it_is_a_simulated_case(service: Inside, gain: float) -> None:
    """Under another name and quieter, too: it is known by its sound."""
    samples, rate = soundfile.read(io.BytesIO(sound(7, impacts=True)), dtype="float32")
    assert send(service, wav(gain * samples, rate), gearbox="mine")["origin"] == "simulated"


def test_by_the_command_line_it_is_a_simulated_case(service: Inside, tmp_path: Path) -> None:
    data = service.service.settings.data_dir
    added = gearcase("cases", "add", tmp_path / "demonstration.wav", "--label", "notch", "--json", data_dir=data)
    assert json.loads(added.stdout)[0]["origin"] == "simulated"
    words = gearcase("cases", "add", tmp_path / "demonstration.wav", "--label", "notch", data_dir=data)
    assert "its sound is simulated" in words.stdout


def test_what_was_measured_stays_measured(service: Inside) -> None:
    assert send(service, sound(8, impacts=True))["origin"] == "measured"


def test_a_diagnosed_simulated_case_is_none_that_was_measured(service: Inside, tmp_path: Path) -> None:
    library = service.service.library
    (tmp_path / "other.wav").write_bytes(sound(9, impacts=True))
    intake = take_in(library, tmp_path / "other.wav", "other.wav", "audio/wav", RecordingMetadata())
    with library.transaction("generator") as session:
        row = intake.store(library, session)
        library.retain.case(session, row, Labelling("notch", origin="simulated", key="made"))
        assert simulated(session, [row]) == {row.id}
    parts = {"file": ("heard.wav", sound(9, impacts=True)), "metadata": (None, '{"gearbox": "g1"}')}
    diagnosis = service.ask("POST", f"{API}/diagnoses", files=parts).raise_for_status().json()
    made = service.ask("POST", f"{API}/cases", json={"diagnosis_id": diagnosis["id"], "label": "notch"})
    assert made.json()["origin"] == "simulated"
