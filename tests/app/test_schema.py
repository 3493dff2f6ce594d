"""The running service held against its own OpenAPI document, operation by operation, with made-up requests."""

import io
from collections.abc import Iterator

import numpy as np
import pytest
import schemathesis
import soundfile
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from schemathesis.specs.openapi.checks import positive_data_acceptance

from app.main import create_app
from benchmarks.harness.live import LiveServer, started


def _wav(seed: int) -> bytes:
    target = io.BytesIO()
    noise = np.random.default_rng(seed).normal(scale=0.1, size=2000)
    soundfile.write(target, noise, 8000, format="WAV")
    return target.getvalue()


EXAMPLES = 5
PHASES = (Phase.generate,)

schemathesis.openapi.media_type("audio/wav", st.integers(0, 20).map(_wav))
schema = schemathesis.openapi.from_dict(create_app().openapi())


# an Idempotency-Key or If-Match drawn twice is refused for good reasons; whether an axis, or metadata of a recording
# (a channel that is there), an address of its kind, a rule that does not contradict itself, is more than a JSON schema
# can say
UNDECIDABLE_HEADERS = ("Idempotency-Key", "If-Match")
UNDECIDABLE = (
    "axes", "robots", "simulations", "investigations", "cases", "diagnoses", "retrievals", "alarms/receivers",
    "alarms/rules",
)  # fmt: skip
UNDECIDABLE_BODIES = {f"/api/v1/{noun}" for noun in UNDECIDABLE}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    server = started(tmp_path_factory.mktemp("schema") / "data")
    server.until_ready()
    yield server
    server.stop()


@schema.parametrize()
@settings(
    max_examples=EXAMPLES, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck), phases=PHASES
)
def test_operation(case: schemathesis.Case, server: LiveServer) -> None:
    for name in UNDECIDABLE_HEADERS:
        case.headers.pop(name, None)
    excluded = [positive_data_acceptance] if case.method == "POST" and case.path in UNDECIDABLE_BODIES else []
    headers = {"Authorization": f"Bearer {server.keys['admin']}"}
    case.call_and_validate(base_url=server.url, headers=headers, excluded_checks=excluded)


def test_every_example_of_a_json_body_can_be_sent(server: LiveServer) -> None:
    """As it stands; what it says of other things, an id that was answered before, is put in."""
    document, known = schema.raw_schema, {}
    with server.client("admin") as client:
        made = client.post("/api/v1/diagnoses", files={"file": ("one.wav", _wav(1))}).raise_for_status().json()
        known["diagnosis_id"] = made["id"]
        for path, operations in document["paths"].items():
            for method, operation in operations.items():
                given = operation.get("requestBody", {}).get("content", {}).get("application/json")
                if given is None:
                    continue
                named = given["schema"].get("$ref", "").rpartition("/")[2]
                described = document["components"]["schemas"][named] if named else given["schema"]
                example = given.get("example") or described["examples"][0]
                body = {name: known.get(name, value) for name, value in example.items()}
                answer = client.request(method, path.format_map(known), json=body)
                assert answer.is_success, (method, path, answer.text)
                noun = path.rpartition("/")[2]
                if "id" in answer.json():
                    known[f"{noun.removesuffix('s')}_id"] = answer.json()["id"]
                    known[noun] = [answer.json()["id"]]
