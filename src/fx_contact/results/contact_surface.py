"""The contact surfaces for ParaView: VTU files of curved facets, a piece a rank, and a PVTU file.

Written by hand: dolfinx's writers take functions on a mesh, and facets with hanging nodes are none; VTK's Python module
would be one more thing that the main job needs.
"""

import base64
import shutil
from xml.sax.saxutils import quoteattr

import numpy as np

from fx_contact.adaptive.step import check_step
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.parallel.agreement import shared_path
from fx_contact.parallel.errors import OutputError
from fx_contact.parallel.mpi import together
from fx_contact.problem import hexahedron

_LAGRANGE_QUADRILATERAL = 70
_TYPES = {"f": "Float64", "i": "Int64", "u": "UInt8"}


def write_contact(step, folder):
    """Write both sides of the contact surfaces: `contact.pvtu`, whose pieces are in the folder `contact`.

    Collective on the step's communicator.  Facets have the geometry order of the leaves.  Point fields: displacement
    [m]; pressure, the force of a node pair over its area [Pa]; closed, 1 for a closed pair and 0 for an open one; open
    gap [m].  Cell fields: body, as numbered in the root mesh, and level, rank, indicator [J^(1/2)] of the leaf behind
    the facet.

    Args:
        step: Step with contact.
        folder: for the files, which are replaced if they are there.

    Raises:
        SceneError: no step, or one without contact.
        OutputError: a file cannot be written.
    """
    check_step(step, contact=True)
    comm = step.forest.comm
    folder = shared_path(comm, "the output folder", folder, OutputError)
    points, point_fields, cell_fields = contact_facets(step)
    piece = _piece(points, point_fields, cell_fields)
    counts = comm.allgather(len(points))
    fields = [
        (kind, name, f) for kind, of in (("Point", point_fields), ("Cell", cell_fields)) for name, f in of.items()
    ]
    with together(comm):
        if comm.rank == 0:
            _writing(folder / "contact.pvtu", lambda path: _begin(path, fields, counts))
    with together(comm):
        if len(points):
            _writing(folder / "contact" / f"{comm.rank}.vtu", lambda path: path.write_text(piece))


def contact_facets(step):
    """Both sides of the contact surfaces, facet by facet.

    Collective on the step's communicator.

    Args:
        step: Step with contact, its leaves of geometry order q.

    Returns:
        (n, (q+1)^2, 3) float64 nodes of this rank's facets, first tangent fastest [m]; two dicts of fields by name,
        as `write_contact` has them: (n, (q+1)^2, k) at the nodes, and (n,).
    """
    forest, order = step.forest, step.leaf_mesh.order
    leaf, face = forest.contact_faces()
    rows = np.arange(len(leaf))
    points = leaf_positions(forest, leaf, order)[rows[:, None], hexahedron.face_nodes(order)[face]]
    space = step.elasticity.prolongation.space
    along = hexahedron.lagrange(space.degree, np.linspace(0, 1, order + 1))  # (order + 1, p + 1)
    nodal = np.kron(along, along) @ _nodal_values(step)[space.on_faces(leaf, face)]
    indicator = np.empty(len(forest))
    indicator[step.leaf_mesh.leaf] = step.estimate.error
    return (
        points,
        {
            "displacement": nodal[..., :3],
            "pressure": nodal[..., 3:4],
            "closed": nodal[..., 4:5],
            "gap": nodal[..., 5:],
        },
        {
            "body": forest.mesh.body[forest.cell[leaf]].astype(np.int64),
            "level": forest.level[leaf].astype(np.int64),
            "rank": np.full(len(leaf), forest.comm.rank, dtype=np.int64),
            "indicator": indicator[leaf],
        },
    )


