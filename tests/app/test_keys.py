"""Keys: shown once, of one role, gone when revoked; the last admin key stays."""

import sqlite3

import httpx

from benchmarks.harness.live import LiveServer

KEYS = "/api/v1/keys"


def test_key_works_until_it_is_revoked(live_server: LiveServer, admin: httpx.Client) -> None:
    made = admin.post(KEYS, json={"name": "short lived", "role": "viewer"}).raise_for_status().json()
    headers = {"Authorization": f"Bearer {made['key']}"}
    with httpx.Client(base_url=live_server.url, headers=headers) as own:
        assert own.get("/api/v1/cases").status_code == 200
        assert admin.delete(f"{KEYS}/{made['id']}").json()["revoked_at"]
        assert own.get("/api/v1/cases").status_code == 401


def test_database_and_list_do_not_hold_the_key(live_server: LiveServer, admin: httpx.Client) -> None:
    key = admin.post(KEYS, json={"name": "secret", "role": "viewer"}).json()["key"]
    assert key.startswith("gearcase_")
    assert key not in admin.get(KEYS).text
    (token,) = live_server.session("viewer").values()
    database = live_server.data_dir / "gearcase.db"
    with sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True) as connection:
        lines = list(connection.iterdump())
        assert any("secret" in line for line in lines)
        assert not any(key in line or token in line for line in lines)
    connection.close()


def test_last_admin_key_cannot_be_revoked(admin: httpx.Client) -> None:
    admins = [key for key in admin.get(KEYS).json()["items"] if key["role"] == "admin" and not key["revoked_at"]]
    for key in admins[1:]:
        admin.delete(f"{KEYS}/{key['id']}").raise_for_status()
    answer = admin.delete(f"{KEYS}/{admins[0]['id']}")
    assert answer.status_code == 409
    assert admin.get(KEYS).status_code == 200


def test_audit_tells_who_made_a_key(admin: httpx.Client) -> None:
    made = admin.post(KEYS, json={"name": "audited", "role": "viewer"}, headers={"X-Request-ID": "audit-1"}).json()
    entry = admin.get("/api/v1/audit", params={"limit": 1}).json()["items"][0]
    assert (entry["action"], entry["subject_id"], entry["request_id"]) == ("key.created", made["id"], "audit-1")
    assert entry["actor"].startswith("first admin#")


def test_cookie_reads_but_changes_only_with_the_token(live_server: LiveServer) -> None:
    from app.http.security import COOKIE, CSRF_HEADER, csrf_token

    cookies = live_server.session("admin")
    with httpx.Client(base_url=live_server.url, cookies=cookies) as browser:
        assert browser.get(KEYS).status_code == 200
        asked = {"name": "from a page", "role": "viewer"}
        assert browser.post(KEYS, json=asked).status_code == 403
        wrong = {CSRF_HEADER: csrf_token("gearcase_another")}
        assert browser.post(KEYS, json=asked, headers=wrong).status_code == 403
        assert browser.post(KEYS, json=asked, headers={CSRF_HEADER: csrf_token(cookies[COOKIE])}).status_code == 201
