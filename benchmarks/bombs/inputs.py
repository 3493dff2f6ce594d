"""Inputs that are wrong: good ones of every kind, spoilt at random, and some made to cost much."""

import io
import json
import random
import struct
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from benchmarks.bombs.bodies import AXIS, BODIES, METADATA, ODD, places, table, with_value
from benchmarks.harness.sounds import sound

API = "/api/v1"
SIZES = (0, 1, 2, 7, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFF0, 0xFFFFFFFE, 0xFFFFFFFF)
NOBODY = "0" * 32


def spoilt(content: bytes, others: Sequence[bytes], dice: random.Random) -> bytes:
    """Return the content of a file with one to three things wrong."""
    spoilt = bytearray(content)
    for _ in range(dice.randint(1, 3)):
        kind = dice.randrange(6)
        at = dice.randrange(len(spoilt)) if dice.random() < 0.5 else dice.randrange(min(len(spoilt), 128))
        if kind == 0:
            for _ in range(dice.randint(1, 20)):
                spoilt[dice.randrange(len(spoilt))] = dice.randrange(256)
        elif kind == 1:
            spoilt[at : at + 8] = dice.randbytes(dice.randint(1, 8))
        elif kind == 2:
            del spoilt[max(1, at) :]
        elif kind == 3:
            order = dice.choice("<>")
            spoilt[at : at + 4] = struct.pack(order + "I", dice.choice(SIZES))
        elif kind == 4:
            other = dice.choice(others)
            spoilt[at:] = other[dice.randrange(len(other)) :]
        else:
            spoilt[at : at + dice.randint(0, 64)] = dice.randbytes(dice.randint(0, 64))
        if not spoilt:
            return b"\0"
    return bytes(spoilt)


@dataclass(frozen=True)
class Sent:
    """A request: method, path, and what httpx takes besides; `form` ones go to a page, with cookie and token."""

    method: str
    path: str
    given: Mapping[str, Any] = field(default_factory=dict)
    form: bool = False


def seeds_of_telemetry() -> list[bytes]:
    """Good tables: CSV and Parquet."""
    time_s = np.arange(300) / 100
    columns = pa.table({"time_s": time_s, "motor_torque_nm": np.sin(time_s), "note": ["a"] * 300})
    target = io.BytesIO()
    parquet.write_table(columns, target)
    return [table("motor temperature [°C]").encode(), table("load_speed_rad_s").encode("latin-1"), target.getvalue()]


