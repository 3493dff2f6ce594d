"""Fixtures of these tests: the live service and its clients."""

from collections.abc import Iterator

import httpx
import pytest

from benchmarks.harness.live import LiveServer


@pytest.fixture
def viewer(live_server: LiveServer) -> Iterator[httpx.Client]:
    with live_server.client("viewer") as client:
        yield client


@pytest.fixture
def operator(live_server: LiveServer) -> Iterator[httpx.Client]:
    with live_server.client("operator") as client:
        yield client


@pytest.fixture
def admin(live_server: LiveServer) -> Iterator[httpx.Client]:
    with live_server.client("admin") as client:
        yield client


@pytest.fixture
def nobody(live_server: LiveServer) -> Iterator[httpx.Client]:
    with live_server.client(None) as client:
        yield client
