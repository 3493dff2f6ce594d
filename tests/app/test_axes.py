"""Axes over HTTP: one that nothing names can be removed."""

import json

import httpx

from benchmarks.harness.sounds import sound

AXES = "/api/v1/axes"
AXIS = {"motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 40.0}}


def test_an_axis_that_nothing_names_is_removed_with_its_revisions(admin: httpx.Client) -> None:
    for inertia in (40.0, 50.0):
        document = {**AXIS, "name": "of no use", "load": {"inertia_kg_m2": inertia}}
        admin.post(AXES, json=document).raise_for_status()
    assert admin.delete(f"{AXES}/of no use").status_code == 204
    assert admin.get(f"{AXES}/of no use").status_code == 404
    assert admin.get(f"{AXES}/of no use", params={"revision": 1}).status_code == 404
    assert admin.delete(f"{AXES}/of no use").status_code == 404
    audit = admin.get("/api/v1/audit").json()["items"]
    (entry,) = (each for each in audit if (each["action"], each["subject_id"]) == ("axis.removed", "of no use"))
    assert entry["before"] == {"revision": 2}


def test_an_axis_that_a_recording_names_stays(admin: httpx.Client) -> None:
    admin.post(AXES, json={**AXIS, "name": "in use"}).raise_for_status()
    files = {"file": ("a.wav", sound(4711), "audio/wav")}
    admin.post("/api/v1/diagnoses", files=files, data={"metadata": json.dumps({"axis": "in use"})}).raise_for_status()
    answer = admin.delete(f"{AXES}/in use")
    assert (answer.status_code, "so it stays" in answer.json()["detail"]) == (409, True)
    assert admin.get(f"{AXES}/in use").status_code == 200


def test_a_case_may_be_proposed(admin: httpx.Client) -> None:
    metadata = {"label": "normal", "state": "proposed"}
    files = {"file": ("a.wav", sound(4712), "audio/wav")}
    case = admin.post("/api/v1/cases", files=files, data={"metadata": json.dumps(metadata)}).raise_for_status().json()
    assert case["state"] == "proposed"
    told = admin.patch(f"/api/v1/cases/{case['id']}", json={"state": "confirmed"}).raise_for_status().json()
    assert told["state"] == "confirmed"
    refused = admin.post("/api/v1/cases", files=files, data={"metadata": json.dumps({**metadata, "state": "retired"})})
    assert refused.status_code == 422
    admin.delete(f"/api/v1/cases/{case['id']}").raise_for_status()
