"""Root meshes from Gmsh: the current model, or a .msh file, of any order up to 6.

Physical groups give the names: volumes are bodies; surfaces, curves and points are surfaces, curves and vertices.  The
order of Gmsh's nodes follows from the local coordinates that Gmsh reports.
"""

import numpy as np

from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.errors import GeometryError, SceneError
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_comm, shown
from fx_contact.problem import hexahedron
from fx_contact.problem.root_mesh import RootMesh
from fx_contact.problem.root_mesh_checks import MAX_ORDER


def root_mesh_from_gmsh(comm, build):
    """Build a model with Gmsh on rank 0 and share its mesh.

    Collective on comm.

    Args:
        comm: MPI communicator.
        build: function of no argument, called on rank 0 with Gmsh initialised and silent; it leaves a meshed current
            model.  Other ranks may give None.

    Returns:
        RootMesh, the same on all ranks.

    Raises:
        GeometryError, SceneError: as `RootMesh`; or cells that are not hexahedra, an order above 6, a function that
            ends the program.
    """
    check_comm(comm)
    parts = None
    with together(comm):
        if comm.rank == 0:
            if not callable(build):
                raise SceneError(f"what builds the Gmsh model must be a function of no argument, got {shown(build)}")
            parts = _with_gmsh(build)
    parts = comm.bcast(parts, root=0)
    with together(comm):
        return RootMesh(**parts)


def root_mesh_from_file(comm, path):
    """Read a .msh file on rank 0 and share its mesh.

    Collective on comm.

    Args:
        comm: MPI communicator.
        path: of a .msh file, with hexahedra and physical groups.

    Returns:
        RootMesh, the same on all ranks.

    Raises:
        SceneError: there is no such file, Gmsh cannot read it, or a name in it is not in UTF-8.
        GeometryError: as `root_mesh_from_gmsh`.
    """
    check_comm(comm)
    path = shared_path(comm, "a mesh file", path)

    def read():
        """The file becomes Gmsh's current model."""
        import gmsh

        _check_mesh_file(path)
        try:
            gmsh.open(str(path))
        except Exception as error:
            reason = str(error).strip() or "its numbers make no sense"
            raise SceneError(f"Gmsh cannot read {str(path)!r}: {reason}; is it whole? write it again") from None

    return root_mesh_from_gmsh(comm, read)


def _check_mesh_file(path):
    """Raises SceneError for what is no mesh file: Gmsh begins a new model, or runs it as a script.  Local."""
    try:
        if not path.is_file():
            raise SceneError(f"there is no mesh file {str(path)!r}: give a .msh file of Gmsh")
        with path.open("rb") as file:
            if file.read(1) != b"$":
                raise SceneError(
                    f"{str(path)!r} is no mesh file of Gmsh: it does not begin with $MeshFormat; for a script use "
                    "root_mesh_from_gmsh"
                )
    except OSError as error:
        raise SceneError(f"cannot read the mesh file {str(path)!r}: {error.strerror}") from None


def _with_gmsh(build):
    import gmsh

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    try:
        build()
        return _read_model(gmsh.model)
    except SystemExit as error:  # it would end this rank alone
        raise SceneError(
            f"what builds the Gmsh model ends the program, by SystemExit: {error}; let it raise another error"
        ) from error
    finally:
        if ours:
            gmsh.finalize()


