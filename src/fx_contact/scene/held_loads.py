"""Shares of loads and springs on displacements that conditions prescribe, where they move nothing.  All is local."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from fx_contact.geometry.hexahedral_mesh import PLANE
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import Dirichlet, ObliquePlane, Pressure, Traction
from fx_contact.items.elastic_support import Elastic
from fx_contact.parallel.arrays import FloatArray, IntArray

_Conditions: TypeAlias = Sequence[Dirichlet | ObliquePlane]


def held_share(mesh: RootMesh, conditions: _Conditions, load: Traction | Pressure) -> float:
    """Share of a surface force that acts on displacements prescribed on facets of its surface; 0 without force [-]."""
    facets, points = mesh.surface(load.surface), mesh.samples(load.surface)
    normals = np.repeat(mesh.outward_normals(facets), len(points) // len(facets), axis=0)
    force = load.at(points, normals).reshape(len(facets), -1, 3)
    held = held_across(mesh, [condition for condition in conditions if isinstance(condition, Dirichlet)], facets) > 0
    of_held = force * np.einsum("nii->ni", held)[:, None]
    sizes = [mesh.facet_areas(facets) @ np.linalg.norm(part, axis=2).mean(axis=1) for part in (of_held, force)]
    return float(sizes[0] / sizes[1]) if sizes[1] else 0.0


def held_stiffness(mesh: RootMesh, conditions: _Conditions, springs: Elastic) -> float:
    """Share of the trace of a stiffness on displacements that conditions prescribe on facets of its surface [-]."""
    facets = mesh.surface(springs.surface)
    stiffness, across = springs.stiffness(mesh.outward_normals(facets)), held_across(mesh, conditions, facets)
    span = np.linalg.pinv(across, rcond=PLANE, hermitian=True) @ across
    of_held, total = (mesh.facet_areas(facets) @ np.einsum("nii->n", part) for part in (span @ stiffness, stiffness))
    return float(of_held / total)


def held_across(mesh: RootMesh, conditions: _Conditions, facets: IntArray) -> FloatArray:
    """Sum (n, 3, 3) of the projectors of conditions on facets (n, 2)."""
    held = np.zeros((*mesh.faces.shape, 3, 3))
    for condition in conditions:
        if condition.where in mesh.surfaces:
            held[tuple(mesh.surfaces[condition.where].T)] += condition.across
    return np.asarray(held[tuple(facets.T)])