def _nodal_values(step):
    """Displacement, pressure, status and gap at this rank's nodes, the last three zero off the contact: (m, 6)."""
    pairs, contact, prolongation = step.pairs, step.solution, step.elasticity.prolongation
    area = pairs.area
    rows = np.stack([contact.force, contact.active * area, -contact.penetration * area, area], axis=1)
    sums = np.zeros((prolongation.index_map.size_local + prolongation.index_map.num_ghosts, 4))
    blocks = pairs.blocks  # a node where contact pairs of the scene meet is in several rows
    weight = np.linalg.norm(blocks.values, axis=1)[:, None]
    np.add.at(sums, blocks.node, weight * rows[blocks.row])
    sums = prolongation.summed(sums)
    means = sums[:, :3] / np.where(sums[:, 3:] > 0, sums[:, 3:], 1.0)
    return prolongation.prolong(np.concatenate([contact.displacement, means], axis=1))


def _begin(path, fields, counts):
    """The file that names the pieces, and an empty folder for them."""
    shutil.rmtree(path.parent / "contact", ignore_errors=True)
    (path.parent / "contact").mkdir(parents=True)
    lines = [f'<PPoints>{_declared("", np.empty((0, 0, 3)), "P")}</PPoints>']
    for kind in ("Point", "Cell"):
        arrays = "".join(_declared(name, field, "P") for of, name, field in fields if of == kind)
        lines.append(f"<P{kind}Data>{arrays}</P{kind}Data>")
    lines += [f'<Piece Source="contact/{rank}.vtu"/>' for rank, count in enumerate(counts) if count]
    path.write_text(_file("PUnstructuredGrid", "\n".join(lines), ' GhostLevel="0"'))


def _piece(points, point_fields, cell_fields):
    """The text of a VTU file of facets."""
    n, nodes = points.shape[:2]
    turn = _vtk_order(round(nodes**0.5) - 1)
    at_points = "".join(_array(name, field[:, turn]) for name, field in point_fields.items())
    at_cells = "".join(_array(name, field) for name, field in cell_fields.items())
    cells = {
        "connectivity": np.arange(n * nodes),
        "offsets": nodes * np.arange(1, n + 1),
        "types": np.full(n, _LAGRANGE_QUADRILATERAL, dtype=np.uint8),
    }
    body = (
        f'<Piece NumberOfPoints="{n * nodes}" NumberOfCells="{n}">\n<Points>{_array("", points[:, turn])}</Points>\n'
        f'<Cells>{"".join(_array(*item) for item in cells.items())}</Cells>\n'
        f"<PointData>{at_points}</PointData>\n<CellData>{at_cells}</CellData>\n</Piece>"
    )
    return _file("UnstructuredGrid", body)


def _vtk_order(order):
    """Nodes of a facet, first tangent fastest, as VTK's Lagrange quadrilateral has them: corners, edges, inside."""
    n, inner = order + 1, np.arange(1, order)
    corners = [0, order, n * n - 1, order * n]
    edges = [inner, inner * n + order, order * n + inner, inner * n]
    return np.concatenate([corners, *edges, (inner[:, None] * n + inner).ravel()]).astype(int)


def _file(kind, body, more=""):
    return (
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f"<{kind}{more}>\n{body}\n</{kind}>\n</VTKFile>\n"
    )


def _declared(name, field, prefix=""):
    """The head of a data array, whose values are to follow unless it is only declared."""
    name = f" Name={quoteattr(name)}" if name else ""
    width = field.shape[2] if field.ndim == 3 else 1
    head = f'<{prefix}DataArray type="{_TYPES[field.dtype.kind]}"{name} NumberOfComponents="{width}"'
    return head + ("/>" if prefix else ' format="binary">')


def _array(name, field):
    """A data array with its values, which follow the number of their bytes in one base64 text."""
    data = np.ascontiguousarray(field, dtype=field.dtype.newbyteorder("<")).tobytes()
    text = base64.b64encode(np.uint64(len(data)).astype("<u8").tobytes() + data).decode()
    return _declared(name, field) + text + "</DataArray>"


def _writing(path, write):
    """Write a file, and say what is wrong if it cannot be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path)
    except OSError as error:
        raise OutputError(f"cannot write {str(path)!r}: {error.strerror}; name another output folder") from None
