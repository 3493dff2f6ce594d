"""The equations of motion against energies, a pendulum, and each other."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.robot_bank.arm import Arm, draw_arm
from benchmarks.robot_bank.multibody import Array, torques

GRAVITY = np.array([1.2, -0.7, -9.6])


def _height_energy(arm: Arm, angles: Array) -> Array:
    """Return the energy of weight (n,) [J]."""
    placed = arm.chain.placements(angles)
    centers = [rotation @ body.center + shift for (rotation, shift), body in zip(placed, arm.bodies, strict=True)]
    return -sum((body.mass * (c @ GRAVITY) for body, c in zip(arm.bodies, centers, strict=True)), np.zeros(len(angles)))


def _kinetic_energy(arm: Arm, before: Array, after: Array, step: float) -> Array:
    """Return the energy of motion (n,) [J] from two poses `step` seconds apart, by where the bodies are alone.

    A rotation's rate is that of its matrix: 1/2 tr(R' P R'^T), P the second moments of mass about the centre.
    """
    energy = np.zeros(len(before))
    for body, (r0, s0), (r1, s1) in zip(
        arm.bodies, arm.chain.placements(before), arm.chain.placements(after), strict=True
    ):
        velocity = ((r1 - r0) @ body.center + s1 - s0) / step
        rate = (r1 - r0) / step
        moments = np.trace(body.inertia) / 2 * np.eye(3) - body.inertia
        energy += body.mass * np.sum(velocity**2, axis=1) / 2
        energy += np.einsum("nab,bc,nac->n", rate, moments, rate) / 2
    return energy


@pytest.mark.parametrize("seed", range(2))
def test_torques_are_those_of_lagrange_by_differences_of_the_energies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm = draw_arm(rng)
    q, qd, qdd = rng.uniform(-2, 2, (3, 1, 6))
    small, tiny = 1e-3, 1e-4

    def lagrangian(angles: Array, speeds: Array) -> float:
        kinetic = _kinetic_energy(arm, angles - tiny * speeds, angles + tiny * speeds, 2 * tiny)
        return float((kinetic - _height_energy(arm, angles))[0])

    def momentum(angles: Array, speeds: Array, j: int) -> float:
        # quadratic in the speeds: exact with any step
        d = np.eye(6)[j]
        return (lagrangian(angles, speeds + d) - lagrangian(angles, speeds - d)) / 2

    expected = np.empty(6)
    for j in range(6):
        later, earlier = (momentum(q + s * small * qd, qd + s * small * qdd, j) for s in (1, -1))
        d = small * np.eye(6)[j]
        force = (lagrangian(q + d, qd) - lagrangian(q - d, qd)) / (2 * small)
        expected[j] = (later - earlier) / (2 * small) - force
    (found,) = torques(arm.chain, arm.bodies, q, qd, qdd, GRAVITY)
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.max(np.abs(found)))
