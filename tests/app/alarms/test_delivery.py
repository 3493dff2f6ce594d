"""A message reaches a mail server, an MQTT broker and a webhook, each once, though the service is killed in between."""

import base64
import hashlib
import hmac
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import select

from app.alarms.sending import signed
from benchmarks.harness.live import LiveServer, started
from benchmarks.harness.sounds import sound
from casebase.library import CaseLibrary
from casebase.store.models import Delivery
from tests.app.alarms.receivers import Broker, Hook, Mailbox, broker, mail_server, wait_for, webhook

ALARMS = "/api/v1/alarms"


@pytest.fixture
def receivers(tmp_path: Path) -> Iterator[tuple[Mailbox, Broker, Hook]]:
    with mail_server() as mailbox, broker(tmp_path) as mqtt, webhook() as hook:
        yield mailbox, mqtt, hook


@pytest.fixture
def server(tmp_path: Path, receivers: tuple[Mailbox, Broker, Hook]) -> Iterator[LiveServer]:
    mailbox, mqtt, _ = receivers
    server = started(
        tmp_path / "data",
        worker=True,
        GEARCASE_LEASE_S="1",
        GEARCASE_SMTP_URL=f"smtp://127.0.0.1:{mailbox.port}",
        GEARCASE_MAIL_FROM="gearcase@example.com",
        GEARCASE_MQTT_URL=f"mqtt://127.0.0.1:{mqtt.port}",
        GEARCASE_WEBHOOK_NETWORKS="127.0.0.1/32",
        GEARCASE_PUBLIC_URL="https://gearcase.example.com",
        OMP_NUM_THREADS="1",
    )
    yield server
    if server.running:
        server.kill_all()


def test_each_receiver_is_told_once(server: LiveServer, receivers: tuple[Mailbox, Broker, Hook]) -> None:
    mailbox, mqtt, hook = receivers
    addresses = {"email": "team@example.com", "mqtt": "plant/alarms", "webhook": f"http://127.0.0.1:{hook.port}/in"}
    with server.client() as admin:
        made = {
            kind: admin.post(f"{ALARMS}/receivers", json={"name": kind, "kind": kind, "address": address}).json()
            for kind, address in addresses.items()
        }
        rule = {"name": "unlike all that is known", "kind": "state", "verdict": "not_in_library"}
        rule["receivers"] = [each["id"] for each in made.values()]  # type: ignore[assignment]
        admin.post(f"{ALARMS}/rules", json=rule).raise_for_status()
        data = {"metadata": json.dumps({"axis": "bench", "gearbox": "g1"})}
        answer = admin.post("/api/v1/diagnoses", files={"file": ("x.wav", sound(1))}, data=data)
        diagnosis = answer.raise_for_status().json()
    # the mail server says "later", the webhook has the message and has not answered, the broker is away
    assert mailbox.began.wait(60)
    assert hook.began.wait(60)
    server.kill_all()
    for each in (mailbox, hook):
        each.go_on.set()
    mqtt.start()
    worker = subprocess.Popen(
        [sys.executable, "-m", "app", "--data-dir", str(server.data_dir), "worker"],
        env={**os.environ, **server.environment},
    )
    library = CaseLibrary.open(server.data_dir)

    def outbox() -> dict[str, Delivery]:
        with library.reading() as session:
            return {row.receiver_name: row for row in session.scalars(select(Delivery))}

    wait_for(lambda: all(each.state == "sent" for each in outbox().values()), "the delivery to all three")
    worker.kill()
    worker.wait()
    entries = outbox()
    assert sorted(entries) == ["email", "mqtt", "webhook"]
    library.close()
    wait_for(lambda: mqtt.taken, "the way through the broker")
    (email,) = mailbox.taken
    (published,) = mqtt.taken
    ((headers, content),) = hook.taken
    told = json.loads(content)
    assert told["diagnosis_id"] == diagnosis["id"]
    assert told["sentence"] == "Gearbox g1 of axis bench: not in the library"
    assert told["id"] == entries["webhook"].id == headers["webhook-id"]
    assert published.topic == "plant/alarms"
    assert json.loads(published.payload)["id"] == entries["mqtt"].id
    assert email["Message-ID"] == f"<{entries['email'].id}@example.com>"
    assert "Gearbox g1" in email["Subject"]
    assert f"https://gearcase.example.com/diagnoses/{diagnosis['id']}" in email.get_payload()
    assert is_signed(made["webhook"]["secret"], headers, content)
    assert made["webhook"]["secret"] not in server.log()


def is_signed(secret: str, headers: dict[str, str], content: bytes) -> bool:
    """What a receiver does, as Standard Webhooks says."""
    key = base64.b64decode(secret.removeprefix("whsec_"))
    text = b".".join([headers["webhook-id"].encode(), headers["webhook-timestamp"].encode(), content])
    expected = base64.b64encode(hmac.new(key, text, hashlib.sha256).digest()).decode()
    return hmac.compare_digest(f"v1,{expected}", headers["webhook-signature"])


def test_the_signature_is_that_of_the_standard() -> None:
    """The example of Standard Webhooks 1.0."""
    headers = signed(
        "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}'
    )
    assert headers["webhook-signature"] == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="
