"""A library from empty to cross-validated; and what an installation may set stricter."""

import json
from collections.abc import Iterator

import httpx
import pytest

from benchmarks.harness.live import LiveServer, gearcase, started
from benchmarks.harness.sounds import sound

EVALUATION = "/api/v1/library/evaluation"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    environment = {"GEARCASE_REQUIRE_IF_MATCH": "true", "GEARCASE_FAILED_KEYS": "5/minute"}
    server = started(tmp_path_factory.mktemp("library") / "data", **environment)
    yield server
    server.stop()


def add(client: httpx.Client, seed: int, label: str, gearbox: str) -> None:
    content = sound(seed, impacts=label == "notch")
    data = {"metadata": json.dumps({"label": label, "gearbox": gearbox})}
    client.post("/api/v1/cases", files={"file": ("x.wav", content)}, data=data).raise_for_status()


def test_evaluation_follows_the_library(server: LiveServer) -> None:
    with server.client() as admin, server.client("viewer") as viewer:
        assert viewer.get(EVALUATION).json()["cases"] == 0
        for gearbox in range(3):
            add(admin, 10 * gearbox, "normal", f"g{gearbox}")
            add(admin, 10 * gearbox + 5, "notch", f"g{gearbox}")
        found = viewer.get(EVALUATION).json()
        assert (found["cases"], found["gearboxes"]) == (6, 3)
        answered = sum(count for row in found["confusion"].values() for count in row.values())
        assert answered == 6
        assert found["accuracy"]["low"] <= found["accuracy"]["value"] <= found["accuracy"]["high"]
        cells = [case for row in found["cells"].values() for cell in row.values() for case in cell]
        listed = viewer.get("/api/v1/cases").json()["items"]
        assert sorted(cells) == sorted(case["id"] for case in listed)
        printed = gearcase("evaluate", "--group", "gearbox", "--json", data_dir=server.data_dir).stdout
        assert {name: value for name, value in json.loads(printed).items() if name in found} == found


def test_change_without_etag_where_one_is_required(server: LiveServer) -> None:
    with server.client() as admin:
        add(admin, 500, "normal", "etag")
        case = admin.get("/api/v1/cases", params={"gearbox": "etag"}).json()["items"][0]
        path = f"/api/v1/cases/{case['id']}"
        answer = admin.patch(path, json={"note": "x"})
        assert answer.status_code == 428
        assert "If-Match" in answer.json()["detail"]
        assert admin.patch(path, json={"note": "x"}, headers={"If-Match": "*"}).status_code == 200


def test_wrong_keys_are_limited_and_a_valid_one_still_works(server: LiveServer) -> None:
    with server.client() as admin, server.client(None) as guess:
        wrong = [{"Authorization": f"Bearer gearcase_{number}"} for number in range(7)]
        answers = [guess.get("/api/v1/cases", headers=headers) for headers in wrong]
        assert [answer.status_code for answer in answers] == [401] * 5 + [429] * 2
        assert int(answers[-1].headers["retry-after"]) > 0
        assert admin.get("/api/v1/cases").status_code == 200
