"""Coarsening of a forest: leaves merged with their siblings, by the rules of refinement."""

import numpy as np
from mpi4py import MPI

from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import repartition
from fx_contact.geometry.lattice import leaf_side
from fx_contact.parallel.arrays import IntArray
from fx_contact.parallel.errors import PartitionError
from fx_contact.parallel.mpi import Directory
from fx_contact.surfaces.facet_pairing import leaf_code


def coarsened(forest: Forest, level: IntArray, kind: str = "contact-sfc") -> Forest:
    """The coarsest forest in which each leaf of `forest` has at least the given level.

    Collective on forest.comm.  It is refined from the root cells by the rules of `Forest.refined`: siblings, balance
    and partners may keep a leaf.  The levels (n,) are at most those of the leaves.  Raises SceneError for an unknown
    kind of partition, SolveError as `Forest.refined`.
    """
    comm = forest.comm
    result = Forest.of_roots(comm, forest.mesh, forest.pairing, forest.contact_surfaces)
    for depth in range(comm.allreduce(int(np.max(level, initial=0)), op=MPI.MAX)):
        side = leaf_side(np.array([depth]))
        finer = level > depth
        needed = np.unique(leaf_code(forest.cell[finer], forest.anchor[finer] // side * side))
        marked = result.level == depth
        codes = leaf_code(result.cell[marked], result.anchor[marked])
        marked[marked] = Directory(comm, codes, result.homes.of_leaves).asked(needed)
        result, _ = result.refined(marked)
        try:
            result, _ = repartition(result, None, kind)
        except PartitionError:  # still too few leaves for the ranks
            continue
    return result
