"""Root meshes from Gmsh: the current model, or a .msh file, of any order up to 6.

Physical groups give the names: volumes are bodies, or parts of a body if they are in another, larger group, that of
the body; surfaces, curves and points are surfaces, curves and vertices.  Without groups of volumes each volume is a
body with the name of its CAD part, and their faces are surfaces, "PART face 1" and so on.  The order of Gmsh's nodes is
computed from the local coordinates that Gmsh reports.
"""

import traceback
from collections.abc import Callable
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fx_contact.geometry import hexahedron
from fx_contact.geometry.body_cut import cut_bodies
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.geometry.root_mesh_checks import MAX_ORDER
from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.arrays import Int64Array, IntArray
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_comm, check_flag, shown

#: By dimension: Gmsh's name of the elements of curves and surfaces, and the corners of a cell's edges and faces.
_FAMILIES = {1: ("Line", hexahedron.EDGE_CORNERS), 2: ("Quadrangle", hexahedron.FACE_CORNERS)}


@collective("comm")
def root_mesh_from_gmsh(comm: MPI.Intracomm, build: Callable[[], object], *, split: bool = False) -> RootMesh:
    """Root mesh, the same on all ranks, of a model built with Gmsh on rank 0.

    Collective on comm.

    Args:
        build: leaves a meshed current model; called on rank 0 only, with Gmsh initialised and silent.
        split: bodies share nodes, as after `fragment`, and are cut apart, with surfaces in between as of `cut_bodies`.

    Raises:
        GeometryError, SceneError: as `RootMesh`; cells that are not hexahedra, or an order above 6.
        GeometryError: `build` is no function, or a call of Gmsh by it fails.
        Exception: any other error of the function on rank 0, on all ranks.
    """
    check_comm(comm)
    with together(comm):
        check_flag("`split`", split)
        if comm.rank == 0 and not callable(build):
            raise GeometryError(f"build must be a function without arguments that makes a mesh, got {shown(build)}")
        parts = _with_gmsh(build) if comm.rank == 0 else {}
    parts = comm.bcast(parts, root=0)
    with together(comm):
        return RootMesh(**(cut_bodies(parts) if split else parts))


@collective("comm")
def root_mesh_from_file(comm: MPI.Intracomm, path: str | Path, *, split: bool = False) -> RootMesh:
    """Root mesh, the same on all ranks, from a .msh file with hexahedra and physical groups, read on rank 0.

    Collective on comm.  Arguments as of `root_mesh_from_gmsh`.  Raises SceneError if Gmsh cannot read the file, and as
    `root_mesh_from_gmsh`.
    """
    check_comm(comm)
    source = shared_path(comm, "a mesh file", path)

    def read() -> None:
        """Read the file into the current model.  Raises SceneError if Gmsh cannot."""
        import gmsh

        try:
            with source.open("rb") as file:
                if file.read(1) != b"$":  # Gmsh would run it as a script
                    raise SceneError(f"{str(source)!r} is no mesh file of Gmsh: it does not begin with $MeshFormat")
        except OSError as error:
            raise SceneError(f"cannot read the mesh file: {error}") from None
        try:
            gmsh.open(str(source))
        except Exception as error:  # Gmsh has no error type of its own
            raise SceneError(f"Gmsh cannot read {str(source)!r}: {error}; is it whole? write it again") from None

    return root_mesh_from_gmsh(comm, read, split=split)


def _with_gmsh(build: Callable[[], object]) -> dict[str, Any]:
    """Arguments of RootMesh from the model that a function builds."""
    import gmsh

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        build()
    except Exception as error:
        *_, (frame, _) = traceback.walk_tb(error.__traceback__)
        if type(error) is not Exception or frame.f_globals.get("__name__") != gmsh.__name__:
            raise
        raise GeometryError(f"Gmsh cannot build the model: {error}") from error  # it has no type of error of its own
    else:
        return _read_model(gmsh.model)
    finally:
        if ours:
            gmsh.finalize()


