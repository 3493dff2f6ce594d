"""Messages to topics of an MQTT broker, at quality of service 2: exactly once within a connection."""

import ssl
from urllib.parse import unquote, urlsplit

from paho.mqtt.client import Client, ConnectFlags
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from app.alarms.failure import DeliveryError
from app.alarms.message import Message
from app.settings import Settings

TIMEOUT_S = 15.0
EXACTLY_ONCE = 2
PORTS = {"mqtt": 1883, "mqtts": 8883}


def publish(settings: Settings, topic: str, message: Message) -> None:
    """Publish a message and wait until the broker has it.

    Raises:
        DeliveryError: if the broker cannot be reached or does not take it in time.
    """
    if settings.mqtt_url is None:
        raise DeliveryError("no MQTT broker is set: GEARCASE_MQTT_URL")
    parts = urlsplit(settings.mqtt_url.get_secret_value())
    if parts.scheme not in PORTS or not parts.hostname:
        raise DeliveryError("GEARCASE_MQTT_URL begins with mqtts:// or mqtt:// and names a host")
    client = Client(CallbackAPIVersion.VERSION2, client_id=f"gearcase-{message.id}")
    client.connect_timeout = TIMEOUT_S
    if parts.username:
        client.username_pw_set(unquote(parts.username), unquote(parts.password or ""))
    if parts.scheme == "mqtts":
        client.tls_set_context(ssl.create_default_context())
    answers: list[str] = []

    def connected(
        _client: Client, _userdata: object, _flags: ConnectFlags, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        if reason.is_failure:
            answers.append(str(reason))

    client.on_connect = connected
    where = f"the MQTT broker {parts.hostname}:{parts.port or PORTS[parts.scheme]}"
    try:
        client.connect(parts.hostname, parts.port or PORTS[parts.scheme])
        client.loop_start()
        published = client.publish(topic, message.json, qos=EXACTLY_ONCE)
        published.wait_for_publish(TIMEOUT_S)
        if not published.is_published():
            raise DeliveryError(f"{where} did not take it: {answers[0] if answers else 'no answer in time'}")
    except (OSError, ValueError, RuntimeError) as error:
        raise DeliveryError(f"{where} did not take it: {error}") from None
    finally:
        client.disconnect()
        client.loop_stop()
