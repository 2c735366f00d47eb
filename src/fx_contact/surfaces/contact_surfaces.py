"""Root facets of the contact surfaces: index of the contact, and side.  All is local."""

from collections.abc import Mapping, Sequence

import numpy as np

from fx_contact.geometry.lattice import root_faces
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import Contact
from fx_contact.items.ties import Tie
from fx_contact.parallel.arrays import Int8Array, Int32Array, Int64Array
from fx_contact.parallel.errors import PairingError
from fx_contact.surfaces.nonmatching import NonmatchingSurfaces


class ContactSurfaces:
    """The contact surfaces of a root mesh; the same on all ranks.

    Raises SceneError for an unknown surface, PairingError for a facet in two contacts, or on both sides of one.

    Attributes:
        contact: (ncells, 6), index of the contact of each local face, -1 for none.
        side: (ncells, 6), 0 on the first surface of a contact, 1 on the second, -1 on none.
        nonmatching: surfaces whose meshes do not match, by the index of the contact.
    """

    def __init__(
        self, mesh: RootMesh, contacts: Sequence[Contact], nonmatching: Mapping[int, NonmatchingSurfaces] = {}
    ) -> None:
        self.nonmatching = nonmatching
        shape = len(mesh.cells), 6
        self.contact: Int32Array = np.full(shape, -1, dtype=np.int32)
        self.side: Int8Array = np.full(shape, -1, dtype=np.int8)
        for index, contact in enumerate(contacts):
            for side, name in enumerate(contact.surfaces):
                cell, face = mesh.surface(name).T
                taken = self.contact[cell, face]
                if (taken >= 0).any():
                    at = int((taken >= 0).argmax())
                    other, place = contacts[taken[at]], f"face {face[at]} of root cell {cell[at]}"
                    if taken[at] == index:
                        raise PairingError(
                            f"{place} is on both sides of {contact.name!r}; leave it out on one of them"
                        )
                    kinds = "contact pairs or ties" if isinstance(contact, Tie) else "contact pairs"
                    raise PairingError(
                        f"{place} is in two {kinds}, {other.name!r} and {contact.name!r}; split the surface so "
                        "that each facet is in one"
                    )
                self.contact[cell, face], self.side[cell, face] = index, side

    def facets(self, side: int) -> Int64Array:
        """All root facets (n, 2) on one side, as (root cell, local face)."""
        return np.argwhere(self.side == side)

    def faces(self, cell: Int32Array, level: Int8Array, anchor: Int32Array) -> tuple[Int64Array, Int64Array]:
        """Faces of leaves on contact surfaces: indices (m,) of the leaves and local faces (m,), by leaf, then face."""
        leaf, face = np.nonzero(root_faces(anchor, level) & (self.contact[cell] >= 0))
        return leaf, face

    @property
    def _faced(self) -> dict[int, tuple[tuple[str, ...], tuple[float, float, float] | None]]:
        """First and second surfaces whose meshes do not match, and in which direction they face each other."""
        return {i: (one.contact.surfaces, one.contact.direction) for i, one in self.nonmatching.items()}

    def same(self, other: "ContactSurfaces") -> bool:
        """True if both have the same facets, contacts and sides."""
        return (
            self._faced == other._faced
            and np.array_equal(self.contact, other.contact)
            and np.array_equal(self.side, other.side)
        )
