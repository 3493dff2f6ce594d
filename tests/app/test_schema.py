"""The running service held against its own OpenAPI document, operation by operation, with made-up requests."""

import io

import numpy as np
import schemathesis
import soundfile
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from schemathesis.specs.openapi.checks import positive_data_acceptance

from app.main import create_app
from tests.live import LiveServer


def _wav(seed: int) -> bytes:
    target = io.BytesIO()
    noise = np.random.default_rng(seed).normal(scale=0.1, size=2000)
    soundfile.write(target, noise, 8000, format="WAV")
    return target.getvalue()


EXAMPLES = 12
PHASES = (Phase.generate,)

schemathesis.openapi.media_type("audio/wav", st.integers(0, 20).map(_wav))
schema = schemathesis.openapi.from_dict(create_app().openapi())


# an Idempotency-Key or If-Match drawn twice is refused for good reasons; an axis has rules that no JSON schema says
UNDECIDABLE_HEADERS = ("Idempotency-Key", "If-Match")
UNDECIDABLE_BODIES = {("POST", "/api/v1/axes"), ("POST", "/api/v1/simulations")}


@schema.parametrize()
@settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck), phases=PHASES)
def test_operation(case: schemathesis.Case, live_server: LiveServer) -> None:
    for name in UNDECIDABLE_HEADERS:
        case.headers.pop(name, None)
    excluded = [positive_data_acceptance] if (case.method, case.path) in UNDECIDABLE_BODIES else []
    headers = {"Authorization": f"Bearer {live_server.keys['admin']}"}
    case.call_and_validate(base_url=live_server.url, headers=headers, excluded_checks=excluded)
