"""What cannot be reached is refused when a receiver is made, by the interface and by the page alike."""

from collections.abc import Iterator

import pytest

from benchmarks.harness.inside import Inside, inside

RECEIVERS = "/api/v1/alarms/receivers"
CANNOT_BE = """
1.2.3.256 1.2.3.04 1.2.3 127.1 0x7f.1 0x7f000001 2130706433 017700000001 1.2.3.4. example.1 [::1%25lo] [v1.a] [::g]
xn--a.example b.xn--a.example a..b .a -a.example a-.example a%2eb * a,b a:0 a:65536 a:99999 a:x user@a user:pw@a
"""
PRIVATE = """
localhost LOCALHOST 127.0.0.1 10.0.0.1 172.16.0.1 192.168.1.1 169.254.169.254 0.0.0.0 100.64.0.1 224.0.0.1
255.255.255.255 [::] [::1] [fe80::1] [fd00:ec2::254] [fec0::1] [::ffff:10.0.0.1] [::8.8.8.8] [64:ff9b:1::1]
[fc00::1] [64:ff9b::a00:1] [2002:a00:1::1] [2001:0:1:1:1:1:f5ff:fffe] [5f00::1]
"""
OTHERS = [
    ("webhook", "ftp://example.com"),
    ("webhook", f"https://{'a' * 64}.example"),
    ("webhook", f"https://{'a.' * 127}example"),
    ("mqtt", "alarms/#"),
    *(
        ("email", each)
        for each in (
            "team", "a@b.com, c@d.com", "a@b.com\nBcc: c@d.com", "a\x07@b.com", "a@b..com", "a@-b.com", "a@1.2.3.4",
            "a@0x7f", "a@xn--a.example", f"a@{'b' * 64}.com",
        )
    ),
]  # fmt: skip
REFUSED = [*(("webhook", f"http://{host}/") for host in (CANNOT_BE + PRIVATE).split()), *OTHERS]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    with inside(tmp_path_factory.mktemp("addresses") / "data", mqtt_url="mqtt://127.0.0.1:9") as opened:
        yield opened


@pytest.mark.parametrize(("kind", "address"), REFUSED)
def test_an_address_that_cannot_be_is_refused(service: Inside, kind: str, address: str) -> None:
    given = {"name": "team", "kind": kind, "address": address}
    assert service.ask("POST", RECEIVERS, json=given).status_code == 422
    assert service.browse("POST", "/alarms/receivers", data=given).status_code == 422
    assert service.ask("GET", RECEIVERS).json() == []


def test_a_host_may_get_its_address_later(tmp_path_factory: pytest.TempPathFactory) -> None:
    with inside(tmp_path_factory.mktemp("later") / "data", webhook_networks="127.0.0.0/8") as service:
        for host in (
            "nobody.invalid",
            "xn--strae-oqa.invalid:8443",
            "127.0.0.1:65535",
            "1.1.1.1",
            "[64:ff9b::101:101]",
        ):
            given = {"name": host, "kind": "webhook", "address": f"https://{host}/in"}
            assert service.ask("POST", RECEIVERS, json=given).status_code == 201, host


@pytest.mark.parametrize(("kind", "missing"), [("email", "GEARCASE_SMTP_URL"), ("mqtt", "GEARCASE_MQTT_URL")])
@pytest.mark.parametrize("url", [None, "http://a", "smtp://", "mqtt://[::1", "smtp://a:x", "smtp://u:%ff@a"])
def test_a_server_that_is_not_set_gets_no_receiver(
    tmp_path_factory: pytest.TempPathFactory, kind: str, missing: str, url: str | None
) -> None:
    with inside(tmp_path_factory.mktemp("unset") / "data", smtp_url=url, mqtt_url=url) as service:
        given = {"name": "team", "kind": kind, "address": "team@example.com"}
        answer = service.ask("POST", RECEIVERS, json=given)
        assert (answer.status_code, missing in answer.json()["detail"]) == (422, True)
