"""`gearcase smoke URL`: the main job against a service that runs, step by step."""

import io
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from json import dumps
from time import monotonic, sleep
from typing import Annotated, Any
from uuid import uuid4

import httpx
import typer

from app.commands import DONE, FAILURE, frame
from app.commands.frame import Json

API = "api/v1"
ANSWER_S, AGAIN_S = 60.0, 0.2
AXIS = {"motor": {"inertia_kg_m2": 0.006}, "load": {"inertia_kg_m2": 40.0}}


def smoke(
    url: Annotated[str, typer.Argument(metavar="URL", help="address of the service, such as http://127.0.0.1:8000")],
    key: Annotated[
        str, typer.Option(envvar="GEARCASE_KEY", help="key with the role admin; given by the variable, nobody sees it")
    ] = "",
    wait: Annotated[float, typer.Option(min=0, help="so long the service may take until it is ready [s]")] = 0.0,
    json: Json = False,
) -> None:
    """Check a service that runs: ready, key, axis, case, diagnosis, list of cases; with sounds made for it.

    The case is only proposed, so it counts in no diagnosis. Its recording and the diagnosed one name no axis and no
    gearbox, so they are in no fleet and in no alarm.

    Whatever fails, what was made is cleared away: diagnosis rejected, case retired, audio erased, axis removed. What
    stays: rows of both recordings without their audio, of the case and of the diagnosis, and the audit.
    """
    key = key.strip()
    if not (key and key.isascii() and key.isprintable()):
        raise typer.BadParameter("give a key with the role admin: set GEARCASE_KEY; `gearcase keys create` makes one")
    if not _is_address(url):
        raise typer.BadParameter(f"{url!r} is no address of a service; one is http://127.0.0.1:8000")
    with httpx.Client(base_url=url, headers={"Authorization": f"Bearer {key}"}, timeout=ANSWER_S) as client:
        _wait(client, wait)
        check = Check(client, silent=json)
        with suppress(StepFailedError), ExitStack() as undo:
            _check(check, undo)
    good = all(step.problem is None for step in check.steps)
    if json:
        frame.print_json({"url": url, "ok": good, "steps": [asdict(step) for step in check.steps]})
    raise typer.Exit(DONE if good else FAILURE)


def _is_address(url: str) -> bool:
    try:
        address = httpx.URL(url)
    except httpx.InvalidURL:
        return False
    return address.scheme in ("http", "https") and bool(address.host)


def _wait(client: httpx.Client, seconds: float) -> None:
    until = monotonic() + seconds
    while monotonic() < until:
        with suppress(httpx.HTTPError):
            if client.get("readyz").is_success:
                return
        sleep(AGAIN_S)


class StepFailedError(Exception):
    """A step went wrong; the text says what, and what would be right."""


@dataclass(frozen=True)
class Step:
    """One line of the result."""

    what: str
    ms: float
    problem: str | None


@dataclass
class Check:
    """The steps that were taken at a service; each is told to a person unless all is silent."""

    client: httpx.Client
    silent: bool
    steps: list[Step] = field(default_factory=list)

    @contextmanager
    def step(self, what: str) -> Iterator[None]:
        """Time what is done within, and say how it went. Raises StepFailedError if it did not go well."""
        began, problem = monotonic(), None
        try:
            yield
        except StepFailedError as error:
            problem = str(error)
        except (LookupError, TypeError):
            problem = "the answer is not that of a Gearcase service; give the address that `gearcase serve` prints"
        except httpx.HTTPError as error:
            why = f"does not answer ({error or type(error).__name__})"
            problem = f"{self.client.base_url} {why}; give the address that `gearcase serve` prints"
        step = Step(what, round(1e3 * (monotonic() - began), 1), problem)
        self.steps.append(step)
        if not self.silent:
            frame.show(f"FAILED {what}: {problem}" if problem else f"ok  {what}  {step.ms:.0f} ms")
        if problem:
            raise StepFailedError(problem)

    def ask(self, method: str, path: str, **sent: Any) -> Any:
        """Return the document of an answer. Raises StepFailedError where it is a refusal, or no document."""
        answer = self.client.request(method, path, **sent)
        try:
            document = answer.json()
        except ValueError:
            document = None
        if answer.is_success and (document is not None or not answer.content):
            return document
        detail = document.get("detail") if isinstance(document, dict) else None
        is_it = "is this the address that `gearcase serve` prints?"
        raise StepFailedError(f"{method} {path} was answered by {answer.status_code}: {detail or is_it}")

    def clear(self, what: str, method: str, path: str, **sent: Any) -> None:
        """Clear something away, as a step that keeps no other from being taken."""
        with suppress(StepFailedError), self.step(what):
            self.ask(method, path, **sent)


def _check(check: Check, undo: ExitStack) -> None:
    """Take all steps; what was made is put on `undo` as soon as it is there."""
    name = f"smoke-{uuid4().hex[:12]}"
    with check.step("/livez"):
        _right(check.ask("GET", "livez")["status"], "alive")
    with check.step("/readyz"):
        _right(check.ask("GET", "readyz")["status"], "ready")
    with check.step("key"):
        check.ask("GET", f"{API}/keys", params={"limit": 1})
    with check.step("axis"):
        stored = check.ask("POST", f"{API}/axes", json={"name": name, **AXIS})
        undo.callback(check.clear, "axis removed", "DELETE", f"{API}/axes/{name}")
        _right(check.ask("GET", f"{API}/axes/{name}"), stored)
    with check.step("case"):
        case = _sent(check, "cases", {"label": name, "state": "proposed"})
        undo.callback(check.clear, "case's audio erased", "DELETE", f"{API}/recordings/{case['recording']['id']}")
        undo.callback(check.clear, "case retired", "DELETE", f"{API}/cases/{case['id']}", headers={"If-Match": "*"})
        _right(case["state"], "proposed")
    with check.step("diagnosis"):
        given = _sent(check, "diagnoses", {})
        path = f"{API}/diagnoses/{given['id']}"
        undo.callback(check.clear, "diagnosis' audio erased", "DELETE", f"{API}/recordings/{given['recording']['id']}")
        undo.callback(check.clear, "diagnosis rejected", "PATCH", path, json={"verdict": "rejected"})
        _right(check.ask("GET", path), given)
    with check.step("list of cases"):
        found = check.ask("GET", f"{API}/cases", params={"label": name})["items"]
        _right([each["id"] for each in found], [case["id"]])


def _right(found: object, wanted: object) -> None:
    if found != wanted:
        raise StepFailedError(f"the answer is {dumps(found)}; {dumps(wanted)} would be right")


def _sent(check: Check, noun: str, metadata: dict[str, str]) -> Any:
    """Send a recording of its own."""
    files = {"file": ("smoke.wav", _sound(), "audio/wav")}
    return check.ask("POST", f"{API}/{noun}", files=files, data={"metadata": dumps(metadata)})


def _sound() -> bytes:
    """A WAV file of noise that swells twice a second, another one each time."""
    import numpy as np
    import soundfile

    rate_hz, seconds = 8000, 4
    turns = 2 * np.pi * np.arange(rate_hz * seconds) / rate_hz
    noise = 0.1 * np.random.default_rng().normal(size=turns.size)
    target = io.BytesIO()
    soundfile.write(target, noise * (1 + np.sin(2 * turns)), rate_hz, format="WAV", subtype="PCM_16")
    return target.getvalue()
