"""Bodies cut out of a conforming mesh, in which they share nodes."""

from typing import Any

import numpy as np

from fx_contact.geometry.hexahedral_mesh import Hexahedra
from fx_contact.parallel.arrays import IntArray
from fx_contact.parallel.errors import SceneError


def cut_bodies(arrays: dict[str, Any]) -> dict[str, Any]:
    """Arguments of RootMesh with nodes of its own for each body, from those of a mesh whose bodies share nodes.

    Local.  Facets of a body "a" on another one, "b", are the surface "a to b".  A surface with facets between bodies
    is replaced by one of each body, "a SURFACE" and "b SURFACE".

    Raises SceneError: no facet lies between bodies, or two surfaces would have one name.
    """
    points, cells, body, bodies = (arrays[name] for name in ("points", "cells", "body", "bodies"))
    number = len(bodies) * cells + body[:, None]  # of a node in a body
    used, own = np.unique(number, return_inverse=True)
    facet, other = _between(Hexahedra(points, cells), body)
    if not len(facet):
        raise SceneError("no facet lies between two bodies: without `split` the mesh is taken as it is")
    names, rows = list[str](), list[IntArray]()
    for a, b in np.unique(np.stack([body[facet // 6], other]), axis=1).T:
        names.append(f"{bodies[a]} to {bodies[b]}")
        rows.append(np.stack(np.divmod(facet[(body[facet // 6] == a) & (other == b)], 6), axis=1))
    for name, given in arrays["surfaces"].items():
        cut = np.isin(6 * given[:, 0] + given[:, 1], facet).any()
        for index in np.unique(body[given[:, 0]]) if cut else [-1]:
            names.append(f"{bodies[index]} {name}" if cut else name)
            rows.append(given[body[given[:, 0]] == index] if cut else given)
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"`split` makes two surfaces {name!r}: give bodies or surfaces other names")
    vertices = {
        name: np.flatnonzero(np.isin(used // len(bodies), nodes))
        for name, nodes in arrays.get("vertices", {}).items()
    }
    arrays = arrays | {"points": points[used // len(bodies)], "cells": own.reshape(cells.shape)}
    return arrays | {"surfaces": dict(zip(names, rows)), "vertices": vertices}


def _between(mesh: Hexahedra, body: IntArray) -> tuple[IntArray, IntArray]:
    """Facets (n,), 6 times the cell plus the local face, on another body, ascending, and that body (n,)."""
    here, there = np.concatenate([mesh.common_faces, mesh.common_faces[:, ::-1]]).T
    some = np.flatnonzero(body[here // 6] != body[there // 6])
    some = some[np.argsort(here[some])]
    return here[some], body[there[some] // 6]
