"""The library's cross-validation over HTTP and by command: the same numbers, which change with the library."""

import json
from collections.abc import Iterator

import httpx
import pytest

from tests.app.sounds import sound
from tests.live import LiveServer, gearcase, started

EVALUATION = "/api/v1/library/evaluation"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    server = started(tmp_path_factory.mktemp("library") / "data")
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
        assert json.loads(printed) == found


def test_unknown_group(server: LiveServer) -> None:
    with server.client("viewer") as viewer:
        assert viewer.get(EVALUATION, params={"group": "colour"}).status_code == 422
