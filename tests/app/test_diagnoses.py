"""A diagnosis over HTTP, from the recording to the corrected case."""

import json
import math
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from benchmarks.harness.live import LiveServer, gearcase, started
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


SINE = {"kind": "sine", "stroke_rad": 3.0, "load_speed_rad_s": 1.5 * math.pi}


def table(
    angle: str = "load_position_rad", factor: float = 1.0, start: float = 0.0, end: float = 6.0, late: float = 0.0
) -> bytes:
    """Return telemetry of the motion of `sound`, a sine of 2 s that begins at one end, by a clock that is so late."""
    time = np.arange(round(100 * start), round(100 * end)) / 100
    way = factor * 1.5 * (1 - np.cos(np.pi * time))
    rows = "".join(f"{t:.2f},{x:.6f},0.5\n" for t, x in zip(time - late, way, strict=True))
    return f"time_s,{angle},current [A]\n{rows}".encode()


def with_table(client: httpx.Client, content: bytes, path: str = DIAGNOSES, **data: object) -> httpx.Response:
    """Send a recording with telemetry beside it."""
    parts = {name: value if isinstance(value, str) else json.dumps(value) for name, value in data.items()}
    return client.post(path, files={"file": ("x.wav", sound(70)), "telemetry": ("log.csv", content)}, data=parts)


def stored(client: httpx.Client, diagnosis: httpx.Response) -> dict[str, Any]:
    """Return the condition that the recording of a diagnosis has."""
    path = f"/api/v1/recordings/{diagnosis.raise_for_status().json()['recording']['id']}"
    return dict(client.get(path).json()["description"]["condition"])


def test_a_motion_is_kept_and_implies_speed_and_period(operator: httpx.Client) -> None:
    made = stored(operator, diagnose(operator, sound(70), motion=SINE))
    assert made["motion"] == {**SINE, "acceleration_time_s": None, "dwell_s": 0.0}
    assert (made["speed_rad_s"], made["motion_period_s"]) == pytest.approx((1.5 * math.pi, 2.0))


@pytest.mark.parametrize(
    ("metadata", "named"),
    [
        ({"motion": {**SINE, "kind": "trapezoid"}}, "acceleration_time_s"),
        ({"motion": {**SINE, "stroke": 1.0}}, "motion.stroke"),
        ({"motion": {"kind": "sine"}}, "motion.stroke_rad"),
        ({"motion": SINE, "speed_rad_s": 3.0}, "speed_rad_s"),
        ({"motion": SINE, "steady": True}, "steady"),
    ],
)
def test_a_motion_that_cannot_be_is_refused(operator: httpx.Client, metadata: dict[str, Any], named: str) -> None:
    answer = diagnose(operator, sound(71), **metadata)
    assert answer.status_code == 422
    assert named in answer.json()["detail"]


def test_the_motion_of_telemetry_wins_over_a_typed_one(operator: httpx.Client) -> None:
    made = with_table(operator, table(), metadata={"speed_rad_s": 2.5, "motion_period_s": 2.01})
    condition = stored(operator, made)
    assert condition["motion"]["kind"] == "sine"
    assert condition["motion"]["stroke_rad"] == pytest.approx(3.0, rel=0.01)
    assert (condition["speed_rad_s"], condition["motion_period_s"]) == pytest.approx((4.71, 2.0), rel=0.01)
    assert condition["reversal_times_s"] == pytest.approx([1, 2, 3, 4, 5], abs=0.02)
    remarks = [remark for remark in made.json()["remarks"] if "telemetry" in remark]
    assert len(remarks) == 1, "a period that differs by less than 5 % is the same"
    assert remarks[0].startswith("speed_rad_s")


def test_a_clock_that_begins_later_is_that_of_the_sound(operator: httpx.Client) -> None:
    assert stored(operator, with_table(operator, table("load angle [rad]", start=2.0)))[
        "reversal_times_s"
    ] == pytest.approx([3, 4, 5], abs=0.02)


def test_a_log_of_another_moment_does_not_move_the_reversals(operator: httpx.Client) -> None:
    made = with_table(operator, table(start=2.4, late=2.4))
    assert "reversal_times_s" not in stored(operator, made)
    assert any("reversals of the telemetry" in remark for remark in made.json()["remarks"])


def test_telemetry_may_be_of_the_motor_or_need_a_channel_map(operator: httpx.Client, server: LiveServer) -> None:
    axis = {"name": "geared", "motor": {"inertia_kg_m2": 0.001}, "load": {"inertia_kg_m2": 10.0}}
    stage = {"name": "output", "ratio": 50.0, "inertia_kg_m2": 0.1}
    motor = table("motor_position_rad", 50.0)
    with server.client() as admin:
        admin.post("/api/v1/axes", json={**axis, "stages": [stage]}).raise_for_status()
        described = {"axis": "geared", "label": "normal", "gearbox": "g70"}
        case = with_table(admin, motor, "/api/v1/cases", metadata=described).raise_for_status().json()
    assert case["recording"]["description"]["condition"]["motion"]["stroke_rad"] == pytest.approx(3.0, rel=0.01)
    found = with_table(operator, motor, metadata={"axis": "geared"}).json()
    assert any("52% of the turn of output" in remark for remark in found["remarks"])
    columns = {"time_s": {"column": 1, "unit": "s"}, "load_position_rad": {"column": 2, "unit": "deg"}}
    mapped = with_table(operator, table("way", 180 / math.pi), channels=columns)
    assert stored(operator, mapped)["motion"]["stroke_rad"] == pytest.approx(3.0, rel=0.01)


@pytest.mark.parametrize(
    "content", [table("motor_position_rad"), table("angle [rad]"), b"no table", table(end=1.5)], ids=range(4)
)
def test_bad_telemetry_is_refused_at_its_field(operator: httpx.Client, content: bytes) -> None:
    before = operator.get(DIAGNOSES).json()
    answer = with_table(operator, content)
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["location"] == "telemetry"
    assert operator.get(DIAGNOSES).json() == before
    alone = operator.post(DIAGNOSES, files={"file": sound(70)}, data={"channels": "x"})
    assert alone.status_code == 422


def test_the_command_line_takes_telemetry(tmp_path: Path) -> None:
    for name, content in (("x.wav", sound(70)), ("log.csv", table()), ("bad.csv", b"no table")):
        (tmp_path / name).write_bytes(content)
    words = ("diagnose", tmp_path / "x.wav", "--json", "--telemetry")
    good, bad = (gearcase(*words, tmp_path / name, data_dir=tmp_path / "data") for name in ("log.csv", "bad.csv"))
    assert json.loads(good.stdout)[0]["recording"]["speed_rad_s"] == pytest.approx(4.71, rel=0.01)
    assert (bad.code, "telemetry" in json.loads(bad.stdout)[0]["error"]) == (2, True)
    assert gearcase(*words, tmp_path / "log.csv", tmp_path / "x.wav", data_dir=tmp_path / "data").code == 2
