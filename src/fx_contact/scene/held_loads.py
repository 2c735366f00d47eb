"""Shares of loads and springs on displacements that conditions prescribe, where they move nothing.  All is local."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from fx_contact.geometry.hexahedral_mesh import PLANE
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import Dirichlet, ObliquePlane, Pressure, Traction
from fx_contact.items.elastic_support import Elastic

_Conditions: TypeAlias = Sequence[Dirichlet | ObliquePlane]


def held_share(mesh: RootMesh, conditions: _Conditions, load: Traction | Pressure) -> float:
    """Share of a surface force that acts on displacements prescribed on facets of its surface; 0 without force [-]."""
    held = np.zeros((*mesh.faces.shape, 3), dtype=bool)
    for condition in conditions:
        if isinstance(condition, Dirichlet) and condition.where in mesh.surfaces:
            held[tuple(mesh.surfaces[condition.where].T)] |= condition.held
    facets = mesh.surface(load.surface)
    points, area = mesh.samples(load.surface), mesh.facet_areas(facets)
    each = len(points) // len(facets)
    force = load.at(points, np.repeat(mesh.outward_normals(facets), each, axis=0)).reshape(len(facets), each, 3)
    sizes = [
        np.linalg.norm(part, axis=2).mean(axis=1) @ area for part in (force, force * held[tuple(facets.T)][:, None])
    ]
    return float(sizes[1] / sizes[0]) if sizes[0] else 0.0


def held_stiffness(mesh: RootMesh, conditions: _Conditions, springs: Elastic) -> float:
    """Share of the trace of a stiffness on displacements that conditions prescribe on facets of its surface [-]."""
    facets, held = mesh.surface(springs.surface), np.zeros((*mesh.faces.shape, 3, 3))
    area, stiffness = mesh.facet_areas(facets), springs.stiffness(mesh.outward_normals(facets))
    for condition in conditions:
        if condition.where in mesh.surfaces:
            held[tuple(mesh.surfaces[condition.where].T)] += condition.across
    across = held[tuple(facets.T)]
    span = np.linalg.pinv(across, rcond=PLANE, hermitian=True) @ across
    of_held, total = (area @ np.einsum("nii->n", part) for part in (span @ stiffness, stiffness))
    return float(of_held / total)
