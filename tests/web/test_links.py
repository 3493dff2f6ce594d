"""No link leads nowhere, also behind a proxy that serves the service under a path."""

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urljoin, urlsplit

import httpx
import pytest

from benchmarks.harness.live import LiveServer, sign_in, started
from benchmarks.harness.site import KNOWN, Site, fill
from tests.web.reading import Markup

PREFIX = "/gearcase"
ROLES = ("viewer", "admin")


@pytest.fixture(scope="module")
def proxied(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    """A service that believes to be served under a path."""
    server = started(tmp_path_factory.mktemp("proxied") / "data", GEARCASE_ROOT_PATH=PREFIX)
    fill(Site(server, Path()), KNOWN[-2:])
    yield server
    server.stop()


def through_proxy(server: LiveServer, role: str) -> httpx.Client:
    """What a browser behind a proxy sends; the proxy takes the path away."""
    client = server.client(None, follow_redirects=False)
    client.headers["Accept"] = "text/html"
    client.cookies.update(server.session(role))
    return client


@pytest.fixture(scope="module")
def fetched() -> set[str]:
    """What is no page (plots, sounds, pictures, reports) is fetched once, by the least role that is led to it."""
    return set()


@pytest.mark.parametrize("role", ROLES)
def test_no_link_leads_nowhere(proxied: LiveServer, fetched: set[str], role: str) -> None:
    """Every address named by any page that this role can reach is under the path and answers it; anchors are there."""
    seen: dict[str, int] = {}
    anchors: list[tuple[str, str, str]] = []
    ids: dict[str, set[str]] = {}
    waiting = [(f"{PREFIX}/diagnoses", "start")]
    with through_proxy(proxied, role) as client:
        while waiting:
            path, origin = waiting.pop()
            if path in seen or path in fetched:
                continue
            assert path == PREFIX or path.startswith(f"{PREFIX}/"), f"{path} on {origin} leaves the path of the proxy"
            answer = client.get(path.removeprefix(PREFIX))
            seen[path] = answer.status_code
            assert answer.status_code < 400, f"{path} on {origin} answers {answer.status_code}"
            if answer.is_redirect:
                waiting.append((answer.headers["location"], path))
            if not answer.headers.get("content-type", "").startswith("text/html"):
                fetched.add(path)
                continue
            links = Markup(answer.text)
            ids[path] = links.ids
            assert all(action.startswith(f"{PREFIX}/") for action in links.forms), path
            for link in links.links:
                split = urlsplit(urljoin(path, link))
                if split.scheme == "data":
                    continue
                assert not split.netloc, f"{link} on {path} leaves the host"
                target = split.path + (f"?{split.query}" if split.query else "")
                waiting.append((target, path))
                if split.fragment and not split.path.endswith(".svg"):
                    anchors.append((target, split.fragment, path))
    missing = [anchor for anchor in anchors if anchor[1] not in ids[anchor[0]]]
    assert missing == []
    assert len(seen) > 20
    assert len(fetched) > 20


def test_cookie_and_redirects_stay_under_the_path(proxied: LiveServer) -> None:
    """Behind a proxy the cookie is for the service's path alone, and signing in leads back below it."""
    with proxied.client(None, follow_redirects=False) as client:
        client.headers["Accept"] = "text/html"
        away = client.get("/library")
        assert away.headers["location"] == f"{PREFIX}/sign-in?next=%2Flibrary"
        back = sign_in(client, proxied.keys["viewer"], "/library")
        assert back.headers["location"] == f"{PREFIX}/library"
        assert f"path={PREFIX}/" in back.headers["set-cookie"].lower()
