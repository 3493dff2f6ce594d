"""Sessions: none is had without signing in, none outlives its end, and none is a key."""

from collections.abc import Iterator
from datetime import timedelta

import httpx
import pytest
from sqlalchemy import func, select

from app.http.security import COOKIE, csrf_token
from app.http.sessions import open_session
from benchmarks.harness.inside import Inside
from benchmarks.harness.live import LiveServer, sign_in
from casebase.store.models import BrowserSession, now
from sim.experiment.paper_axis import PAPER_AXIS

CASES, KEYS = "/api/v1/cases", "/api/v1/keys"


@pytest.fixture
def browser(live_server: LiveServer) -> Iterator[httpx.Client]:
    """A browser in which somebody signed in with a key of an operator that nobody else uses."""
    with live_server.client("admin") as admin, live_server.client(None) as client:
        made = admin.post(KEYS, json={"name": "of one browser", "role": "operator"}).raise_for_status().json()
        sign_in(client, made["key"])
        client.headers["X-Key"], client.headers["X-Key-Id"] = made["key"], made["id"]
        yield client


def code(server: LiveServer, cookie: str) -> tuple[int, int]:
    """What a cookie gets: from the API, and for a page, where 303 leads to the sign-in."""
    with server.client(None, cookies={COOKIE: cookie}) as client:
        return client.get(CASES).status_code, client.get("/library", headers={"Accept": "text/html"}).status_code


def sign_out(client: httpx.Client) -> None:
    client.post("/sign-out", data={"csrf": csrf_token(client.cookies[COOKIE])})


def test_a_key_is_no_cookie_and_a_cookie_no_key(live_server: LiveServer, browser: httpx.Client) -> None:
    assert code(live_server, browser.headers["X-Key"]) == (401, 303)
    bearer = {"Authorization": f"Bearer {browser.cookies[COOKIE]}"}
    assert httpx.get(f"{live_server.url}{CASES}", headers=bearer).status_code == 401


def test_signing_out_ends_one_session(live_server: LiveServer, browser: httpx.Client) -> None:
    one = browser.cookies[COOKIE]
    with live_server.client(None) as other:
        sign_in(other, browser.headers["X-Key"])
        sign_out(browser)
        assert code(live_server, one) == (401, 303)
        assert code(live_server, other.cookies[COOKIE]) == (200, 200)


def test_revoking_a_key_ends_its_sessions(live_server: LiveServer, admin: httpx.Client, browser: httpx.Client) -> None:
    admin.delete(f"{KEYS}/{browser.headers['X-Key-Id']}").raise_for_status()
    assert code(live_server, browser.cookies[COOKIE]) == (401, 303)


def test_signing_in_never_takes_over_a_cookie(live_server: LiveServer, browser: httpx.Client) -> None:
    before = browser.cookies[COOKIE]
    for planted in (before, "gearcase_planted"):
        with live_server.client(None, cookies={COOKIE: planted}) as client:
            sign_in(client, browser.headers["X-Key"])
            assert planted not in [each.value for each in client.cookies.jar if each.domain]
        assert code(live_server, planted) == (401, 303)


def test_live_stream_ends_with_its_session(live_server: LiveServer, admin: httpx.Client, browser: httpx.Client) -> None:
    wanted = {"axis": PAPER_AXIS.to_mapping(), "per_label": 1}
    job = admin.post("/api/v1/simulations", json=wanted).raise_for_status().headers["location"]
    with browser.stream("GET", f"{job}/events") as stream:
        lines = stream.iter_lines()
        assert next(lines).startswith(":")
        sign_out(browser)
        assert "event: end" not in list(lines)
    admin.delete(job).raise_for_status()


def test_a_session_that_is_too_old_counts_and_stays_no_more(service: Inside) -> None:
    library = service.service.library
    with library.transaction("test") as session:
        (row,) = session.scalars(select(BrowserSession))
        key_id, row.expires_at = row.key_id, now() - timedelta(seconds=1)
    assert service.browse("GET", "/library").headers["location"].startswith("/sign-in")
    with library.transaction("test") as session:
        open_session(session, key_id)
        assert session.scalar(select(func.count()).select_from(BrowserSession)) == 1


@pytest.mark.parametrize("scheme", ["http", "https"])
def test_cookies_are_secure_where_https_is(service: Inside, scheme: str) -> None:
    asked = {"key": service.key, "csrf": service.token}
    for answer in (
        service.anonymous("GET", f"{scheme}://test/sign-in"),
        service.browse("POST", f"{scheme}://test/sign-in", data=asked),
    ):
        cookie = answer.headers["set-cookie"].lower()
        assert ("secure" in cookie) == (scheme == "https")
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
