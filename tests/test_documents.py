"""What documents say is there: links and pictures lead somewhere, commands and names exist, examples run."""

import importlib.util
import re
import tomllib
from dataclasses import fields
from pathlib import Path

import pytest
from typer.main import get_command

from app.cli import COMMANDS, build
from signals.columns.channel_map import channel_map_of
from signals.recording_quality.quality import DISTURBANCES
from signals.telemetry import CHANNELS, TIME
from sim.description.axis import Axis, Load, LoadEncoder, Motion, Motor, Servo, Stage, Transmission
from sim.description.axis_document import read_axis
from sim.mechanisms import MECHANISMS
from sim.rotational.train_document import read_train

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])
LINK = re.compile(r"(?<!`)\[[^\]]*\]\(([^)\s]+)\)")
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
MODULE = re.compile(r"python -m ((?:docs|benchmarks|tests|app|sim|casebase)[\w.]*)")
TESTED = re.compile(r"pytest ([^`\n]*)")
TESTS = re.compile(r"\btests/[\w/]+(?:\.py)?")
SOURCE = re.compile(r"`((?:app|casebase|sim|tests|benchmarks|docs|migrations)/[\w/.]+?)/?`")
OPTION = re.compile(r"(?<!\S)--[a-z][a-z-]*")


def name_of(document: Path) -> str:
    return str(document.relative_to(ROOT))


def anchors(text: str) -> set[str]:
    """What a link may name after '#', as GitHub makes it of headings."""
    plain = (re.sub(r"[`*]", "", heading).lower() for heading in HEADING.findall(FENCED.sub("", text)))
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


def blocks(kind: str) -> list[str]:
    """The code of this kind in all documents."""
    found = [FENCED.findall(document.read_text("utf-8")) for document in DOCUMENTS]
    return [text for each in found for language, text in each if language == kind]


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_links_hold(document: Path) -> None:
    for target in LINK.findall(FENCED.sub("", document.read_text("utf-8"))):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        file = (document.parent / path).resolve() if path else document
        assert file.exists(), target
        assert not anchor or anchor in anchors(file.read_text("utf-8")), target


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_what_is_named_exists(document: Path) -> None:
    text = document.read_text("utf-8")
    for module in MODULE.findall(text):
        assert importlib.util.find_spec(module.rstrip(".")) is not None, module
    tested = [path for command in TESTED.findall(text) for path in TESTS.findall(command)]
    for path in [*tested, *SOURCE.findall(text)]:
        assert (ROOT / path).exists(), path


def test_every_document_is_reached_from_the_readme() -> None:
    listed = {(ROOT / target.partition("#")[0]).resolve() for target in LINK.findall((ROOT / "README.md").read_text())}
    assert {document for document in DOCUMENTS if document.parent.name == "docs"} <= listed


def test_commands_and_their_options_exist() -> None:
    verbs = {name for name, _, _ in COMMANDS}
    known: dict[str, set[str]] = {}
    for document in DOCUMENTS:
        for line in document.read_text("utf-8").splitlines():
            words = line.strip().removeprefix("$ ").split()
            if words[:1] != ["gearcase"] or not line.startswith("    ") or len(words) < 2 or words[1].startswith("-"):
                continue
            verb = words[1].rstrip(",")
            assert verb in verbs, (name_of(document), line)
            if verb not in known:
                known[verb] = options_of(get_command(build(verb)).commands[verb])
            assert set(OPTION.findall(line.partition(" | ")[0])) <= known[verb], (name_of(document), line)


def options_of(command: object) -> set[str]:
    """The options of a command and of those below it."""
    own = {option for parameter in getattr(command, "params", ()) for option in parameter.opts}
    return own.union(*(options_of(below) for below in getattr(command, "commands", {}).values()))


@pytest.mark.parametrize("text", blocks("python"))
def test_python_runs_as_it_stands(text: str) -> None:
    exec(compile(text, "example", "exec"), {})


@pytest.mark.parametrize("text", blocks("toml"))
def test_descriptions_and_maps_are_read(text: str) -> None:
    document = tomllib.loads(text)
    if document.get("schema") == "gearcase-channels/1":
        assert channel_map_of(text).sources
    elif document.get("schema") == "gearcase-train/1":
        assert set(document["components"]) == set(read_train(text).components)
    else:
        assert read_axis(document).name == document["name"]


def test_the_reference_of_formats_is_complete() -> None:
    """Every key of an axis, channel, mechanism and parameter is there."""
    text = (ROOT / "docs" / "formats.md").read_text("utf-8")
    tables = (Axis, Motor, Stage, Load, Transmission, LoadEncoder, Motion, Servo)
    keys = {field.name for table in tables for field in fields(table)} - {"motion_keys"}
    numbers = {one.name for kind in MECHANISMS.values() for one in kind.parameters}
    assert {name for name in {*keys, *CHANNELS, TIME, *MECHANISMS, *numbers} if name not in text} == set()


def test_every_disturbance_has_its_remedy() -> None:
    text = (ROOT / "docs" / "troubleshooting.md").read_text("utf-8")
    assert {name for name in DISTURBANCES if f"| `{name}`" not in text} == set()
