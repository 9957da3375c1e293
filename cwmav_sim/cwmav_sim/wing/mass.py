# SPDX-License-Identifier: Apache-2.0
"""Mass of the wings at the nodes of their sheets: film and rods, whatever moves them."""

from __future__ import annotations

import numpy as np

from cwmav_sim.wing.flexible import Flexibility, locate, stiffener_path
from cwmav_sim.wing.geometry import PanelMesh, WingPlanform
from cwmav_sim.wing.membrane import lumped_mass
from cwmav_sim.wing.sheet import FloatArray

_FINE = 4  # samples of a rod per node spacing


def panel_mass(
    flexibility: Flexibility, planform: WingPlanform, mesh: PanelMesh, spacing: float
) -> FloatArray:
    """Return the mass of one panel at each node of its mesh [kg], shape (n,).

    Parameters
    ----------
    flexibility, planform : Flexibility, WingPlanform
        Film, rods and outline.
    mesh : PanelMesh
        Nodes and triangles of the panel.
    spacing : float
        Distance of the nodes [m].
    """
    film = flexibility.film
    plane = np.stack([mesh.r, mesh.s], axis=1)
    corner = plane[mesh.triangles]
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = 0.5 * np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    mass = lumped_mass(area, mesh.triangles, len(mesh.r), film.density * film.thickness)
    leading = np.stack([np.array([planform.root, planform.length]), np.zeros(2)], axis=1)
    rods = [(leading, flexibility.spar.section().line_mass)]
    for stiffener in flexibility.stiffeners:
        path = stiffener_path(stiffener, planform, spacing / _FINE)
        rods.append((path[[0, -1]], stiffener.section().line_mass))
    for ends, line_mass in rods:
        length = float(np.linalg.norm(ends[1] - ends[0]))
        count = max(1, round(_FINE * length / spacing))
        share = (np.arange(count) + 0.5)[:, None] / count
        triangle, weights = locate(ends[0] + share * (ends[1] - ends[0]), mesh)
        at = mesh.triangles[triangle]
        mass += np.bincount(at.ravel(), (line_mass * length / count * weights).ravel(), minlength=len(mass))
    return mass
