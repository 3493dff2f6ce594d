"""A whole robot over HTTP: two links in a plane, whose torques stand in every textbook."""

import json

import httpx
import numpy as np
import pytest

from app.investigations import get_investigation, names_of, perform
from benchmarks.harness.live import LiveServer
from benchmarks.harness.plane_robot import DRY, MAP, ROBOT, log, parts, urdf
from casebase.library import CaseLibrary
from sim.robot.urdf import read_urdf

URL, ROBOTS = "/api/v1/investigations", "/api/v1/robots"


def test_a_robot_becomes_one_document_page_and_report(
    operator: httpx.Client, viewer: httpx.Client, admin: httpx.Client, live_server: LiveServer
) -> None:
    """The friction that was put in is found at its joint, and nothing hangs at the last link where nothing does."""
    given = parts(telemetry=("log.csv", log()))
    once = {"Idempotency-Key": "one robot"}
    asked = operator.post(URL, files=given, headers=once).raise_for_status()
    again = operator.post(URL, files=given, headers=once).raise_for_status()
    assert (asked.status_code, again.json()["id"]) == (202, asked.json()["id"])
    identity = asked.json()["investigation_id"]
    assert asked.headers["location"].endswith(f"/jobs/{identity}")
    stages: list[str] = []
    library = CaseLibrary.open(live_server.data_dir)
    perform(library, identity, lambda stage, _: stages.append(stage))
    with library.reading() as session:
        row = get_investigation(session, identity)
    library.close()
    assert (row.axis, row.robot, names_of(row, "urdf")) == (None, "plane arm", ["arm.urdf"])
    assert list(dict.fromkeys(stages))[2:-1] == ["joint 1 of 2, shoulder", "joint 2 of 2, elbow"]

    document = viewer.get(f"{URL}/{identity}").raise_for_status().json()
    found = {(f["mechanism"], f["location"]): f for f in document["findings"] if f["probability"] >= 0.9}
    assert {place for _, place in found} == {"shoulder", "elbow"}
    for joint, dry in zip(("shoulder", "elbow"), DRY, strict=True):
        torque = found["coulomb_friction", joint]["parameters"][0]
        assert torque["low"] <= dry <= torque["high"]
    assert [one["name"] for one in document["joints"]] == ["shoulder", "elbow"]
    assert {one["joint"] for one in document["gain"]} == {"shoulder", "elbow"}
    for panel in document["story"]["overlay"]:  # where it ends, the extended model has no torque
        lines = {one["name"]: np.array(one["y"], dtype=float) for one in panel["lines"]}
        rigid = lines["measured"] - lines["rigid body, as described"]
        assert np.nanstd(lines["left by the last"]) < 0.3 * np.std(rigid)
    listed = viewer.get(URL, params={"limit": 1}).json()["items"][0]
    assert (listed["axis"], listed["robot"], listed["state"]) == (None, "plane arm", "done")
    accepted = admin.post(f"{URL}/{identity}/accept").raise_for_status()
    assert accepted.headers["location"] == f"{ROBOTS}/plane%20arm"
    taken = viewer.get(accepted.headers["location"]).raise_for_status().json()
    assert taken["document"]["joints"] == document["extended_axis"]["joints"]
    first = viewer.get(f"{ROBOTS}/plane arm", params={"revision": taken["revision"] - 1}).raise_for_status().json()
    assert "axis" not in first["document"]["joints"][0]
    assert admin.post(f"{URL}/{identity}/accept").json()["revision"] == taken["revision"]

    report = viewer.get(f"{URL}/{identity}/report", headers={"Accept": "text/html"}).text
    cookies = live_server.session("viewer")
    page = httpx.get(f"{live_server.url}/investigations/{identity}", cookies=cookies).raise_for_status().text
    for shown in (report, page):
        assert [f'id="joint-{k}"' in shown for k in (1, 2, 3)] == [True, True, False]
    known = httpx.get(f"{live_server.url}/robots/plane arm", cookies=cookies).raise_for_status().text
    for shown in (f'href="/investigations/{identity}"', "2. elbow", f"accepted investigation {identity}"):
        assert shown in known
    index = httpx.get(f"{live_server.url}/investigations", cookies=cookies).raise_for_status().text
    assert "plane arm" in index


AXIS = b"""{"name": "elbow drive", "motor": {"inertia_kg_m2": 1e-4}, "load": {"inertia_kg_m2": 0.05},
    "stages": [{"name": "gear", "ratio": 100.0}]}"""
NAMING = (ROBOT + 'axis = "axis2.toml"\n').encode()


def test_the_axis_of_a_joint_comes_as_a_file_or_as_a_table(operator: httpx.Client, live_server: LiveServer) -> None:
    as_file = parts(robot=("r.toml", NAMING), axis=("axis2.toml", AXIS))
    inline = {"name": "plane arm", "joints": [{"name": "shoulder"}, {"name": "elbow", "axis": json.loads(AXIS)}]}
    kept = []
    for given in (as_file, parts(robot=("r.json", json.dumps(inline).encode()))):
        asked = operator.post(URL, files=given).raise_for_status().json()
        library = CaseLibrary.open(live_server.data_dir)
        with library.reading() as session:
            kept.append(get_investigation(session, asked["investigation_id"]).axis_document)
        library.close()
        operator.delete(f"/api/v1/jobs/{asked['id']}").raise_for_status()
        url = f"{URL}/{asked['investigation_id']}"
        assert "cancelled" in operator.get(url).json()["detail"]
    assert kept[0] == kept[1] == inline


