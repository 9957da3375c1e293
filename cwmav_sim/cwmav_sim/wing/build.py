# SPDX-License-Identifier: Apache-2.0
"""Flexible wings from their settings, and quantities one reads off them."""

from __future__ import annotations

import numpy as np

from cwmav_sim.wing.dynamics import Load
from cwmav_sim.wing.flexible import Plan, membrane_wings
from cwmav_sim.wing.lattice import lattice_wings
from cwmav_sim.wing.parts import Configuration
from cwmav_sim.wing.rotation import cross, turn_back
from cwmav_sim.wing.sheet import FloatArray
from cwmav_sim.wing.structure import FlexibleWings

_BUILDERS = {"membrane": membrane_wings, "lattice": lattice_wings}


def flexible_wings(layout: Plan) -> FlexibleWings:
    """Build the wings by the model that the planform's settings name; prescribed wings have no structure."""
    return _BUILDERS[layout.planform.model](layout)


def uniform_pressure(wings: FlexibleWings, pressure: float) -> Load:
    """Return the load of a pressure [Pa] along the normals of the triangles; it follows the sheet."""

    def load(c: Configuration) -> FloatArray:
        x = wings.sheet.state(c, np.zeros((wings.system.rows, 3))).x
        corner = x[wings.triangles]
        share = pressure / 6.0 * cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        forces = np.zeros_like(x)
        np.add.at(forces, wings.triangles, share[:, None, :])
        return wings.sheet.load(c, forces)

    return load


def shape_of(layout: Plan, x: FloatArray, axes: FloatArray, panel: int) -> FloatArray:
    """Return the nodes of one panel in its hinge frame, shape (n, 3), given all nodes ``x`` and frames."""
    count = len(layout.mesh.r)
    return turn_back(axes[panel], x[panel * count : (panel + 1) * count])


def twist(layout: Plan, shape: FloatArray, r: float) -> float:
    """Return the twist [rad] at ``r`` [m] from the hinge: slope of the line from leading to trailing edge."""
    mesh, chord = layout.mesh, layout.planform.chord(layout.mesh.r)
    leading = np.flatnonzero(mesh.s == 0.0)
    trailing = np.flatnonzero((np.abs(mesh.s - chord) < 1e-3 * layout.planform.root_chord) & (mesh.s > 0.0))
    ends = []
    for edge in (leading, trailing):
        edge = edge[np.argsort(mesh.r[edge])]
        ends.append([np.interp(r, mesh.r[edge], shape[edge, k]) for k in (1, 2)])
    across = np.subtract(ends[1], ends[0])
    return float(np.arctan2(across[1], across[0]))
