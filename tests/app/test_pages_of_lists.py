"""Every list comes in pages: all of them together hold each item once, in one order."""

import httpx
import pytest

from benchmarks.harness.live import LiveServer

AXIS = {"name": "paged-0", "motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 1.0}}


@pytest.fixture(scope="module")
def filled(live_server: LiveServer) -> None:
    with live_server.client("admin") as admin:
        for number in range(3):
            admin.post("/api/v1/axes", json={**AXIS, "name": f"paged-{number}"}).raise_for_status()
            changed = {**AXIS, "load": {"inertia_kg_m2": 2.0 + number}}
            admin.post("/api/v1/axes", json=changed).raise_for_status()
            admin.post("/api/v1/keys", json={"name": f"paged {number}", "role": "viewer"}).raise_for_status()


@pytest.mark.usefixtures("filled")
@pytest.mark.parametrize("path", ["/axes", "/axes/paged-0/revisions", "/keys"])
def test_pages_hold_every_item_once(admin: httpx.Client, path: str) -> None:
    url = f"/api/v1{path}"
    whole = admin.get(url, params={"limit": 200}).raise_for_status().json()
    assert whole["next_cursor"] is None
    seen, cursor = [], None
    for _ in range(len(whole["items"])):
        more = {"cursor": cursor} if cursor else {}
        page = admin.get(url, params={"limit": 2, **more}).raise_for_status().json()
        seen += page["items"]
        cursor = page["next_cursor"]
        if cursor is None:
            break
    assert len(whole["items"]) >= 3
    assert seen == whole["items"]
    assert admin.get(url, params={"limit": 0}).status_code == 422
    if path != "/axes":  # there any name is a place to go on from
        assert admin.get(url, params={"cursor": "!"}).status_code == 422


@pytest.mark.parametrize("path", ["/cases", "/diagnoses"])
def test_an_axis_that_nobody_knows_is_no_empty_list_without_a_word(
    admin: httpx.Client, filled: None, path: str
) -> None:
    nowhere = admin.get(f"/api/v1{path}", params={"axis": "paged-9"}).raise_for_status().json()
    assert nowhere["items"] == []
    assert nowhere["remark"].startswith("no axis is known as 'paged-9'; described are ")
    empty = admin.get(f"/api/v1{path}", params={"axis": "paged-0"}).raise_for_status().json()
    assert (empty["items"], empty["remark"]) == ([], None)
