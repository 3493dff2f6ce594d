"""A diagnosis over HTTP, from the recording to the corrected case."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from benchmarks.harness.live import LiveServer, started
from benchmarks.harness.sounds import sound

DIAGNOSES = "/api/v1/diagnoses"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A service whose library knows a hum and a hum with impacts."""
    server = started(tmp_path_factory.mktemp("diagnoses") / "data")
    with server.client() as admin:
        for seed in range(4):
            for label, impacts in (("normal", False), ("notch", True)):
                content = sound(seed + 50 * impacts, impacts=impacts)
                data = {"metadata": json.dumps({"label": label, "gearbox": f"g{seed}"})}
                admin.post("/api/v1/cases", files={"file": ("x.wav", content)}, data=data).raise_for_status()
    yield server
    server.stop()


@pytest.fixture
def operator(server: LiveServer) -> Iterator[httpx.Client]:
    with server.client("operator") as client:
        yield client


def diagnose(client: httpx.Client, content: bytes, name: str = "x.wav", **metadata: object) -> httpx.Response:
    return client.post(DIAGNOSES, files={"file": (name, content)}, data={"metadata": json.dumps(metadata)})


def test_curl_of_the_readme(server: LiveServer, tmp_path: Path) -> None:
    if shutil.which("curl") is None:
        pytest.skip("no curl here")
    readme = (Path(__file__).parents[2] / "README.md").read_text("utf-8")
    command = re.search(r"^ +(curl .*?/api/v1/diagnoses)$", readme, re.MULTILINE | re.DOTALL)
    assert command
    (tmp_path / "recording.wav").write_bytes(sound(7, impacts=True))
    words = command.group(1).replace("http://127.0.0.1:8000", server.url)
    environment = {**os.environ, "GEARCASE_KEY": server.keys["operator"]}
    done = subprocess.run(
        ["sh", "-c", f"{words} --silent --fail"], cwd=tmp_path, env=environment, capture_output=True, check=True
    )
    assert json.loads(done.stdout)["verdict"] in ("diagnosed", "ambiguous", "not_in_library")


def test_answer_is_the_contract(operator: httpx.Client) -> None:
    made = diagnose(operator, sound(8, impacts=True), speed_rad_s=2.5)
    answer = made.json()
    assert operator.get(made.headers["location"]).json() == answer
    assert answer["verdict"] in ("diagnosed", "ambiguous", "not_in_library", "unusable")
    assert {each["label"] for each in answer["hypotheses"]} == {"normal", "notch"}
    for each in answer["hypotheses"]:
        assert 0 <= each["probability"] <= 1
        assert 0 <= each["p_value"] <= 1
        assert set(each["support"]) == {"measured", "simulated"}
    assert sum(each["probability"] for each in answer["hypotheses"]) == pytest.approx(1)
    assert answer["neighbours"]
    for each in answer["neighbours"]:
        assert each["origin"] == "measured"
        assert operator.get(f"/api/v1/cases/{each['case_id']}").json()["label"] == each["label"]
        assert sum(each["contributions"].values()) == pytest.approx(each["distance"], rel=1e-3)
    assert set(answer["novelty"]) >= {"distance", "threshold"}
    assert answer["recording"]["duration_s"] == 6.0
    assert answer["provenance"]
    assert "NaN" not in json.dumps(answer)


def test_confirmed_diagnosis_becomes_a_case(server: LiveServer, operator: httpx.Client) -> None:
    made = diagnose(operator, sound(11, impacts=True), gearbox="g11").json()
    path = f"{DIAGNOSES}/{made['id']}"
    revised = operator.patch(path, json={"verdict": "corrected", "label": "notch", "verified_by": "gearbox opened"})
    assert revised.status_code == 200
    revision = operator.get(path).json()["revision"]
    assert (revision["state"], revision["label"], revision["verified_by"]) == ("corrected", "notch", "gearbox opened")
    body = {"diagnosis_id": made["id"], "label": "notch"}
    assert operator.post("/api/v1/cases", json=body).status_code == 403
    with server.client() as admin:
        case = admin.post("/api/v1/cases", json=body)
        assert case.status_code == 201
        assert admin.get(case.headers["location"]).json()["diagnosis_id"] == made["id"]
        assert case.json()["verified_by"] == "gearbox opened"


@pytest.mark.parametrize(
    "body",
    [
        {"verdict": "corrected"},
        {"verdict": "rejected", "label": "notch"},
        {"verdict": "perhaps"},
        {"verdict": "confirmed", "label": "something-else"},
        {"label": "notch"},
        {},
    ],
)
def test_revision_that_makes_no_sense(operator: httpx.Client, body: dict[str, str]) -> None:
    made = diagnose(operator, sound(12)).json()
    answer = operator.patch(f"{DIAGNOSES}/{made['id']}", json=body)
    assert answer.status_code == 422
    assert operator.get(f"{DIAGNOSES}/{made['id']}").json()["revision"]["state"] == "open"


def test_list_is_newest_first_and_filtered(operator: httpx.Client) -> None:
    made = [diagnose(operator, sound(13), gearbox=f"list{n}").json()["id"] for n in range(3)]
    items = operator.get(DIAGNOSES, params={"limit": 3}).json()["items"]
    assert [item["id"] for item in items] == made[::-1]
    items = operator.get(DIAGNOSES, params={"gearbox": "list1"}).json()["items"]
    assert [item["id"] for item in items] == [made[1]]


def test_report_is_one_offline_page(operator: httpx.Client) -> None:
    name = '<script>alert("x")</script>.wav'
    made = diagnose(operator, sound(14, impacts=True), name=name, gearbox="<img src=x>").json()
    answer = operator.get(f"{DIAGNOSES}/{made['id']}/report", headers={"Accept": "text/html"})
    page = answer.text
    assert answer.headers["content-type"].startswith("text/html")
    assert "<script" not in page
    assert "<img src=x" not in page
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", page)
    assert "<svg" in page
    assert "data:image/png" in page
    assert "default-src 'none'" in answer.headers["content-security-policy"]
    same = operator.get(f"{DIAGNOSES}/{made['id']}/report", headers={"Accept": "application/json"})
    assert same.json() == made


def test_when_a_notch_comes_is_said_as_a_time_of_the_cycle_and_no_angle(
    operator: httpx.Client, server: LiveServer
) -> None:
    made = diagnose(operator, sound(60, impacts=True), speed_rad_s=2.5).raise_for_status().json()
    said = {item["quantity"]: item for item in made["evidence"]}
    event, period_s = said["notch_phase"], said["motion_period"]["value"]
    time_s = event["value"] / 360 * period_s
    assert f"{time_s:.2f} s into the motion's cycle" in event["statement"]
    assert "angle" not in event["statement"]
    cookies = server.session("viewer")
    page = httpx.get(f"{server.url}/diagnoses/{made['id']}", cookies=cookies).raise_for_status().text
    assert "Time in the cycle" in page
    assert "<dt>Angle</dt>" not in page
    assert "at the angle where" not in page
