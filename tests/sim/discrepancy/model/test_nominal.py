"""Numbers of a description, and those that belong to every measurement."""

from __future__ import annotations

import pytest

from sim.description.axis_document import read_axis
from sim.discrepancy.model.nominal import base_parameters, hums
from sim.discrepancy.model.parameters import Owner, Stated
from sim.mechanisms import ElectricalHum
from sim.mechanisms.catalogue import with_mechanism

AXIS = with_mechanism(
    read_axis(
        {
            "motor": {"inertia_kg_m2": 0.004, "coulomb_friction_n_m": 0.3},
            "stages": [
                {
                    "name": "output",
                    "driver_teeth": 11,
                    "driven_teeth": 330,
                    "mesh_efficiency": 0.9,
                    "stiffness_n_m_per_rad": 30e3,
                    "backlash_rad": 2e-5,
                    "transmission_error_rad": 1e-6,
                }
            ],
            "load": {"inertia_kg_m2": 4.0, "viscous_friction_n_m_s_per_rad": 3.0},
            "load_encoder": {"error_rad": 1e-5},
        }
    ),
    ElectricalHum("motor", {}),
)


@pytest.mark.parametrize("rests", [False, True])
@pytest.mark.parametrize("load_encoder", [False, True])
def test_every_number_is_somebody_s_and_the_description_s_are_those_that_it_says(
    load_encoder: bool, rests: bool
) -> None:
    numbers = base_parameters(AXIS, load_encoder, 1.0, rests)
    owned = {owner: [p for p in numbers if p.owner is owner] for owner in Owner}
    assert not owned[Owner.MECHANISM]
    assert {(p.name, p.unit) for p in owned[Owner.DESCRIPTION]} == {
        ("motor.inertia_kg_m2", "kg m2"),
        ("motor.coulomb_friction_n_m", "N m"),
        ("stages.output.stiffness_n_m_per_rad", "N m/rad"),
        ("stages.output.damping_n_m_s_per_rad", "N m s/rad"),
        ("stages.output.mesh_efficiency", "1"),
        ("load.inertia_kg_m2", "kg m2"),
        ("load.viscous_friction_n_m_s_per_rad", "N m s/rad"),
    }
    assert all(p.owner is Owner.DESCRIPTION for p in numbers if p.stated is not Stated.NO)
    hum, *_ = hums(AXIS)[0]
    assert {f"{hum}.sine", f"{hum}.cosine"} <= {p.name for p in owned[Owner.MOTION]}
