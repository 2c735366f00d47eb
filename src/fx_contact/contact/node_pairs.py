"""Node-to-node rows of B, assembled from pairs of facing leaf facets.

The node pairs of two facing facets share their area as they would share a uniform pressure.  The shares of hanging
nodes go to their masters, so that rows belong to conforming nodes and the area is kept.  A row is on the rank that owns
both nodes: B^T B needs no message (section 3 of the paper).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mpi4py import MPI

from fx_contact.contact.constraint_rows import Blocks, ConstraintRows
from fx_contact.contact.contact_facets import facet_shares, facets_of, positions_across
from fx_contact.contact.enforcement import SOFTEST, STIFFEST
from fx_contact.contact.pressure import nodal_pressure
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.mpi import Directory

#: Cosine of the angle to their mean up to which the normals of rows at one node are those of a smooth surface: 15
#: degrees, as between the facets of a circle of twelve cells and their mean normal.
_SMOOTH = 0.966


@dataclass(frozen=True, eq=False)
class NodePairs(ConstraintRows):
    """Rows of pairs of conforming nodes that face each other: B u = n . (u_first - u_second).

    Attributes:
        second: (n,) int64, the node that faces `first`, position in the prolongation's index map.
        apart: (n, 3) float64, from the first node to the second one, undeformed [m].
    """

    second: np.ndarray
    apart: np.ndarray

    @cached_property
    def blocks(self):
        """Blocks, two a pair.  Local."""
        n = len(self)
        node = np.stack([self.first, self.second], axis=1).ravel()
        values = np.stack([self.normal, -self.normal], axis=1).reshape(-1, 3)
        return Blocks(np.repeat(np.arange(n), 2), node, np.tile([0, 1], n), values)

    def pressure(self, force):
        """As `ConstraintRows.pressure`; at degree 2 force over area alternates, `nodal_pressure` does not."""
        return nodal_pressure(self, force)


def create_node_pairs(scene, forest, prolongation, enforcement):
    """Find the conforming node pairs of a forest.

    Collective on forest.comm.

    Args:
        scene: Scene.
        forest: Forest.
        prolongation: Prolongation of the forest.
        enforcement: Enforcement, for the stiffness.

    Returns:
        NodePairs, one block a contact pair of the scene.

    Raises:
        SceneError: a node_stiffness whose factor is not between `SOFTEST` and `STIFFEST`.
    """
    blocks = [_pairs_of(index, scene, forest, prolongation, enforcement) for index in range(len(scene.contact))]
    columns = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    across = columns.pop("across")
    pairs = NodePairs(prolongation=prolongation, symmetry=scene.symmetry, node_area=columns["area"], **columns)
    stiffest = forest.comm.allreduce(float(pairs.penalty_factor.max(initial=0.0)), op=MPI.MAX)
    if enforcement.node_stiffness is not None and not SOFTEST <= stiffest <= STIFFEST:
        raise SceneError(
            f"a node_stiffness of {enforcement.node_stiffness:g} is up to {stiffest:.0e} times that of the "
            f"bodies, it must be {SOFTEST:g} to {STIFFEST:g} times: softer ones let bodies through each other, the "
            "penetrations of stiffer ones are rounding; the enforcement 'exact' needs none"
        )
    return pairs if len(blocks) == 1 else _sharing(pairs, across, enforcement.node_stiffness)


def _sharing(pairs, across, node_stiffness):
    """Pairs of one node, as if they were of one contact surface: stiffness by area, and one normal on a smooth one.

    Args:
        pairs: NodePairs.
        across: (n, 3) float64, normals times areas, of both surfaces [m^2].
        node_stiffness: of the pairs of a node together, if it is given [N/m].
    """
    own = np.column_stack([pairs.stiffness, pairs.area, across])
    stiffness, area, *mean = pairs.at_first(own).T
    mean = np.stack(mean, axis=1) / np.maximum(np.linalg.norm(mean, axis=0), np.finfo(float).tiny)[:, None]
    smooth = np.einsum("ni,ni->n", mean, pairs.normal) > _SMOOTH
    normal = np.where(smooth[:, None], mean, pairs.normal)
    gap = np.einsum("ni,ni->n", normal, pairs.apart)
    stiffness = stiffness if node_stiffness is None else node_stiffness
    return replace(pairs, node_area=area, stiffness=pairs.area * stiffness / area, normal=normal, gap=gap)


def _pairs_of(index, scene, forest, prolongation, enforcement):
    """Columns of NodePairs, and those of `_sharing`, by name, for one contact pair of the scene: dict.  Collective."""
    space, (leaf, face) = prolongation.space, facets_of(index, forest)
    node, keys = space.on_faces(leaf, face), space.facing(leaf, face)
    here, there = positions_across(forest, leaf, face, space.points[leaf[:, None], space.face_nodes[face]])
    cell = forest.pairing.partner[forest.cell[leaf], face, 0]

    (area, outward), (_, inward) = (facet_shares(space, nodes, face) for nodes in (here, there))  # in the same order
    size = np.sqrt(area.sum(axis=1))
    bodies = np.stack([forest.mesh.body[forest.cell[leaf]], forest.mesh.body[cell]], axis=1)
    modulus = np.array([scene.materials[name].plane_strain_modulus for name in scene.mesh.bodies])[bodies]
    stiffness = (enforcement.penalty_factor / (1 / modulus).sum(axis=1) / size)[:, None] * area
    sums = np.zeros((len(space), 5))
    np.add.at(sums, node, np.concatenate([area[:, :, None], stiffness[:, :, None], outward + inward], axis=2))

    # A pair belongs to a rank that has a facet of it: the owner of both nodes, but where contact pairs meet.
    distinct, example = np.unique(node, return_index=True)
    conform = ~prolongation.hanging[distinct]
    distinct, example = distinct[conform], example[conform]
    _, owner = Directory(forest.comm, space.keys[distinct], forest.homes.of_points).number()
    own = owner == forest.comm.rank
    first, example = prolongation.conforming[distinct[own]].astype(np.int64), example[own]
    sums = prolongation.ghosted(prolongation.restrict(sums))
    area, stiffness, across = sums[first, 0], sums[first, 1], sums[first, 2:]
    normal = across / np.linalg.norm(across, axis=1)[:, None]
    if enforcement.node_stiffness is not None:
        stiffness = np.full(len(first), float(enforcement.node_stiffness))
    here, there = here.reshape(-1, 3)[example], there.reshape(-1, 3)[example]
    apart = there - here
    facet = example // keys.shape[1]
    return dict(
        first=first,
        second=prolongation.find(keys.ravel()[example]),
        normal=normal,
        gap=np.einsum("ni,ni->n", normal, apart),
        area=area,
        stiffness=stiffness,
        modulus=modulus[facet],
        position=here,
        bodies=bodies[facet],
        contact=np.full(len(first), index, dtype=np.int32),
        across=across,
        apart=apart,
    )