def _read_model(model):
    """Arguments of RootMesh from the current Gmsh model."""
    order, element_type = _hexahedron(model)
    tags, points = _nodes(model)
    bodies, nodes = _bodies(model), (order + 1) ** 3
    groups = [
        np.concatenate([_elements(model, element_type, 3, entity) for entity in entities])
        for entities in bodies.values()
    ]
    body = np.repeat(np.arange(len(groups), dtype=np.int32), [len(group) // nodes for group in groups])
    used, cells = np.unique(np.concatenate(groups), return_inverse=True)
    cells = cells.reshape(-1, nodes)[:, _tensor_order(model, element_type, order)]
    corners = used[cells[:, hexahedron.corner_nodes(order)]]
    return {
        "points": points[np.searchsorted(tags, used)],
        "cells": cells,
        "bodies": tuple(bodies),
        "body": body,
        "surfaces": _facing(model, 2, "quadrangles", corners, hexahedron.FACE_CORNERS),
        "curves": _facing(model, 1, "lines", corners, hexahedron.EDGE_CORNERS),
        "vertices": _vertices(model, used),
    }


def _bodies(model):
    """Name -> volumes of each body; SceneError unless each volume belongs to one body."""
    bodies = _groups(model, 3)
    volumes, count = np.unique([tag for tags in bodies.values() for tag in tags], return_counts=True)
    nameless = {tag for _, tag in model.getEntities(3)} - set(volumes)
    if nameless:
        raise SceneError(
            f"volumes {sorted(nameless)} of the Gmsh model are in no physical group; give each body a physical group "
            "with a name, or remove the volumes"
        )
    if (count > 1).any():
        raise SceneError(
            f"volumes {volumes[count > 1].tolist()} of the Gmsh model are in more than one physical group: a volume "
            "belongs to one body"
        )
    return bodies


def _hexahedron(model):
    """Order and Gmsh type of the volume elements."""
    types = model.mesh.getElementTypes(3)
    if not len(types):
        raise GeometryError("the Gmsh model has no volume mesh; call gmsh.model.mesh.generate(3)")
    properties = [model.mesh.getElementProperties(t) for t in types]
    for name, _, order, nodes, *_ in properties:
        if "hexahedron" not in name.lower():
            raise GeometryError(
                f"the mesh has cells of type {name!r}; only hexahedra can be refined: use transfinite volumes and "
                "recombine their surfaces"
            )
        if order > MAX_ORDER or nodes != (order + 1) ** 3:
            raise GeometryError(
                f"the mesh has cells of type {name!r}; only complete hexahedra of order 1 to {MAX_ORDER} are supported"
            )
    if len(types) > 1:
        raise GeometryError(f"the mesh mixes {', '.join(repr(p[0]) for p in properties)}; use one order")
    return properties[0][2], types[0]


def _tensor_order(model, element_type, order):
    """Gmsh's local number of each node in tensor order."""
    _, dimension, _, nodes, coordinates, _ = model.mesh.getElementProperties(element_type)
    ijk = np.rint((np.reshape(coordinates, (nodes, dimension)) + 1) / 2 * order).astype(np.int64)
    return np.argsort(ijk @ [1, order + 1, (order + 1) ** 2])


def _nodes(model):
    tags, points, _ = model.mesh.getNodes()
    order = np.argsort(tags)
    return tags[order].astype(np.int64), points.reshape(-1, 3)[order]


def _groups(model, dimension):
    """Name -> entities of the physical groups of a dimension; unnamed ones are called by their number.

    Gmsh takes a name away from a group where another one of the dimension has it.
    """
    groups = {}
    for _, tag in model.getPhysicalGroups(dimension):
        try:
            name = model.getPhysicalName(dimension, tag) or str(tag)
        except UnicodeDecodeError as error:
            raise SceneError(
                f"the name {error.object!r} of a physical group is not in UTF-8: save the file in this encoding, or "
                "use letters without accents"
            ) from None
        groups[name] = model.getEntitiesForPhysicalGroup(dimension, tag)
    return groups


def _elements(model, element_type, dimension, entity):
    types, _, nodes = model.mesh.getElements(dimension, entity)
    found = [n for t, n in zip(types, nodes) if t == element_type]
    return np.concatenate([np.empty(0, np.int64), *found]).astype(np.int64)


def _facing(model, dimension, kind, corners, local):
    """Name -> rows (cell, local face or edge) of the physical groups of a dimension, 2 or 1.

    Args:
        model: Gmsh model.
        dimension: of the groups.
        kind: what to call their elements.
        corners: (ncells, 8) int64, Gmsh's nodes at the cell corners.
        local: (k, m) int, corners of the local faces or edges.
    """
    k, ncorners = local.shape
    distinct, example = np.unique(np.sort(corners[:, local], axis=2).reshape(-1, ncorners), axis=0, return_index=True)
    groups = {}
    for name, entities in _groups(model, dimension).items():
        wanted = np.concatenate([_corner_tags(model, name, dimension, e, ncorners, kind) for e in entities])
        if not len(wanted):
            continue
        both, where = np.unique(np.concatenate([distinct, np.sort(wanted, axis=1)]), axis=0, return_inverse=True)
        where = where.ravel()
        place = np.full(len(both), -1, dtype=np.int64)
        place[where[: len(distinct)]] = example
        found = place[where[len(distinct) :]]
        if (found < 0).any():
            raise SceneError(f"group {name!r} has {kind} that belong to no cell of any body")
        groups[name] = np.stack(np.divmod(np.unique(found), k), axis=1).astype(np.int32)
    return groups


def _corner_tags(model, name, dimension, entity, ncorners, kind):
    """Corner nodes of the elements of an entity: (n, ncorners)."""
    types, _, nodes = model.mesh.getElements(dimension, entity)
    rows = [np.empty((0, ncorners), np.int64)]
    for element_type, tags in zip(types, nodes):
        what, _, _, count, _, corners = model.mesh.getElementProperties(element_type)
        if corners != ncorners:
            raise GeometryError(
                f"group {name!r} has elements of type {what!r}; recombine the surface into quadrangles"
            )
        rows.append(tags.reshape(-1, count)[:, :ncorners].astype(np.int64))
    return np.concatenate(rows)


def _vertices(model, used):
    """Name -> nodes of the physical points."""
    vertices = {}
    for name, entities in _groups(model, 0).items():
        tags = np.concatenate([model.mesh.getNodes(0, entity)[0] for entity in entities]).astype(np.int64)
        place = np.minimum(np.searchsorted(used, tags), len(used) - 1)
        vertices[name] = place[used[place] == tags]
        if len(vertices[name]) < len(tags) or not len(tags):
            raise SceneError(f"point {name!r} of the Gmsh model is not a corner of the mesh of any body")
    return vertices
