# SPDX-License-Identifier: Apache-2.0
"""Elements of the structure: forces are gradients of the energy, tangents their derivatives."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from cwmav_sim.wing.algebra import straightened, vector_of
from cwmav_sim.wing.connector import Connectors, Ends, Stiffness
from cwmav_sim.wing.membrane import Membrane, plane_stress
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.rotation import compounded, exponential

STEP = 1e-6


def rows(matrix):
    return tuple(tuple(row) for row in matrix.tolist())


class Probe:
    """An element family in some configuration, differentiated numerically."""

    def __init__(self, element, configuration):
        self.element, self.c = element, configuration
        self.nodes = len(configuration.x)
        self.size = 3 * (self.nodes + len(configuration.turn))

    def moved(self, q, rate=0.0):
        q = q.reshape(-1, 3)
        c, n = self.c, self.nodes
        return Configuration(
            c.x + q[:n], c.v + rate * q[:n], exponential(q[n:]) @ c.turn, c.spin + rate * q[n:]
        )

    def force(self, c):
        return np.bincount(self.element.dofs.ravel(), self.element.forces(c).ravel(), minlength=self.size)

    def slope(self, function):
        unit = STEP * np.eye(self.size)
        return np.array([(function(u) - function(-u)) / (2 * STEP) for u in unit]).T

    def tangent(self, rate):
        out = np.zeros((self.size, self.size))
        blocks = self.element.tangent(self.c, rate, self.c).reshape(*self.element.dofs.shape, -1)
        for dofs, block in zip(self.element.dofs, blocks, strict=True):
            out[np.ix_(dofs, dofs)] += block
        return out


def film(viscosity=0.0, moving=0.0):
    rng = np.random.default_rng(3)
    plane = np.array([[0.0, 0.0], [1.0, 0.1], [0.2, 0.9], [1.1, 1.2]])
    triangles = np.array([[0, 1, 2], [1, 3, 2]])
    x = np.concatenate([plane, np.zeros((4, 1))], axis=1) + 0.2 * rng.normal(size=(4, 3))
    element = Membrane(plane, triangles, thickness=0.5, law=plane_stress(2.0, 0.3), viscosity=viscosity)
    v = moving * rng.normal(size=(4, 3))
    return Probe(element, Configuration(x, v, np.zeros((0, 3, 3)), np.zeros((0, 3))))


def connectors(*, bend=0.1, viscosity=0.0, moving=0.0):
    rng = np.random.default_rng(4)
    m = 3

    def end(first_node, first_body):
        nodes = np.tile(np.arange(first_node, first_node + 3), (m, 1))
        shares = rng.dirichlet(np.ones(3), m)
        triad = exponential(bend * rng.normal(size=(m, 3)))
        return Ends(
            nodes, shares, np.arange(first_body, first_body + m), 0.3 * rng.normal(size=(m, 3)), triad
        )

    stiffness = Stiffness(1.0 + rng.random((m, 3)), rng.random((m, 3)), rng.normal(size=(m, 3)))
    element = Connectors(end(0, 0), end(3, m), stiffness, 6, viscosity=viscosity)
    turn = exponential(bend * rng.normal(size=(2 * m, 3)))
    velocity = moving * rng.normal(size=(6, 3)), moving * rng.normal(size=(2 * m, 3))
    return Probe(element, Configuration(rng.normal(size=(6, 3)), velocity[0], turn, velocity[1]))


@pytest.mark.parametrize("probe", [film(), connectors(bend=0.1), connectors(bend=0.8)])
def test_forces_are_the_gradient_of_the_energy(probe):
    gradient = probe.slope(lambda q: probe.element.energy(probe.moved(q)))
    assert_allclose(probe.force(probe.c), gradient, atol=1e-7 * np.abs(gradient).max())


@pytest.mark.parametrize(
    ("probe", "rate", "tolerance"),
    [
        (film(), 0.0, 1e-8),
        (film(viscosity=0.4, moving=0.5), 3.0, 1e-8),
        (connectors(bend=0.02), 0.0, 1e-3),
        (connectors(bend=0.1), 0.0, 1e-2),
    ],
)
def test_tangent_is_the_derivative_of_the_forces(probe, rate, tolerance):
    exact = probe.slope(lambda q: probe.force(probe.moved(q, rate)))
    assert_allclose(probe.tangent(rate), exact, atol=tolerance * np.abs(exact).max())


@pytest.mark.parametrize("probe", [film(viscosity=0.7), connectors(bend=0.4, viscosity=0.7)])
def test_rigid_motion_changes_no_force_and_loses_nothing(probe):
    c = probe.c
    rotation, spin = exponential(np.array([0.7, -1.1, 0.4])), np.array([3.0, -2.0, 5.0])
    x = c.x @ rotation.T + 0.3
    turn = rotation @ c.turn
    moving = Configuration(x, np.cross(spin, x) - 1.0, turn, np.tile(spin, (len(turn), 1)))
    rest = probe.force(c).reshape(-1, 3)
    assert_allclose(
        probe.force(moving).reshape(-1, 3), rest @ rotation.T, atol=1e-12 * np.abs(rest).max() * 100
    )
    assert probe.element.energy(moving) == pytest.approx(probe.element.energy(c), rel=1e-12)
    assert probe.element.dissipation(moving) == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize("probe", [film(viscosity=0.7, moving=1.0), connectors(viscosity=0.7, moving=1.0)])
def test_dissipation_is_the_work_of_the_viscous_forces(probe):
    c = probe.c
    still = Configuration(c.x, 0 * c.v, c.turn, 0 * c.spin)
    viscous = probe.force(c) - probe.force(still)
    power = viscous @ c.rates.ravel()
    assert probe.element.dissipation(c) == pytest.approx(power, rel=1e-10)
    assert power > 0


@pytest.mark.parametrize("size", [1e-9, 1e-5, 0.3, 3.0])
def test_logarithm_inverts_exponential(size):
    vector = size * np.array([0.6, -0.64, 0.48])
    assert_allclose(vector_of(rows(exponential(vector))), vector, rtol=1e-9)


def test_compounded_rotation_vectors():
    vector, change = np.array([0.2, -0.1, 0.15]), 1e-4 * np.array([1.0, 2.0, -1.0])
    exact = vector_of(rows(exponential(change) @ exponential(vector)))
    assert_allclose(compounded(vector, change), exact, atol=3e-9)


def test_straightening_removes_drift():
    drifted = exponential(np.array([0.3, 0.2, 0.1])) + 1e-5
    clean = np.array(straightened(rows(drifted)))
    assert_allclose(clean.T @ clean, np.eye(3), atol=1e-9)
