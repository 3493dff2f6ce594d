"""An axis of three shafts for the tests, and the paper's chain."""

from typing import Any

from sim.assembly import drive_train_of
from sim.chain.model import Chain, Link, Shaft
from sim.chain.reduction import chain_of
from sim.description.axis import Axis
from sim.description.axis_document import read_axis


def axis(**motion: float) -> Axis:
    """Two stages of 9 and 11; nothing is zero that can be something."""
    return read_axis(
        {
            "name": "tested",
            "motor": {
                "inertia_kg_m2": 0.004,
                "coulomb_friction_n_m": 0.3,
                "viscous_friction_n_m_s_per_rad": 0.002,
            },
            "stages": [
                {
                    "name": "transfer",
                    "driver_teeth": 10,
                    "driven_teeth": 90,
                    "inertia_kg_m2": 0.015,
                    "stiffness_n_m_per_rad": 1800.0,
                    "damping_n_m_s_per_rad": 0.3,
                    "backlash_rad": 4e-5,
                },
                {
                    "name": "output",
                    "driver_teeth": 11,
                    "driven_teeth": 121,
                    "stiffness_n_m_per_rad": 130e3,
                    "damping_n_m_s_per_rad": 150.0,
                    "mesh_efficiency": 0.96,
                    "backlash_rad": 2e-5,
                },
            ],
            "load": {
                "inertia_kg_m2": 30.0,
                "coulomb_friction_n_m": 7.0,
                "viscous_friction_n_m_s_per_rad": 5.0,
            },
            "motion": {"period_s": 2.4, "load_speed_rad_s": 2.5, "acceleration_time_s": 0.25, **motion},
        }
    )


WRIST: dict[str, Any] = {
    "name": "wrist",
    "motor": {"inertia_kg_m2": 0.004, "coulomb_friction_n_m": 0.3, "viscous_friction_n_m_s_per_rad": 0.002},
    "stages": [
        {
            "name": "output",
            "driver_teeth": 11,
            "driven_teeth": 330,
            "stiffness_n_m_per_rad": 30e3,
            "damping_n_m_s_per_rad": 40.0,
        }
    ],
    "load": {"inertia_kg_m2": 4.0, "coulomb_friction_n_m": 4.0},
    "motion": {"period_s": 4.0, "load_speed_rad_s": 2.0, "acceleration_time_s": 0.5},
}
"""One gear of 30 with all that it needs to be simulated."""


def two_gears(transfer: tuple[int, int], output: tuple[int, int]) -> Axis:
    """What is known of an axis that is only heard: the teeth of its stages, driver and driven."""
    (first, second), (third, fourth) = transfer, output
    stages = [
        {"name": "transfer", "driver_teeth": first, "driven_teeth": second, "inertia_kg_m2": 0.02},
        {"name": "output", "driver_teeth": third, "driven_teeth": fourth},
    ]
    return read_axis({"motor": {"inertia_kg_m2": 0.006}, "stages": stages, "load": {"inertia_kg_m2": 40}})


def three_shafts(**output: object) -> Chain:
    """The same as a chain with friction, losses and gaps."""
    shafts = (Shaft(0.004, 0.3, 0.002), Shaft(0.015), Shaft(30.0, 7.0, 5.0))
    links = (
        Link(9.0, 1800.0, 0.3, gap_rad=4e-5),
        Link(11.0, 130e3, 150.0, gap_rad=2e-5, efficiency=(0.96, 0.96)),
    )
    chain = Chain(shafts, links)
    from sim.chain.model import with_link

    return with_link(chain, 1, **output) if output else chain


def chain_of_axis(axis: Axis) -> Chain:
    """The chain of an axis description with its mechanisms."""
    return chain_of(drive_train_of(axis))
