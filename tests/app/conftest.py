"""Fixtures of these tests: the live service and its clients, and a service inside."""

from collections.abc import Callable, Iterator

import httpx
import pytest

from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.live import LiveServer


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    """An empty service of the module's own, in this process."""
    with inside(tmp_path_factory.mktemp("inside") / "data") as opened:
        yield opened


def _client(role: str | None) -> Callable[[LiveServer], Iterator[httpx.Client]]:
    @pytest.fixture
    def client(live_server: LiveServer) -> Iterator[httpx.Client]:
        with live_server.client(role) as opened:
            yield opened

    return client


viewer, operator, admin, nobody = map(_client, ("viewer", "operator", "admin", None))
