"""An axis is made and changed by a form and by the command line, in the units of its data sheet."""

import json
import math
from pathlib import Path

import pytest

from app.axes import TEMPLATES, UNITS, in_si
from app.axis_form import described, filled
from benchmarks.harness.inside import Inside
from benchmarks.harness.live import gearcase
from sim.description.axis_document import read_axis
from sim.errors import ParameterError


@pytest.mark.parametrize("kind", TEMPLATES)
def test_a_template_is_an_axis_and_the_form_gives_it_back(kind: str) -> None:
    document = read_axis(TEMPLATES[kind].document("axis")).to_mapping()
    again = read_axis(described({**filled(document), "name": "axis"}, {}))
    assert again.to_mapping() == document


def test_what_the_form_has_no_field_for_is_kept() -> None:
    entry = {"name": "backlash", "location": "output", "gap_rad": 0.001}
    document = {**TEMPLATES["spur"].document("axis"), "servo": {"position_gain_per_s": 12.0}, "mechanisms": [entry]}
    document["stages"][1]["transmission_error_rad"] = 1e-6
    before = read_axis(document).to_mapping()
    changed = described({**filled(before), "load.inertia_kg_m2": "900", "load.inertia_kg_m2.unit": "kg cm2"}, before)
    after = read_axis(changed).to_mapping()
    assert after.pop("load") == {"inertia_kg_m2": 0.09}
    before.pop("load")
    assert after == before


def test_units_are_those_of_physics() -> None:
    assert in_si("backlash_rad", "60 arcmin") == pytest.approx(in_si("backlash_rad", "1 deg"))
    assert in_si("stiffness_n_m_per_rad", "1 N m/arcmin") == pytest.approx(10800 / math.pi)
    assert in_si("load_speed_rad_s", "60", "rpm") == pytest.approx(2 * math.pi)
    assert in_si("viscous_friction_n_m_s_per_rad", "1 N m/1000 rpm") * 1000 * 2 * math.pi / 60 == pytest.approx(1.0)
    assert all(next(iter(units.values())) == 1.0 for units in UNITS.values())
    for text in ("much", "5 furlongs", "", "1 2"):
        with pytest.raises(ParameterError, match="backlash_rad"):
            in_si("backlash_rad", text)


def test_an_axis_is_made_changed_and_refused_by_the_form(service: Inside) -> None:
    fields = {**filled(TEMPLATES["spur"].document("")), "name": "joint 1", "motor.inertia_kg_m2": "3,5"}
    fields["motor.inertia_kg_m2.unit"] = "kg cm2"
    refused = service.browse("POST", "/describe", data={**fields, "load.inertia_kg_m2": "heavy"})
    assert refused.status_code == 422
    assert "Inertia of the load: must be a number" in refused.text
    assert 'value="joint 1"' in refused.text
    made = service.browse("POST", "/describe", data=fields)
    assert made.headers["location"] == "/axes/joint%201/first-hour"
    stored = service.ask("GET", "/api/v1/axes/joint 1").json()
    assert stored["document"]["motor"]["inertia_kg_m2"] == 3.5e-4
    again = service.browse("POST", "/describe", data=fields)
    assert "is called" in again.text
    bare = service.browse("POST", "/describe", data={"name": "bare", "back": "1"})
    assert "Inertia of the load: is needed" in bare.text
    change = {**filled(stored["document"]), "axis": "joint 1", "revision": "1", "stages.1.backlash_rad": "2"}
    change["stages.backlash_rad.unit"] = "arcmin"
    assert service.browse("POST", "/describe", data=change).status_code == 303
    newest = service.ask("GET", "/api/v1/axes/joint 1").json()
    assert newest["revision"] == 2
    assert newest["document"]["stages"][1]["backlash_rad"] == pytest.approx(math.radians(2 / 60))
    assert service.browse("POST", "/describe", data=change).status_code == 409
    page = service.browse("GET", "/describe?axis=joint 1").text
    assert 'value="joint 1"' in page
    assert 'value="85"' in page
    assert service.browse("GET", "/describe?template=gold").status_code == 422


def test_a_copy_has_all_of_an_axis_but_its_name_and_what_was_found_in_it(service: Inside) -> None:
    found = {"name": "backlash", "location": "output", "gap_rad": 0.002}
    damping = {"stages": [{**TEMPLATES["spur"].stages[1], "damping_n_m_s_per_rad": 7.0}], "mechanisms": [found]}
    service.ask("POST", "/api/v1/axes", json=TEMPLATES["spur"].document("worn") | damping).raise_for_status()
    page = service.browse("GET", "/describe?copy=worn").text
    assert 'name="copy" value="worn"' in page
    assert 'value="90"' in page
    fields = {**filled(service.ask("GET", "/api/v1/axes/worn").json()["document"]), "name": "twin", "copy": "worn"}
    assert service.browse("POST", "/describe", data=fields).status_code == 303
    worn, twin = (service.ask("GET", f"/api/v1/axes/{name}").json()["document"] for name in ("worn", "twin"))
    assert twin["stages"][0]["damping_n_m_s_per_rad"] == 7.0
    assert worn["mechanisms"]
    assert not twin.get("mechanisms")


def test_an_axis_is_made_and_changed_by_the_command_line(tmp_path: Path) -> None:
    data, file = tmp_path / "data", tmp_path / "axis.toml"
    file.write_text(gearcase("axes", "template", "strain_wave", "--name", "wrist", data_dir=data).stdout, "utf-8")
    gearcase("axes", "add", str(file), data_dir=data)
    settings = ("--set", "load.inertia_kg_m2=900 kg cm2", "--set", "stages.flexspline.ratio=80")
    assert json.loads(gearcase("axes", "change", "wrist", *settings, "--json", data_dir=data).stdout)["revision"] == 2
    (row,) = json.loads(gearcase("axes", "list", "--json", data_dir=data).stdout)
    assert (row["document"]["load"]["inertia_kg_m2"], row["document"]["stages"][0]["ratio"]) == (0.09, 80.0)
    wrong = gearcase("axes", "change", "wrist", "--set", "stages.output.ratio=80", data_dir=data)
    assert wrong.code == 2
    assert "no stage is called 'output'" in wrong.stderr