def _read_model(model: Any) -> dict[str, Any]:
    """Arguments of RootMesh from the current Gmsh model."""
    element_type, order, tensor_order = _hexahedron(model)
    solids, faces = ({}, {}) if model.getPhysicalGroups(3) else _assembly(model)
    bodies, parts = _bodies_and_parts(model, solids)
    volumes, of_body = np.concatenate(list(bodies.values())), [len(own) for own in bodies.values()]
    groups = [model.mesh.getElementsByType(element_type, volume)[1] for volume in volumes]
    count = [len(group) // len(tensor_order) for group in groups]
    volume, body = (np.repeat(of, count) for of in (volumes, np.repeat(np.arange(len(bodies)), of_body)))
    used, cells = np.unique(np.concatenate(groups).astype(np.int64), return_inverse=True)
    cells = cells.reshape(-1, len(tensor_order))[:, tensor_order]
    corners = used[cells[:, hexahedron.corner_nodes(order)]]
    tags, points, _ = model.mesh.getNodes()
    tags = tags.astype(np.int64)
    by_tag = np.argsort(tags)
    return {
        "points": points.reshape(-1, 3)[by_tag[np.searchsorted(tags, used, sorter=by_tag)]],
        "cells": cells,
        "bodies": tuple(bodies),
        "body": body,
        "surfaces": _facing(model, 2, faces | _groups(model, 2), order, corners),
        "curves": _facing(model, 1, _groups(model, 1), order, corners),
        "vertices": _vertices(model, used),
        "parts": {name: np.flatnonzero(np.isin(volume, own)) for name, own in parts.items()},
    }


def _assembly(model: Any) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    """Name -> the volume of each CAD part, and each face of one of them alone."""
    solids, faces = dict[str, IntArray](), dict[str, IntArray]()
    for _, volume in model.getEntities(3):
        label = model.getEntityName(3, volume).rpartition("/")[2].strip() or "solid"
        others = (f"{label} {number}" for number in count(2))
        body = next(name for name in chain([label], others) if name not in solids)
        solids[body] = np.array([volume])
        own = [face for face in model.getAdjacencies(3, volume)[1] if len(model.getAdjacencies(2, face)[0]) == 1]
        faces |= {f"{body} face {number}": np.array([face]) for number, face in enumerate(own, 1)}
    return solids, faces


def _bodies_and_parts(model: Any, solids: dict[str, IntArray]) -> tuple[dict[str, IntArray], dict[str, IntArray]]:
    """Name -> volumes of each body, and of each part: a group whose volumes, with others, are another group.

    Raises SceneError unless every volume is in a group.
    """
    groups = solids or _groups(model, 3)
    nameless = {tag for _, tag in model.getEntities(3)}.difference(*groups.values())
    if nameless:
        raise SceneError(
            f"volumes {sorted(nameless)} of the Gmsh model are in no physical group; give each body a physical group "
            "with a name, or remove the volumes"
        )
    sets = {name: set(map(int, volumes)) for name, volumes in groups.items()}
    parts = {name: groups[name] for name, own in sets.items() if any(own < other for other in sets.values())}
    return {name: volumes for name, volumes in groups.items() if name not in parts}, parts


def _hexahedron(model: Any) -> tuple[int, int, IntArray]:
    """Gmsh's type of the volume elements, their order, and Gmsh's number of each of their nodes in tensor order."""
    types = model.mesh.getElementTypes(3)
    properties = [model.mesh.getElementProperties(kind) for kind in types]
    complete = ["hexahedron" in name.lower() and n == (order + 1) ** 3 for name, _, order, n, *_ in properties]
    if not properties:
        flat = [model.mesh.getElementProperties(kind)[0] for kind in model.mesh.getElementTypes(2)]
        raise GeometryError(
            f"the mesh has no volumes, and surfaces of {flat or 'no elements'}: bodies have hexahedra; extrude "
            "the surfaces with recombine=True, give each volume a physical group, and mesh in 3D, generate(3)"
        )
    if complete != [True]:
        raise GeometryError(
            f"the volume mesh has elements of type {[p[0] for p in properties]}; only hexahedra can be refined, "
            f"complete ones of order 1 to {MAX_ORDER}, all of one: use transfinite or extruded volumes and recombine "
            "their surfaces before generate(3), or subdivide tetrahedra after it by the option "
            "Mesh.SubdivisionAlgorithm = 2, gmsh.model.mesh.refine() and setOrder(2)"
        )
    (_, _, order, nodes, coordinates, _), (element_type,) = properties[0], types
    steps = np.rint((coordinates.reshape(nodes, 3) + 1) / 2 * order)
    return element_type, order, np.lexsort(steps.T)


def _groups(model: Any, dimension: int) -> dict[str, IntArray]:
    """Name -> entities of the physical groups of a dimension; if none has a name, they are called by their number."""
    tags = [tag for _, tag in model.getPhysicalGroups(dimension)]
    names = [model.getPhysicalName(dimension, tag) for tag in tags]
    if "" in names and any(names):
        raise SceneError(
            f"physical group {tags[names.index('')]} of dimension {dimension} of the Gmsh model has no name, beside "
            f"{', '.join(filter(None, names))}: give it one of its own, since Gmsh drops a name that is given twice"
        )
    return {name or str(tag): model.getEntitiesForPhysicalGroup(dimension, tag) for name, tag in zip(names, tags)}


def _facing(
    model: Any, dimension: int, groups: dict[str, IntArray], order: int, corners: Int64Array
) -> dict[str, IntArray]:
    """Name -> rows (cell, local face or edge) of groups of entities of a dimension, 2 or 1.

    Args:
        corners: (ncells, 8), Gmsh's nodes at the cell corners.
    """
    family, local = _FAMILIES[dimension]
    k, m = local.shape
    element_type = model.mesh.getElementType(family, order)
    known = np.sort(corners[:, local], axis=2).reshape(-1, m)
    rows = {}
    for name, entities in groups.items():
        if {kind for entity in entities for kind in model.mesh.getElementTypes(dimension, entity)} - {element_type}:
            raise GeometryError(f"group {name!r} of the Gmsh model needs {family}s alone: recombine its surfaces")
        nodes = np.concatenate([model.mesh.getElementsByType(element_type, entity)[1] for entity in entities])
        wanted = np.sort(nodes.reshape(-1, (order + 1) ** dimension)[:, :m].astype(np.int64), axis=1)
        if not len(wanted):
            continue
        _, which = np.unique(np.concatenate([known, wanted]), axis=0, return_inverse=True)
        which, elements = which.ravel()[: len(known)], which.ravel()[len(known) :]
        if not np.isin(elements, which).all():
            raise SceneError(f"group {name!r} of the Gmsh model has elements that belong to no cell of any body")
        rows[name] = np.stack(np.divmod(np.flatnonzero(np.isin(which, elements)), k), axis=1)
    return rows


def _vertices(model: Any, used: Int64Array) -> dict[str, IntArray]:
    """Name -> nodes of the physical points."""
    vertices = {}
    for name, entities in _groups(model, 0).items():
        tags = np.concatenate([model.mesh.getNodes(0, entity)[0] for entity in entities]).astype(np.int64)
        if not len(tags) or not np.isin(tags, used).all():
            raise SceneError(f"point {name!r} of the Gmsh model is not a corner of the mesh of any body")
        vertices[name] = np.searchsorted(used, tags)
    return vertices
