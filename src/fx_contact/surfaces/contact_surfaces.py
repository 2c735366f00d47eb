"""Root facets of the contact surfaces, by contact and side; a facet may be in several contacts.  All is local."""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.contact import Contact
from fx_contact.parallel.arrays import BoolArray, Int32Array
from fx_contact.parallel.errors import PairingError
from fx_contact.surfaces.nonmatching import NonmatchingSurfaces


def preceding(contacts: Sequence[Contact], index: int) -> list[int]:
    """Contacts before one, by their indices: ties precede."""
    order = sorted(range(len(contacts)), key=lambda other: (not contacts[other].EQUALITY, other))
    return order[: order.index(index)]


class ContactSurfaces:
    """The contact surfaces of a root mesh; the same on all ranks.

    Raises SceneError for an unknown surface, PairingError for a facet on both sides of a contact, or a contact of
    facets that one before it joins.

    Attributes:
        table: (k, 4), facets as (index of the contact, side, root cell, local face), side 0 the first surface; by
            index, then side.
        nonmatching: surfaces whose meshes do not match, by the index of the contact.
    """

    def __init__(
        self, mesh: RootMesh, contacts: Sequence[Contact], nonmatching: Mapping[int, NonmatchingSurfaces] = {}
    ) -> None:
        self.nonmatching, self._shape = nonmatching, (len(mesh.cells), 6)
        parts = list[Int32Array]()
        for index, contact in enumerate(contacts):
            for side, name in enumerate(contact.surfaces):
                facets = mesh.surface(name)
                parts.append(np.insert(facets, 0, np.tile([[index], [side]], len(facets)), axis=1))
        self.table: Int32Array = np.concatenate([np.empty((0, 4), dtype=np.int32), *parts])
        for index, contact in enumerate(contacts):
            self._check_inside(contacts, index)
            both = np.argwhere(self.on(index, 0) & self.on(index, 1)).astype(np.int32)
            if len(both):
                raise PairingError(
                    f"{len(both)} facets are on both sides of {contact.label}, the first near {mesh.middle(both)}: "
                    "leave them out on one of them"
                )

    def _check_inside(self, contacts: Sequence[Contact], index: int) -> None:
        """Raises PairingError for a contact of two surfaces inside one that precedes it."""
        ours = [self.on(index, side) for side in (0, 1)]
        for other in preceding(contacts, index) if len(contacts[index].surfaces) == 2 else ():
            theirs = [self.on(other, side) for side in (0, 1)]
            if any(not (ours[0] & ~one).any() and not (ours[1] & ~two).any() for one, two in (theirs, theirs[::-1])):
                raise PairingError(
                    f"{contacts[other].label} joins all facets of {contacts[index].label}: leave one of them out"
                )

    def on(self, contacts: npt.ArrayLike, sides: npt.ArrayLike = (0, 1)) -> BoolArray:
        """(ncells, 6), faces on some sides of some contacts, by index."""
        index, side, cell, face = self.table.T
        some, result = np.isin(index, contacts) & np.isin(side, sides), np.zeros(self._shape, dtype=bool)
        result[cell[some], face[some]] = True
        return result

    @cached_property
    def every(self) -> BoolArray:
        """(ncells, 6), faces in any contact."""
        return self.on(self.table[:, 0])

    @property
    def _faced(self) -> dict[int, tuple[tuple[str, ...], tuple[float, float, float] | None]]:
        """First and second surfaces whose meshes do not match, and in which direction they face each other."""
        return {i: (one.contact.surfaces, one.contact.direction) for i, one in self.nonmatching.items()}

    def same(self, other: "ContactSurfaces") -> bool:
        """True if both have the same facets, contacts and sides."""
        return self._faced == other._faced and np.array_equal(self.table, other.table)
