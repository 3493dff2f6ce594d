"""The size of a fault comes from cases of the recording's own axis and origin, or is not said; one function says it."""

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from app.documents import CaseChange
from app.recordings.intake import CaseMetadata, take_in
from benchmarks.harness.inside import Inside, inside
from benchmarks.harness.live import gearcase
from benchmarks.harness.sounds import hum, sound, wav
from casebase.reasoning.severity import FEWEST
from casebase.store.bundle_entry import BundledCase
from signals.features import extract
from signals.reading.decode import read_recording
from sim.description.axis_document import read_axis, write_axis

OWN, OTHER = "own axis", "another"


def axis(name: str) -> dict[str, object]:
    stage = {"name": "output", "driver_teeth": 12, "driven_teeth": 600, "stiffness_n_m_per_rad": 1.5e5}
    return {"name": name, "motor": {"inertia_kg_m2": 0.006}, "stages": [stage], "load": {"inertia_kg_m2": 40.0}}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Inside]:
    """A library with measured cases, normal ones and notches of known depth, all of one axis."""
    folder = tmp_path_factory.mktemp("sizes")
    with inside(folder / "data") as found:
        for name in (OWN, OTHER):
            found.ask("POST", "/api/v1/axes", json=axis(name)).raise_for_status()
            (folder / f"{name}.toml").write_text(write_axis(read_axis(axis(name))))
        for number in range(FEWEST + 4):
            notched = number < FEWEST
            quiet, loud = hum(6.0, number), hum(6.0, number, impacts=True)
            depth = 2e-4 * 1.2**number
            samples = quiet + np.float32(depth / 1e-3 if notched else 0.0) * (loud - quiet)
            keep(found, folder / "case.wav", wav(samples), depth if notched else None, f"g{number % 4}")
        (folder / "notch.wav").write_bytes(sound(40, impacts=True))
        yield found


def keep(service: Inside, path: Path, content: bytes, depth: float | None, gearbox: str) -> None:
    path.write_bytes(content)
    library = service.service.library
    label = "normal" if depth is None else "notch"
    metadata = CaseMetadata(axis=OWN, gearbox=gearbox, label=label, size_rad=depth)
    intake = take_in(library, path, "case.wav", "audio/wav", metadata)
    with library.transaction("technician") as session:
        library.retain.case(session, intake.store(library, session), metadata.labelling())


def severity(service: Inside, told: dict[str, str]) -> object:
    content = (service.service.settings.data_dir.parent / "notch.wav").read_bytes()
    parts = {"file": ("notch.wav", content), "metadata": (None, json.dumps(told))}
    document = service.ask("POST", "/api/v1/diagnoses", files=parts).raise_for_status().json()
    assert document["label"] == "notch"
    return document["severity"]


@pytest.mark.parametrize("told", [{}, {"axis": OTHER}, {"axis": "never described"}])
def test_cases_of_another_axis_say_no_size(service: Inside, told: dict[str, str]) -> None:
    assert severity(service, told) is None


def test_the_command_and_the_diagnosis_say_the_same_size(service: Inside) -> None:
    by_http = severity(service, {"axis": OWN})
    assert isinstance(by_http, dict)
    assert by_http["cases"] == FEWEST
    data = service.service.settings.data_dir
    file, described = data.parent / "notch.wav", data.parent / f"{OWN}.toml"
    diagnosed = gearcase("diagnose", file, "--axis", described, "--json", data_dir=data)
    sized = gearcase("size", file, "--axis", described, "--label", "notch", "--json", data_dir=data)
    assert json.loads(diagnosed.stdout)[0]["severity"] == by_http
    assert by_http.items() <= json.loads(sized.stdout).items()
    words = gearcase("size", file, "--axis", described, "--label", "notch", data_dir=data)
    assert "measured cases of the library" in words.stderr


def test_measured_cases_say_nothing_of_a_simulated_recording(service: Inside) -> None:
    library = service.service.library
    extraction = extract(read_recording(service.service.settings.data_dir.parent / "notch.wav"))
    with library.reading() as session:
        assert library.reuse.severity(session, extraction, OWN, "notch", "simulated") is None
        found = library.reuse.severity(session, extraction, OWN, "notch", "measured")
    assert found is not None
    assert found.low < found.value < found.high


def test_a_label_without_a_size_is_refused(service: Inside) -> None:
    data = service.service.settings.data_dir
    described = data.parent / f"{OWN}.toml"
    done = gearcase("size", data.parent / "notch.wav", "--axis", described, "--label", "normal", data_dir=data)
    assert (done.code, "play, notch have one" in done.stderr) == (2, True)


@pytest.mark.parametrize("size", [0.0, -1e-3, 1e10, math.nan])
def test_a_size_is_held_to_one_rule_whichever_way_it_comes(size: float) -> None:
    in_a_bundle = {"audio": "a", "sha256": "0" * 64, "recording": {}, "label": "notch"}
    for model, told in (
        (CaseMetadata, {"label": "notch", "size_rad": size}),
        (CaseChange, {"severity": size}),
        (BundledCase, {**in_a_bundle, "severity": size}),
    ):
        with pytest.raises(ValidationError, match=r"size_rad|severity"):
            model.model_validate(told)
    assert BundledCase.model_validate({**in_a_bundle, "severity": 1e-3}).labelling("b").severity == 1e-3
