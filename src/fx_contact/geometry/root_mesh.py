"""Root mesh: coarse curved hexahedra with named bodies, surfaces, curves and vertices, the same on every rank."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Self

import numpy as np
from dolfinx.mesh import Mesh, MeshTags
from mpi4py import MPI

from fx_contact.geometry.body_cut import cut_bodies
from fx_contact.geometry.dolfinx_mesh import gathered_arrays
from fx_contact.geometry.hexahedral_mesh import HexahedralMesh
from fx_contact.geometry.root_mesh_checks import check_mesh, take_arrays
from fx_contact.parallel.arrays import IntArray
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_comm, check_flag


@dataclass(frozen=True, eq=False, repr=False)
class RootMesh(HexahedralMesh):
    """Conforming mesh of curved hexahedra of order 1 to 6, replicated on all ranks and validated when made.

    Lists may be given for arrays and tuples.  Attributes are frozen; `dataclasses.replace` makes another mesh.

    Attributes:
        points: (npoints, 3), node positions [m].
        cells: (ncells, (p+1)^3), nodes of each cell in tensor order, x fastest (`hexahedron.grid_points`), equispaced
            in the reference cell.
        bodies: their names.
        body: (ncells,), index into `bodies`.
        surfaces: name -> (n, 2), exterior facets as (root cell, local face).
        vertices: name -> (n,), nodes at cell corners.
        curves: name -> (n, 2), edges as (root cell, local edge).
        parts: name -> (n,), cells of a part of a body, which may have a material of its own.

    Raises:
        GeometryError: an inverted or degenerate cell, an order above 6, two cells that do not meet face to face.
        SceneError: a cell without body, two bodies with common nodes, a surface facet that is not on the boundary, a
            cell in two parts, a part of two bodies.
    """

    def __post_init__(self) -> None:
        take_arrays(self)
        check_mesh(self)

    def __repr__(self) -> str:
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        box = " x ".join(f"[{a:.5g}, {b:.5g}]" for a, b in zip(low, high))
        cells = np.bincount(self.body, minlength=len(self.bodies))
        lists = {"bodies (cells)": [f"{name!r} ({count:,})" for name, count in zip(self.bodies, cells)]}
        groups: dict[str, Mapping[str, IntArray]]
        groups = {
            "parts (cells)": self.parts,
            "surfaces (facets)": self.surfaces,
            "curves (edges)": self.curves,
            "vertices (nodes)": self.vertices,
        }
        for title, group in groups.items():
            lists[title] = [f"{name!r} ({len(rows):,})" for name, rows in group.items()]
        return summary(f"root mesh of {len(self.cells):,} hexahedra of order {self.order} in {box}", lists)

    @classmethod
    @collective("comm")
    def from_dolfinx(
        cls,
        mesh: Mesh,
        cell_tags: MeshTags | None,
        facet_tags: MeshTags,
        bodies: Mapping[int, str],
        surfaces: Mapping[int, str],
        comm: MPI.Intracomm = MPI.COMM_WORLD,
        parts: Mapping[int, str] | None = None,
        *,
        split: bool = False,
    ) -> Self:
        """Root mesh from a dolfinx mesh of hexahedra, with cells and nodes in the order of the mesh's input.

        Collective on comm.

        Args:
            mesh: hexahedra of order 1 to 6.
            cell_tags: body of each cell; None if there is one body.
            facet_tags: surface of each facet; those with tags that are not in `surfaces` belong to none.
            bodies: tag -> name of a body; several tags may have the same name.
            surfaces: tag -> name of a surface; several tags may have the same name.
            parts: tag, among those of `bodies`, -> name of a part of the body; None: bodies have no parts.
            split: bodies share nodes and are cut apart, with surfaces in between as of `cut_bodies`.

        Raises:
            GeometryError: cells that are not complete hexahedra in 3D, or as `RootMesh`.
            SceneError: no mesh or tags of dolfinx, tags of other entities or of another mesh, no dicts of tag -> name,
                a cell without body, another communicator, or as `RootMesh`.
        """
        check_comm(comm)
        with together(comm):
            check_flag("`split`", split)
        arrays = gathered_arrays(comm, mesh, cell_tags, facet_tags, bodies, surfaces, {} if parts is None else parts)
        with together(comm):
            return cls(**(cut_bodies(arrays) if split else arrays))


def summary(head: str, lists: Mapping[str, Sequence[str]]) -> str:
    """A head and the lists that are not empty, wrapped, for `repr`."""
    texts = [f"{title}: {', '.join(items)}" for title, items in lists.items() if items]
    return "\n".join([head, *(fill(text, 110, initial_indent="  ", subsequent_indent="    ") for text in texts)])
