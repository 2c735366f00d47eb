"""What a root mesh and a scene say of themselves: some lines, as `repr` shows them.  Local."""

from textwrap import fill, indent

import numpy as np

from fx_contact.problem.boundary_conditions import COMPONENTS, ObliquePlane


def mesh_summary(mesh):
    """Lines on a RootMesh: str."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    box = " x ".join(f"[{a:.5g}, {b:.5g}]" for a, b in zip(low, high))
    groups = {
        "bodies (cells)": zip(mesh.bodies, np.bincount(mesh.body, minlength=len(mesh.bodies))),
        "surfaces (facets)": ((name, len(rows)) for name, rows in mesh.surfaces.items()),
        "curves (edges)": ((name, len(rows)) for name, rows in mesh.curves.items()),
        "vertices (nodes)": ((name, len(nodes)) for name, nodes in mesh.vertices.items()),
    }
    lists = {title: [f"{name!r} ({count:,})" for name, count in group] for title, group in groups.items()}
    return _lines(f"root mesh of {len(mesh.cells):,} hexahedra of order {mesh.order} in {box}", lists)


def scene_summary(scene):
    """Lines on a Scene: str."""
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


def _lines(head, lists):
    """A head and the lists that are not empty, wrapped."""
    wrap = {"width": 110, "initial_indent": "  ", "subsequent_indent": "    "}
    return "\n".join(
        [head, *(fill(f"{title}: {', '.join(items)}", **wrap) for title, items in lists.items() if items)]
    )


def _components(condition):
    """Names of the components that a condition prescribes, or the normal of an oblique plane."""
    if isinstance(condition, ObliquePlane):
        return f"across {', '.join(f'{round(x, 3) + 0.0:g}' for x in condition.normal)}"
    return "".join(name for name, held in zip(COMPONENTS, condition.held) if held)
