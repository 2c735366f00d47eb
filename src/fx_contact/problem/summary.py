"""Summaries of a root mesh and of a scene in a few lines, for `repr`.  Local."""

from __future__ import annotations

from collections.abc import Mapping
from textwrap import fill, indent
from typing import TYPE_CHECKING

import numpy as np

from fx_contact.parallel.arrays import IntArray
from fx_contact.problem.boundary_conditions import COMPONENTS, Dirichlet, ObliquePlane

if TYPE_CHECKING:
    from fx_contact.problem.root_mesh import RootMesh
    from fx_contact.problem.scene import Scene


def mesh_summary(mesh: RootMesh) -> str:
    """Bounding box, cells and named parts of a root mesh."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    box = " x ".join(f"[{a:.5g}, {b:.5g}]" for a, b in zip(low, high))
    cells = np.bincount(mesh.body, minlength=len(mesh.bodies))
    lists = {"bodies (cells)": [f"{name!r} ({count:,})" for name, count in zip(mesh.bodies, cells)]}
    groups: dict[str, Mapping[str, IntArray]]
    groups = {"surfaces (facets)": mesh.surfaces, "curves (edges)": mesh.curves, "vertices (nodes)": mesh.vertices}
    for title, group in groups.items():
        lists[title] = [f"{name!r} ({len(rows):,})" for name, rows in group.items()]
    return _lines(f"root mesh of {len(mesh.cells):,} hexahedra of order {mesh.order} in {box}", lists)


def scene_summary(scene: Scene) -> str:
    """Materials, contact pairs, conditions and loads of a scene, and its root mesh."""
    parts = "" if scene.symmetry == 1 else f", modelled as one of {scene.symmetry} symmetric parts"
    materials = ((body, scene.materials[body]) for body in scene.mesh.bodies)
    lists = {
        "materials": [f"{body!r} E = {m.young:.5g}, nu = {m.poisson:.5g}" for body, m in materials],
        "contact": [" on ".join(map(repr, contact.surfaces)) for contact in scene.contact],
        "displacements": [f"{c.where!r} ({_components(c)})" for c in scene.conditions],
        "surface forces": [repr(force.surface) for force in scene.tractions],
        "body forces": [repr(force.body) for force in scene.body_forces],
    }
    return _lines(f"scene {scene.name!r}{parts}\n{indent(mesh_summary(scene.mesh), '  ')}", lists)


def _lines(head: str, lists: dict[str, list[str]]) -> str:
    """A head and the lists that are not empty, wrapped."""
    texts = [f"{title}: {', '.join(items)}" for title, items in lists.items() if items]
    return "\n".join([head, *(fill(text, 110, initial_indent="  ", subsequent_indent="    ") for text in texts)])


def _components(condition: Dirichlet | ObliquePlane) -> str:
    """Names of the prescribed components, or the normal of an oblique plane."""
    if isinstance(condition, ObliquePlane):
        return f"across {', '.join(f'{round(x, 3) + 0.0:g}' for x in condition.normal)}"
    return "".join(name for name, held in zip(COMPONENTS, condition.held) if held)
