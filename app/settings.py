"""What an installation may set: environment variables `GEARCASE_*`; every default is usable as it is."""

import os
from datetime import timedelta
from functools import lru_cache
from ipaddress import ip_network
from pathlib import Path
from typing import Annotated
from urllib.parse import urlsplit
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import AfterValidator, Field, PositiveFloat, PositiveInt, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict


def known_zone(name: str) -> str:
    try:
        ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError):
        raise ValueError(f"{name!r} is no time zone of the IANA list; an example is Europe/Stockholm") from None
    return name


def known_networks(text: str) -> str:
    for each in filter(None, text.split(",")):
        ip_network(each.strip())
    return text


def whole_url(url: str) -> str:
    """Refuse what only looks like a database URL: of a password that breaks it, part would be taken for the host."""
    try:
        parts = urlsplit(url)
        whole = parts.scheme == "sqlite" or (url.count("@") == parts.netloc.count("@") <= 1 and (parts.port or 1) > 0)
    except ValueError:
        whole = False
    if not whole:
        raise ValueError(
            "this is no database URL. In a password write @ : / ? # and % as %40 %3A %2F %3F %23 and %25, "
            "or leave it out and set PGPASSWORD"
        )
    return url


DatabaseUrl = Annotated[str, AfterValidator(whole_url)]
Networks = Annotated[str, AfterValidator(known_networks)]
ZoneName = Annotated[str, AfterValidator(known_zone)]
MEBIBYTE = 1024 * 1024


class Settings(BaseSettings):
    """One installation. `data_dir` holds everything that a local one owns."""

    model_config = SettingsConfigDict(env_prefix="GEARCASE_", frozen=True, extra="ignore", hide_input_in_errors=True)

    data_dir: Path = Field(Path(".gearcase"), description="database, recordings and artifacts")
    database_url: DatabaseUrl | None = Field(
        None, description="SQLAlchemy URL; SQLite in the data directory where not given"
    )
    time_zone: ZoneName = Field("UTC", description="of the site, IANA name: pages write times in it")
    root_path: str = Field("", description="path under which a proxy serves us, e.g. /gearcase")
    cookie_secure: bool = Field(
        False, description="send cookies over HTTPS only, also where the service itself is asked by HTTP"
    )

    accept_lossy: bool = Field(True, description="take sound that was stored with loss (MP3, AAC, Opus), and flag it")

    upload_bytes: PositiveInt = Field(200 * MEBIBYTE, description="an upload, whole, where a route takes uploads")
    document_bytes: PositiveInt = Field(1 * MEBIBYTE, description="any other request with a key, whole")
    anonymous_bytes: PositiveInt = Field(8 * 1024, description="a request to what needs no key, such as the sign-in")
    metadata_bytes: PositiveInt = Field(64 * 1024, description="one form field of a multipart request")
    form_parts: PositiveInt = Field(16, description="form fields of a multipart request; as many files")
    header_timeout_s: PositiveFloat = Field(10.0, description="until a request's headers must have arrived")
    body_timeout_s: PositiveFloat = Field(20.0, description="until the body of what is no upload must have arrived")
    upload_timeout_s: PositiveFloat = Field(300.0, description="until an upload must have arrived")
    connections: PositiveInt = Field(
        512, description="open at once, and never more than half of the file descriptors that the process may have"
    )
    uploads_per_key: PositiveInt = Field(4, description="uploads of one key read at once; others wait")
    uploads_at_once: PositiveInt = Field(16, description="uploads of all keys read at once; others wait")
    looks_per_key: PositiveInt = Field(1, description="pictures and reports of one key made at once; others wait")
    looks_at_once: PositiveInt = Field(
        max(1, (os.cpu_count() or 1) - 1), description="pictures and reports of all keys made at once; others wait"
    )
    work_at_once: PositiveInt = Field(
        2 * (os.cpu_count() or 1), description="recordings and logs looked at at once; others wait"
    )
    longest_wait_s: PositiveFloat = Field(
        1.2, description="of a request for others: until it may send, until it is looked at, until it may write"
    )
    page_items: PositiveInt = Field(200, description="items of a list's page, at most")
    failed_keys: str = Field("1000/minute", description="wrong keys from one address before 429")
    require_if_match: bool = Field(False, description="changes of a case need the If-Match header (428)")
    idempotency_hours: PositiveInt = Field(24, description="how long an Idempotency-Key is remembered")
    lease_s: float = Field(
        15.0, ge=1.0, description="workers take over what another has in hand when it was silent for so long"
    )
    silent_after_days: PositiveInt = Field(
        30, description="a gearbox whose last recording is older is shown as not heard"
    )
    retain_audio_days: PositiveInt | None = Field(
        None, description="audio of recordings that are no cases is erased when older; kept for ever where not given"
    )

    public_url: str | None = Field(None, description="where people open the pages: the beginning of links in messages")
    smtp_url: SecretStr | None = Field(
        None, description="mail server: smtp+starttls:// (or smtps://, smtp://) user:password@host:port"
    )
    mail_from: str = Field("gearcase@localhost", description="sender of e-mail")
    mqtt_url: SecretStr | None = Field(None, description="MQTT broker: mqtts:// (or mqtt://) user:password@host:port")
    webhook_networks: Networks = Field(
        "", description="networks that are not public and may be reached by webhooks, such as 10.1.0.0/16,127.0.0.1/32"
    )

    @property
    def silent_after(self) -> timedelta:
        """After how long a gearbox counts as not heard."""
        return timedelta(days=self.silent_after_days)

    @property
    def incoming(self) -> Path:
        """Where uploads are while they are looked at: a folder each, held by whoever received it."""
        return self.data_dir / "incoming"


@lru_cache
def settings_of(data_dir: Path | None = None) -> Settings:
    """Settings from the environment, with the data directory of the command line where given."""
    return Settings() if data_dir is None else Settings(data_dir=data_dir)
