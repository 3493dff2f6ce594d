"""What is left out of a recording stands in the answer, on the page, in the report and in the terminal, once each."""

import json
from collections.abc import Iterator
from typing import Any

import pytest

from app.report.diagnosis_view import analysed
from app.report.disturbed import marked, stretches
from benchmarks.harness.live import LiveServer, started
from benchmarks.harness.sounds import wav
from signals.condition import UNKNOWN
from signals.recording_quality.disturbances import Survey, survey
from tests.signals.synthetic import KNOCK_S, SILENT_S, Joint, disturbed, sound
from tests.web.reading import Markup


@pytest.fixture(scope="module")
def surveyed() -> Survey:
    return survey(disturbed(), UNKNOWN)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A service that knows normal and notched joints of two gearboxes."""
    server = started(tmp_path_factory.mktemp("shown") / "data")
    with server.client() as admin:
        for seed in range(8):
            label = ("normal", "notch")[seed % 2]
            metadata = json.dumps({"label": label, "gearbox": f"g{seed // 4}"})
            files = {"file": (f"{seed}.wav", wav(sound(Joint(label, 10 + seed))))}
            admin.post("/api/v1/cases", files=files, data={"metadata": metadata}).raise_for_status()
    yield server
    server.stop()


@pytest.fixture(scope="module")
def answer(server: LiveServer) -> dict[str, Any]:
    with server.client("operator") as client:
        files = {"file": ("field.wav", wav(disturbed().samples))}
        found: dict[str, Any] = client.post("/api/v1/diagnoses", files=files).raise_for_status().json()
    return found


def page(server: LiveServer, path: str) -> Markup:
    with server.client(None) as client:
        client.headers["Accept"] = "text/html"
        client.cookies.update(server.session("viewer"))
        return Markup(client.get(path).raise_for_status().text)


def test_stretches_lie_where_the_disturbance_is(surveyed: Survey) -> None:
    named = {each.text: each for each in stretches(surveyed) if each.text}
    assert named["silence"].start_s == 0
    assert named["silence"].end_s == pytest.approx(SILENT_S, abs=0.2)
    assert named["knock"].start_s == pytest.approx(KNOCK_S, abs=0.1)
    assert "silence" in marked(surveyed)
    assert "knock at 1" in marked(surveyed)


def test_analysed_piece_and_cycles_are_those_of_the_survey(surveyed: Survey) -> None:
    """20 s of cycles of 6.2 s follow the silence."""
    name, piece, cycles = analysed(surveyed)
    first, last = (float(word) for word in str(piece).removesuffix(" s").split(" to "))
    assert name == "Analysed"
    assert SILENT_S - 0.2 < first < SILENT_S + 0.3
    assert last == pytest.approx(SILENT_S + 20, abs=0.2)
    assert float(cycles.split()[0]) == pytest.approx(20 / 6.2, abs=0.3)


def test_answer_says_what_and_when(answer: dict[str, Any]) -> None:
    kinds = {each["kind"]: each for each in answer["disturbances"]}
    assert kinds["silence"]["end_s"] == pytest.approx(SILENT_S, abs=0.2)
    assert kinds["bump"]["start_s"] == pytest.approx(KNOCK_S, abs=0.1)
    assert {each["severity"] for each in answer["disturbances"]} <= {"info", "poor"}
    times = {each["name"]: (each["start_s"], each["end_s"]) for each in answer["quality"]}
    assert times["bump"] == (kinds["bump"]["start_s"], kinds["bump"]["end_s"])


def test_page_and_report_name_what_is_left_out_without_script(server: LiveServer, answer: dict[str, Any]) -> None:
    shown = page(server, f"/diagnoses/{answer['id']}")
    assert "Left out: silence 0.0 to" in shown.text
    assert "Analysed" in shown.text
    assert shown.count("rect", class_="stretch") >= 2
    with server.client("viewer") as client:
        headers = {"Accept": "text/html"}
        report = Markup(client.get(f"/api/v1/diagnoses/{answer['id']}/report", headers=headers).text)
    assert "Left out: silence 0.0 to" in report.text
    assert report.count("rect", class_="stretch") == shown.count("rect", class_="stretch")
