"""The axis of Olsson and Stolyarchuk, as far as their paper says it, and what it leaves open.

Said: motor inertia 0.6 kg m2, ratio 100, stiffness 1e5 N m/rad, load 20 to 50 kg m2, pinion on the motor shaft,
transfer gear, output gear; output at 2.7 rad/s, period 2 to 2.2 s, engagement of the output gear below 200 Hz.
Chosen here: tooth numbers that give this ratio and frequency, the inertia between the gears, damping, and as-new
clearances and errors of a good industrial gear (below 0.1 minutes of arc).
"""

from __future__ import annotations

from sim.description.axis import Axis, Load, Motion, Motor, Stage

PAPER_AXIS = Axis(
    name="paper-axis",
    motor=Motor(inertia_kg_m2=0.6, coulomb_friction_n_m=0.9),
    stages=(
        Stage(
            "transfer",
            driver_teeth=12,
            driven_teeth=96,
            inertia_kg_m2=0.05,
            stiffness_n_m_per_rad=3200.0,
            damping_n_m_s_per_rad=2.0,
            backlash_rad=5e-5,
            transmission_error_rad=2e-5,
        ),
        Stage(
            "output",
            driver_teeth=12,
            driven_teeth=150,
            stiffness_n_m_per_rad=1.25e5,
            damping_n_m_s_per_rad=300.0,
            mesh_efficiency=0.97,
            backlash_rad=2e-5,
            transmission_error_rad=1.5e-6,
        ),
    ),
    load=Load(inertia_kg_m2=40.0, coulomb_friction_n_m=9.0, viscous_friction_n_m_s_per_rad=6.0),
    motion=Motion(period_s=4.2, load_speed_rad_s=2.7, acceleration_time_s=0.3, dwell_s=0.1),
)
"""Stiffness of both stages in series, felt at the output: 1e5 N m/rad."""