def described(name: str, more: str = "") -> dict[str, tuple[str, bytes]]:
    text = f'name = "{name}"\n{more}\n' + ROBOT.partition("\n")[2]
    return {"robot": ("robot.toml", text.encode()), "urdf": ("arm.urdf", urdf())}


def test_robots_are_kept_revision_by_revision(admin: httpx.Client, viewer: httpx.Client) -> None:
    stored = admin.post(ROBOTS, files=described("kept arm"))
    assert (stored.status_code, stored.headers["location"]) == (201, f"{ROBOTS}/kept%20arm")
    again = admin.post(ROBOTS, files=described("kept arm")).json()
    heavier = admin.post(ROBOTS, files=described("kept arm", "payload = {mass_kg = 2.0}")).json()
    assert [one["revision"] for one in (stored.json(), again, heavier)] == [1, 1, 2]
    url = f"{ROBOTS}/kept arm"
    assert viewer.get(url).json() == heavier
    assert viewer.get(url, params={"revision": 1}).json() == stored.json()
    assert viewer.get(f"{url}/revisions").json()["items"] == [stored.json(), heavier]
    assert heavier in viewer.get(ROBOTS, params={"limit": 200}).json()["items"]
    assert read_urdf(viewer.get(f"{url}/urdf").content) == read_urdf(urdf())
    assert viewer.get(f"{ROBOTS}/nobody").status_code == 404
    assert "unknown parts: telemetry" in admin.post(ROBOTS, files=parts(channels=("", b""))).json()["detail"]


def test_a_stored_robot_is_investigated_by_its_name(
    admin: httpx.Client, operator: httpx.Client, live_server: LiveServer
) -> None:
    """Its investigation keeps the description of that day, and is that of the robot sent whole."""
    admin.post(ROBOTS, files=described("named arm")).raise_for_status()
    given = {"telemetry": ("log.csv", log()), "channels": ("map.toml", MAP.encode())}
    asked = operator.post(URL, data={"robot": "named arm"}, files=given).raise_for_status().json()
    whole = operator.post(URL, files={**described("named arm"), **given}).raise_for_status().json()
    library = CaseLibrary.open(live_server.data_dir)
    with library.reading() as session:
        by_name, sent = (get_investigation(session, one["investigation_id"]) for one in (asked, whole))
    library.close()
    for one in (asked, whole):
        operator.delete(f"/api/v1/jobs/{one['id']}").raise_for_status()
    assert (by_name.robot, by_name.axis) == ("named arm", None)
    assert by_name.axis_document == sent.axis_document
    assert by_name.inputs["urdf"]["sha256"] == sent.inputs["urdf"]["sha256"]  # type: ignore[index]
    unknown = operator.post(URL, data={"robot": "nobody"}, files=given)
    assert (unknown.status_code, "POST /robots adds one" in unknown.json()["detail"]) == (404, True)
    both = operator.post(URL, data={"robot": "named arm"}, files={**given, "urdf": ("arm.urdf", urdf())})
    assert (both.status_code, "name of a stored robot" in both.json()["detail"]) == (422, True)


DEEP = b"<robot>" + b"<link>" * 30_000
BOMB = b'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
MANY = b"<robot><link name='l0'/>" + b"".join(
    f"<link name='l{k}'/><joint name='j{k}' type='continuous'><parent link='l0'/><child link='l{k}'/></joint>".encode()
    for k in range(1, 200)
) + b"</robot>"  # fmt: skip
SLOW = ("x" + ".x" * 100_000 + " = 1").encode()


@pytest.mark.parametrize(
    ("other", "status", "told"),
    [
        ({"axis": ("axis9.toml", AXIS)}, 422, "no joint of the robot names the file"),
        ({"sound": ("s.wav", b"RIFF")}, 422, "'sound' does not go with a robot"),
        ({"robot": ("", b"")}, 422, "'urdf' belongs to a robot"),
        ({"urdf": ("", b"")}, 422, "'urdf'"),
        ({"urdf": ("u", b" " * (5 << 20))}, 413, "it may have 4194304"),
        ({"telemetry": ("", b"")}, 422, "needs telemetry of its joints"),
        ({"channels": ("", b"")}, 422, "time_s has no unit"),
        ({"channels": ("m", MAP.replace(', "q2"', "").encode())}, 422, "[motor_position_rad] column has 1 entries"),
        ({"channels": ("m", MAP.replace('"tau2"', '"tau3"').encode())}, 422, "elbow: "),
        ({"channels": ("m", SLOW)}, 422, "channel map: "),
        ({"robot": ("r", NAMING)}, 422, "joints[1].axis: names the file 'axis2.toml'"),
        ({"robot": ("r", NAMING), "axis": ("axis2.toml", b"motor = 1")}, 422, "joints[1].axis: "),
        ({"robot": ("r", ROBOT.replace("elbow", "wrist").encode())}, 422, "'wrist' is no joint that moves in the URDF"),
        ({"urdf": ("u", BOMB)}, 422, "declares a document type"),
        ({"urdf": ("u", DEEP)}, 422, "nest more than 50 deep"),
        ({"urdf": ("u", MANY)}, 422, "199 joints move; there may be 128"),
    ],
)
def test_what_is_no_robot_is_refused_in_words(
    operator: httpx.Client, other: dict[str, tuple[str, bytes]], status: int, told: str
) -> None:
    refused = operator.post(URL, files=parts(**other))
    assert (refused.status_code, refused.headers["content-type"]) == (status, "application/problem+json")
    assert told in refused.json()["detail"]
    assert operator.get("/readyz").status_code == 200
