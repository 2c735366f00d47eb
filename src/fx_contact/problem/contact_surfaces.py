"""Root facets of the contact surfaces: of which contact, and on which side.  All is local."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from fx_contact.parallel.errors import PairingError
from fx_contact.problem.contact import Contact
from fx_contact.problem.lattice import root_faces
from fx_contact.problem.root_mesh import RootMesh


class ContactSurfaces:
    """The contact surfaces of a root mesh, replicated on all ranks.  `Pairing` has those that are meshed alike.

    Args:
        mesh: RootMesh.
        contacts: of a scene.

    Attributes:
        contact: (ncells, 6) int32, index of the contact of each local face, -1 where none.
        side: (ncells, 6) int8, 0 on the first surface of a contact, 1 on the second, -1 on none.

    Raises:
        SceneError: an unknown surface.
        PairingError: a facet is in two contacts, or on both sides of one.
    """

    def __init__(self, mesh: RootMesh, contacts: Sequence[Contact]) -> None:
        shape = len(mesh.cells), 6
        self.contact = np.full(shape, -1, dtype=np.int32)
        self.side = np.full(shape, -1, dtype=np.int8)
        for index, contact in enumerate(contacts):
            for side, name in enumerate(contact.surfaces):
                cell, face = mesh.surface(name).T
                taken = self.contact[cell, face] >= 0
                if taken.any():
                    raise PairingError(
                        f"face {face[taken][0]} of root cell {cell[taken][0]} is in two contact pairs, the second one "
                        f"({', '.join(map(repr, contact.surfaces))}); split the surface so that each facet is in one"
                    )
                self.contact[cell, face], self.side[cell, face] = index, side

    def facets(self, side: int) -> npt.NDArray[np.int64]:
        """All root facets on one side: (n, 2) rows (root cell, local face)."""
        return np.argwhere(self.side == side)

    def faces(
        self, cell: npt.NDArray[np.int32], level: npt.NDArray[np.int8], anchor: npt.NDArray[np.int32]
    ) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Faces of leaves on contact surfaces.

        Args:
            cell, level, anchor: (n,), (n,), (n, 3) leaves.

        Returns:
            (m,) leaf indices and (m,) local faces, by leaf then face.
        """
        leaf, face = np.nonzero(root_faces(anchor, level) & (self.contact[cell] >= 0))
        return leaf, face

    def same(self, other: "ContactSurfaces") -> bool:
        """Whether others are of the same facets, contacts and sides."""
        return np.array_equal(self.contact, other.contact) and np.array_equal(self.side, other.side)
