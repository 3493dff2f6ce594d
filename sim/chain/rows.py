"""Rows of numbers of shafts, links, lines and dents for the compiled kernels, in the order of `sim.laws`."""

from __future__ import annotations

from collections.abc import Sequence

from sim.chain.model import Dent, Line, Link, Shaft, with_loss
from sim.laws import turning_torque
from sim.rotational.components.elasto_backlash import CONTACT_LAWS, NO_GAP


def shaft_row(shaft: Shaft) -> list[float]:
    """Numbers of a shaft, unchecked."""
    back_coulomb = shaft.coulomb_n_m if shaft.coulomb_backward_n_m is None else shaft.coulomb_backward_n_m
    back_viscous = shaft.viscous_n_m_s if shaft.viscous_backward_n_m_s is None else shaft.viscous_backward_n_m_s
    one_sided = (
        back_coulomb > 0 or shaft.coulomb_n_m > 0 or shaft.stribeck_n_m != 0 or back_viscous != shaft.viscous_n_m_s
    )
    frictional = one_sided or shaft.drift_per_s != 0
    return [
        shaft.inertia_kg_m2, shaft.coulomb_n_m, back_coulomb, shaft.viscous_n_m_s, back_viscous, shaft.stribeck_n_m,
        shaft.stribeck_speed_rad_s, shaft.stribeck_exponent, shaft.drift_per_s, shaft.gravity_n_m,
        shaft.gravity_phase_rad, shaft.offset_n_m, float(frictional),
    ]  # fmt: skip


def link_row(link: Link) -> list[float]:
    """Numbers of a link, unchecked; the turning point of its losses is LossyGear's tau_bf_a."""
    eta1, eta2 = with_loss(link.efficiency, link.loss_fraction)
    bf1, bf2 = link.bearing_n_m
    turn = turning_torque(eta1, eta2, bf1, bf2)
    lossy = (eta1, eta2, bf1, bf2) != (1, 1, 0, 0)
    plain = link.gap_rad <= NO_GAP and not any(dent.depth_rad for dent in link.dents)
    law = 0.0 if plain else CONTACT_LAWS[link.law]
    return [
        1 / link.ratio, link.stiffness_n_m_per_rad, link.damping_n_m_s_per_rad, 0.5 * link.gap_rad, law, eta1, eta2,
        bf1, bf2, turn, float(lossy), link.cubic_per_rad2, link.hysteresis_n_m, link.hysteresis_rad,
    ]  # fmt: skip


def line_rows(lines: Sequence[Line], acts_on: int = 0) -> list[tuple[float, ...]]:
    """Rows of the lines that have an amplitude, unchecked."""
    return [
        (float(line.shaft), line.order, line.amplitude, line.phase_rad, float(acts_on))
        for line in lines
        if line.amplitude
    ]


def dent_rows(dents: Sequence[Dent]) -> list[tuple[float, ...]]:
    """Rows of the dents that have a depth, unchecked."""
    return [
        (float(dent.shaft), dent.angle_rad, dent.flank / dent.half_width_rad, dent.depth_rad, dent.form)
        for dent in dents
        if dent.depth_rad
    ]