def parquet_bomb(rows: int = 20_000_000) -> bytes:
    """A table of one value, which opens to a thousand times its size."""
    schema = pa.schema([("time_s", pa.float64()), ("motor_torque_nm", pa.float64())])
    target, block = io.BytesIO(), np.zeros(1_000_000)
    with parquet.ParquetWriter(target, schema, compression="zstd") as writer:
        for _ in range(rows // block.size):
            writer.write_table(pa.table({"time_s": block, "motor_torque_nm": block}, schema=schema))
    return target.getvalue()


def wide_table(columns: int = 50_000) -> bytes:
    """A table whose header says more than its rows."""
    return ("time_s,motor_torque_nm," + ",".join(f"c{number}" for number in range(columns)) + "\n0,1\n").encode()


def long_cell() -> bytes:
    """A table with one cell of 200 MB, packed into some kilobytes."""
    target = io.BytesIO()
    cells = pa.table({"time_s": ["1" * 200_000_000], "motor_torque_nm": [1.0]})
    parquet.write_table(cells, target, compression="zstd", use_dictionary=False, write_statistics=False)
    return target.getvalue()


DOTS = 30_000
AXIS_BOMBS = (
    "a" + ".a" * DOTS + " = 1",
    "a = " + "[" * 100_000,
    '{"a":' * 50_000,
    "\n".join(f"k{number} = 1" for number in range(30_000)),
    "a = 0x" + "f" * 500_000,
    "a = " + "9" * 500_000,
    'a = "' + "\\u0041" * 100_000 + '"',
    '{"stages": [' + ",".join(["{}"] * 100_000) + "]}",
)


def bundle(manifest: object, audio: bytes, *, packed: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A bundle with this manifest and one sound."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", packed) as archive:
        archive.writestr("audio/a", audio)
        archive.writestr("manifest.json", json.dumps(manifest))
    return target.getvalue()


CASE: dict[str, Any] = {
    "audio": "audio/a",
    "sha256": "0" * 64,
    "channel": 0,
    "recording": {"file_name": "a.wav", "media_type": "audio/wav", "axis": "a", "gearbox": "g", "extra": {"a": 1}}
    | {"condition": {"speed_rad_s": 2.0, "mesh_orders": [1.0], "steady": False}, "recorded_at": None},
    "label": "notch",
    "origin": "measured",
    "state": "confirmed",
    "severity": 1e-3,
    "parameters": {"depth_rad": 1e-3},
    "note": "n",
}
MANIFEST = {"schema": "gearcase-bundle/1", "cases": [CASE]}


def text_of(document: object) -> str:
    return json.dumps(document).replace("Infinity", "1e400")


class Inputs:
    """Wrong inputs without end, the same for the same seed."""

    def __init__(self, seed: int) -> None:
        self.dice = random.Random(seed)
        self.telemetry = seeds_of_telemetry()
        self.sounds = [sound(number, seconds=0.5) for number in range(2)]
        self.bundles = [bundle(MANIFEST, self.sounds[0]), bundle(MANIFEST, b"", packed=zipfile.ZIP_STORED)]
        self.kinds: dict[str, Callable[[], Sent]] = {
            "JSON body": self.json_body,
            "metadata": self.metadata,
            "axis": self.axis,
            "telemetry": self.table,
            "sound": self.sound,
            "bundle": self.bundle,
        }

    def mutated(self, document: Any) -> Any:
        """A document with one to three values that do not belong there."""
        for _ in range(self.dice.randint(1, 3)):
            value = self.dice.choice(
                [*ODD, self.nest(), float(f"{self.dice.uniform(0.1, 1.0)}e{self.dice.randint(-330, 330)}")]
            )
            document = with_value(document, self.dice.choice(list(places(document))), value)
            if not isinstance(document, dict):
                break
        return document

    def nest(self) -> Any:
        """Lists within lists, so many that whoever follows them by calling himself does not come back."""
        value: Any = []
        for _ in range(self.dice.choice((3, 30, 300))):
            value = [value]
        return value

    def spoilt_text(self, text: str) -> bytes:
        return spoilt(text.encode("utf-8", "surrogatepass"), [text.encode("utf-8", "surrogatepass")], self.dice)

    def json_body(self) -> Sent:
        (method, path), body = self.dice.choice([each for each in BODIES.items() if "{" not in each[0][1]])
        text = text_of(self.mutated(body)).replace("{diagnosis}", NOBODY).encode()
        content = text if self.dice.random() < 0.6 else self.spoilt_text(text_of(body))
        if self.dice.random() < 0.02:
            content = json.dumps({f"k{number}": number for number in range(50_000)}).encode()
        return Sent(method, API + path, {"content": content, "headers": {"Content-Type": "application/json"}})

    def metadata(self) -> Sent:
        text = (
            text_of(self.mutated(METADATA)).encode()
            if self.dice.random() < 0.6
            else self.spoilt_text(text_of(METADATA))
        )
        files = {"file": ("a.wav", b"RIFF", "audio/wav"), "metadata": ("m.json", text, "application/json")}
        return Sent("POST", f"{API}/diagnoses", {"files": files})

    def axis(self) -> Sent:
        kind = self.dice.choice(("json", "toml"))
        text = text_of(self.mutated(AXIS)).encode() if kind == "json" else self.spoilt_text(TOML)
        if self.dice.random() < 0.02:
            text = self.dice.choice(AXIS_BOMBS).encode()
        return Sent("POST", f"{API}/axes", {"content": text, "headers": {"Content-Type": f"application/{kind}"}})

    def table(self) -> Sent:
        content = spoilt(self.dice.choice(self.telemetry), self.telemetry, self.dice)
        return self.investigated(content)

    def investigated(self, content: bytes) -> Sent:
        """A question about an axis that is right, with this telemetry."""
        axis = {"axis": text_of(AXIS)}
        return Sent("POST", f"{API}/investigations", {"files": {"telemetry": ("t.csv", content)}, "data": axis})

    def sound(self) -> Sent:
        content = spoilt(self.dice.choice(self.sounds), self.sounds, self.dice)
        return Sent("POST", f"{API}/diagnoses", {"files": {"file": ("a.wav", content[:20_000], "audio/wav")}})

    def bundle(self) -> Sent:
        content = spoilt(self.dice.choice(self.bundles), self.bundles, self.dice)
        if self.dice.random() < 0.5:
            content = bundle(self.mutated(MANIFEST), self.sounds[0])
        return Sent("POST", "/library/import", {"files": {"file": ("in.zip", content)}}, form=True)

    def bombs(self) -> list[Sent]:
        """What is made to cost much, once each."""
        toml = {"Content-Type": "application/toml"}
        return [
            *(self.investigated(content) for content in (parquet_bomb(), wide_table(), long_cell())),
            *(Sent("POST", f"{API}/axes", {"content": text.encode(), "headers": toml}) for text in AXIS_BOMBS),
            Sent("POST", "/library/import", {"files": {"file": ("in.zip", zip_bomb())}}, form=True),
        ]


def zip_bomb() -> bytes:
    """A bundle whose manifest is blank for 60 MB."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("manifest.json", " " * 60_000_000 + "{}")
        archive.writestr("audio/a", bytes(random.Random(1).randbytes(700_000)))
    return target.getvalue()


TOML = """schema = "gearcase-axis/1"
name = "axis 4"
motor.inertia_kg_m2 = 0.006
motor.coulomb_friction_n_m = 0.4
load = {inertia_kg_m2 = 40.0}
[[stages]]
name = "output"
driver_teeth = 12
driven_teeth = 600
[motion]
period_s = 4.2
load_speed_rad_s = 2.7
"""
