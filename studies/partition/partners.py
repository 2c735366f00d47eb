"""With how many other parts a part exchanges rows in an adaptive step: counted on one rank, for any partition.

A step of a run: leaves move from the partition before, nodes are named, hanging ones find theirs, the graph of the
leaves is made, and refinement asks around.  In each exchange a part is a partner of another
where a row goes from one to the other, an answer back.  Solver and halos are not counted here.
"""

import numpy as np
from scipy.sparse import csr_matrix

from fx_contact.fem.prolongation import _hanging_points, _masters, _points_on
from fx_contact.forest.homes import Homes
from fx_contact.geometry.lattice import MAX_LEVEL
from fx_contact.surfaces.facet_pairing import leaf_code

#: A key.
BYTES = 8


class Exchanges:
    """The exchanges of a step on one forest, whatever its parts.  Local; the forest is on one rank.

    Args:
        forest: Forest.
        prolongation: Prolongation of the forest.
        graph: Graph of its leaves.
    """

    def __init__(self, forest, prolongation, graph):
        self._forest, self._graph = forest, graph
        space = prolongation.space
        self._points = {
            "vertices": _incidence(forest.vertices.cells, forest.vertices.keys),
            "edges": _incidence(forest.edges.cells, forest.edges.keys),
            "faces": _incidence(forest.faces.cells, forest.faces.keys),
            "nodes": _incidence(space.cells, space.keys),
            **_parents(forest),
            **_hanging(space),
            "masters and facing nodes": _needed(space),
        }
        self._leaves = _facing(forest)

    def count(self, parts, part, cuts, others):
        """Partners of a partition.

        Args:
            parts: number of parts.
            part: (n,) int, part of each leaf.
            cuts: (parts - 1,) int64, of the curve, by which homes are given; None: by a hash.
            others: list of (k,) int and (k,) int parts, between which rows go in an exchange that is not by keys.

        Returns:
            dict:
            partners_max, partners_mean: partners of a part, in the exchange in which a part has the most.
            key_bytes_max: of the keys that are sent away to make nodes, edges and faces known once; sent and received
                by the part that moves most.
        """
        forest = self._forest
        homes = Homes(forest.mesh, forest.lattice, forest.pairing, cuts, parts)
        found, key_bytes = [], np.zeros(parts, dtype=np.int64)
        for of, exchanges in ((homes.of_points, self._points), (homes.of_leaves, self._leaves)):
            for name, (leaf, index, keys) in exchanges.items():
                home = of(keys)[index]
                away = home != part[leaf]
                here, home, index = part[leaf[away]].astype(np.int64), home[away], index[away]
                found.append(_partners(parts, here, home))
                if name in ("nodes", "edges", "faces"):
                    _, first = np.unique(here * len(keys) + index, return_index=True)  # a part sends a key once
                    for side in (here[first], home[first]):
                        key_bytes += BYTES * np.bincount(side, minlength=parts)
        rows, columns = part[self._graph.rows], part[self._graph.matrix.indices]
        found += [_partners(parts, *pairs) for pairs in (*others, (rows, columns))]
        most = max(found, key=np.max)
        partners = {"partners_max": int(most.max()), "partners_mean": float(most.mean())}
        return partners | {"key_bytes_max": int(key_bytes.max())}


def _partners(parts, one, other):
    """Number of other parts that each part has rows for or from: (parts,) int64."""
    one, other = one[one != other].astype(np.int64), other[one != other].astype(np.int64)
    pairs = np.unique(one * parts + other)
    one, other = np.divmod(pairs, parts)
    return np.bincount(np.unique(np.append(pairs, other * parts + one)) // parts, minlength=parts)


def _incidence(cells, keys):
    """(m,) leaves, (m,) positions of their (n, k) things among the keys, and the (l,) keys."""
    return np.repeat(np.arange(len(cells), dtype=np.int32), cells.shape[1]), cells.ravel(), keys


def _distinct(leaf, keys):
    """The same of the keys of leaves, (m,) both."""
    keys, index = np.unique(keys, return_inverse=True)
    return leaf.astype(np.int32), index.ravel(), keys


def _parents(forest):
    """What refinement and the graph of the leaves ask for: middles of edges and faces of the leaves' parents."""
    fine = np.flatnonzero(forest.level > 0)
    child = (forest.anchor[fine] >> (MAX_LEVEL + 1 - forest.level[fine].astype(np.int32))[:, None] & 1) @ [1, 2, 4]
    result = {}
    for name, steps in (("refinement", [1, 2, 4]), ("faces of parents", [3, 5, 6])):
        points = forest.corners[fine[:, None], child[:, None] ^ steps]
        result[name] = _distinct(np.repeat(fine, 3), forest.lattice.keys(forest.cell[fine], points).ravel())
    return result


def _hanging(space):
    """At degree 2, the points inside edges and faces that may hang there."""
    if space.degree == 1:
        return {}
    result = {}
    for name, dimension, entities, nodes in (
        ("points on edges", 1, space.forest.edges, space.edge_nodes),
        ("points on faces", 2, space.forest.faces, space.face_nodes),
    ):
        points, _ = _hanging_points(space.degree, dimension)
        directory, _ = _points_on(space, entities, nodes, points)
        of_entity = np.arange(len(directory.keys)).reshape(-1, len(points))
        result[name] = _incidence(of_entity[entities.cells].reshape(len(space.forest), -1), directory.keys)
    return result


def _needed(space):
    """Nodes that hold those of a leaf where they hang, directly or through others, and those that face it."""
    masters, _ = _masters(space)
    node, column = np.nonzero(masters >= 0)
    masters = space.find(masters[node, column])
    step = csr_matrix((np.ones(len(node), dtype=np.int8), (node, masters)), shape=(len(space), len(space)))
    n = len(space.forest)
    reached = csr_matrix(
        (np.ones(space.cells.size, dtype=np.int8), space.cells.ravel(), np.arange(n + 1) * space.cells.shape[1]),
        shape=(n, len(space)),
    )
    leaves, nodes = [], []
    while (reached := reached @ step).nnz:
        reached.data[:] = 1
        leaves.append(np.repeat(np.arange(n), np.diff(reached.indptr)))
        nodes.append(reached.indices)
    leaf, face = space.forest.paired_faces()
    facing = space.find(space.facing(leaf, face))
    leaves.append(np.repeat(leaf, facing.shape[1]))
    nodes.append(facing.ravel())
    return np.concatenate(leaves).astype(np.int32), np.concatenate(nodes), space.keys


def _facing(forest):
    """Leaves on paired surfaces, by their codes, those of their partners, and of their groups."""
    leaf, face = forest.paired_faces()
    codes = leaf_code(forest.cell[leaf], forest.anchor[leaf])
    partners = leaf_code(*forest.pairing.partners(forest.cell[leaf], forest.level[leaf], forest.anchor[leaf], face))
    return {
        "facing leaves": _distinct(np.tile(leaf, 2), np.concatenate([codes, partners])),
        "groups of facing leaves": _distinct(leaf, forest.representatives[leaf]),
    }
