"""Root mesh arrays from a dolfinx mesh of hexahedra, gathered on all ranks."""

from collections.abc import Mapping
from numbers import Integral
from typing import Any

import basix
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import CellType, Mesh, MeshTags
from mpi4py import MPI

from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh_checks import MAX_ORDER
from fx_contact.parallel import compat
from fx_contact.parallel.arrays import FloatArray, Int32Array, IntArray
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_same_comm, shown


def gathered_arrays(
    comm: MPI.Intracomm,
    mesh: Mesh,
    cell_tags: MeshTags | None,
    facet_tags: MeshTags,
    bodies: Mapping[int, str],
    surfaces: Mapping[int, str],
    parts: Mapping[int, str],
) -> dict[str, Any]:
    """Arguments of RootMesh, alike on all ranks.  Collective on comm.  Arguments and errors of `RootMesh.from_dolfinx`.

    Raises GeometryError and SceneError.
    """
    with together(comm):
        _check_mesh(mesh, comm)
        for name, names in (("bodies", bodies), ("surfaces", surfaces), ("parts", parts)):
            if not isinstance(names, dict) or not all(isinstance(tag, Integral) for tag in names):
                raise SceneError(f"{name} must be a dict of tag -> name, such as {{7: 'block'}}, got {shown(names)}")
        if {*parts} - {*bodies}:
            raise SceneError(f"parts must have tags of bodies, {shown(list(bodies))}, got {shown(list(parts))}")
        for name, tags, dimension in (("cell_tags", cell_tags, 3), ("facet_tags", facet_tags, 2)):
            if tags is None and name == "cell_tags" and len(bodies) == 1:
                continue
            if tags is None and name == "cell_tags" and not bodies:
                raise SceneError("bodies is empty: name the only body, {1: 'block'}, or give cell_tags of several")
            if not isinstance(tags, MeshTags) or tags.dim != dimension:
                got = f"some of dimension {tags.dim}" if isinstance(tags, MeshTags) else shown(tags)
                raise SceneError(f"{name} must be MeshTags of dolfinx of dimension {dimension}, got {got}")
            if tags._cpp_object.topology is not mesh._cpp_object.topology:  # one C++ object; its wrappers are many
                raise SceneError(
                    f"{name} are of another mesh, whose entities have other indices: make them with "
                    f"dolfinx.mesh.meshtags(mesh, {dimension}, ...) of the mesh that you give"
                )
    mesh.topology.create_connectivity(2, 3)
    mesh.topology.create_connectivity(3, 2)
    with together(comm):
        mine = _rows(mesh, cell_tags, facet_tags, list(bodies), list(surfaces))
    number, of, nodes, x, tag, cell, face = (np.concatenate(part) for part in zip(*comm.allgather(mine)))
    order = np.argsort(number)
    of, nodes, x = of[order], nodes[order], x[order]
    used, cells = np.unique(nodes, return_inverse=True)
    points = np.empty((len(used), 3))
    points[cells.ravel()] = x.reshape(-1, 3)
    rows = np.stack([np.searchsorted(number[order], cell), face], axis=1).astype(np.int32)
    of_bodies, body_tags = list(dict.fromkeys(bodies.values())), np.array(list(bodies))[of]
    return {
        "points": points,
        "cells": cells.reshape(nodes.shape),
        "bodies": tuple(of_bodies),
        "body": np.array([of_bodies.index(name) for name in bodies.values()], dtype=np.int32)[of],
        "surfaces": {name: np.unique(rows[np.isin(tag, own)], axis=0) for name, own in _tags_of(surfaces).items()},
        "parts": {name: np.flatnonzero(np.isin(body_tags, own)) for name, own in _tags_of(parts).items()},
    }


def _tags_of(names: Mapping[int, str]) -> dict[str, list[int]]:
    """Tags of each name."""
    return {name: [tag for tag, other in names.items() if other == name] for name in names.values()}


def _check_mesh(mesh: Mesh, comm: MPI.Intracomm) -> None:
    if not isinstance(mesh, Mesh):
        raise SceneError(f"a Mesh of dolfinx is needed, got {shown(mesh)}")
    check_same_comm("the mesh", mesh.comm, comm)
    kind, cmap = mesh.topology.cell_type, compat.coordinate_element(mesh)
    complete = cmap.degree <= MAX_ORDER and cmap.dim == (cmap.degree + 1) ** 3
    if kind != CellType.hexahedron or mesh.geometry.dim != 3 or not complete:
        raise GeometryError(
            f"the mesh has cells of type {kind.name!r} and order {cmap.degree} in {mesh.geometry.dim}D; only complete "
            f"hexahedra of order 1 to {MAX_ORDER} in 3D can be refined"
        )


def _rows(
    mesh: Mesh, cell_tags: MeshTags | None, facet_tags: MeshTags, bodies: list[int], surfaces: list[int]
) -> tuple[npt.NDArray[Any], ...]:
    """This rank's cells and tagged facets, from the tags of bodies and of surfaces.

    Of cells: number, position of the tag in `bodies`, (p+1)^3 nodes and positions [m].  Of tagged facets: tag, number
    of the cell, local face.  Numbers are those of the input of the mesh.
    """
    owned, numbers = mesh.topology.index_map(3).size_local, mesh.topology.original_cell_index
    of: Int32Array = np.full(len(numbers), 0 if cell_tags is None else -1, dtype=np.int32)
    if cell_tags is not None:
        for index, tag in enumerate(bodies):
            of[cell_tags.indices[cell_tags.values == tag]] = index
    of = of[:owned]
    if (of < 0).any():
        raise SceneError(
            f"cell {numbers[np.argmin(of)]} of the mesh is in no body: give every cell one of the tags "
            f"{shown(bodies)}"
        )
    order, to_equispaced = _tensor_order(compat.coordinate_element(mesh))
    local = compat.geometry_nodes(mesh)[:owned]
    nodes = mesh.geometry.input_global_indices[local][:, order]
    x = to_equispaced @ mesh.geometry.x[local][:, order]
    named = np.isin(facet_tags.values, surfaces)
    tags, facets = facet_tags.values[named], facet_tags.indices[named]
    facets_of_cells = mesh.topology.connectivity(3, 2).array.reshape(-1, 6)[:owned]
    cell, face = np.nonzero(np.isin(facets_of_cells, facets))
    place = np.searchsorted(facets, facets_of_cells[cell, face])  # MeshTags are sorted
    return numbers[:owned], of, nodes, x, tags[place] if len(cell) else tags[:0], numbers[cell], face


def _tensor_order(cmap: Any) -> tuple[IntArray, FloatArray]:
    """Position ((q+1)^3,) of each tensor-order node in dolfinx's order, and the matrix that makes nodes equispaced."""
    variant = basix.LagrangeVariant(cmap.variant)
    element = basix.create_element(basix.ElementFamily.P, basix.CellType.hexahedron, cmap.degree, variant)
    order = np.lexsort(np.round(np.asarray(element.points), 9).T)  # z slowest
    if variant == basix.LagrangeVariant.equispaced or cmap.degree < 3:
        return order, np.eye(len(order))
    equispaced = hexahedron.grid_points(cmap.degree) / cmap.degree
    return order, np.asarray(element.tabulate(0, equispaced))[0, :, :, 0][:, order]
