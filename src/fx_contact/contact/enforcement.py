"""How closed pairs are kept from overlapping: the methods by name, and their algebra on the conforming unknowns.

With B the jump of the displacement across the node pairs along their normals and D their initial gaps, closed pairs
have B u = D.  A penalty lets them overlap by what their force takes (1); an augmented Lagrangian adds the force that is
missing (J. C. Simo, T. A. Laursen, Comput. Struct. 42(1), 1992); elimination holds them exactly.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np
from dolfinx.la import InsertMode, vector
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import csr_matrix

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_name, check_number

#: The methods, the default first.
METHODS = ("exact", "augmented-lagrangian", "penalty")

#: The factor of the penalty where none is given.
FACTOR = 100.0
#: The gap tolerance of the augmented Lagrangian where none is given.
GAP_TOLERANCE = 1e-6
#: The least and the largest: beside the bodies softer ones are nothing, and the overlaps of stiffer ones are rounding.
SOFTEST, STIFFEST = 1e-3, 1e12
#: The factor of the springs that a matrix has for pairs that are held otherwise: with softer ones its preconditioner
#: knows too little of contact, stiffer ones couple directions where normals lie along no axis, unseen by BoomerAMG.
HELD = 10.0
#: Factor above which a penalty's springs stay beside the matrix, and closed pairs are held: up to here the matrix that
#: has them is as easy to precondition, but where normals lie along no axis.
STIFF = 2 * FACTOR


@dataclass(frozen=True)
class Enforcement:
    """How penetration is resisted.

    Attributes:
        method: "exact": closed pairs are eliminated, no penetration, the contact force is the residual;
            "augmented-lagrangian": forces are added to the penalty's until the penetration is below `gap_tolerance`;
            "penalty": the force is k_N times the penetration, as in equation (1).
        factor: c of the surface stiffness c E*/h [-], consistent under refinement, h the size of the facet; None: 100.
        node_stiffness: k_N [N/m], the same for every node pair as in equation (1), instead of a factor.
        gap_tolerance: largest penetration that the augmented Lagrangian leaves, relative to the approach of the bodies
            [-]: to the energy over the contact force, to the largest displacement, and to how far a punch with the
            force and area of the contact pair would come.

    Raises:
        SceneError: an unknown method, a value that is not positive, a penalty or a gap tolerance where the method takes
            none, a factor and a node_stiffness, a factor that is not between `SOFTEST` and `STIFFEST`, a gap_tolerance
            that is not below 1.
    """

    method: str = METHODS[0]
    factor: float | None = None
    node_stiffness: float | None = None
    gap_tolerance: float = GAP_TOLERANCE

    def __post_init__(self):
        check_name("enforcement", self.method, METHODS)
        for name in ("factor", "node_stiffness", "gap_tolerance"):
            value = getattr(self, name)
            if value is None and name != "gap_tolerance":
                continue
            object.__setattr__(self, name, check_number(f"the penalty {name}", value, positive=True))
        given = [name for name in ("factor", "node_stiffness") if getattr(self, name) is not None]
        if given and self.method == "exact":
            raise SceneError(
                f"the enforcement 'exact' takes no penalty {given[0]}; the methods 'penalty' and others do"
            )
        if not SOFTEST <= (self.factor or FACTOR) <= STIFFEST:
            raise SceneError(
                f"a penalty factor must lie between {SOFTEST:g} and {STIFFEST:g}, got {self.factor:g}: softer ones let "
                "bodies through each other, the overlaps of stiffer ones are rounding; "
                f"{FACTOR:g} is enough, and the enforcement 'exact' needs none"
            )
        if len(given) == 2:
            raise SceneError("a penalty has a factor or a node_stiffness, not both")
        if self.gap_tolerance != GAP_TOLERANCE and self.method != "augmented-lagrangian":
            raise SceneError(
                f"the enforcement {self.method!r} takes no gap_tolerance; 'augmented-lagrangian' does, whose overlaps "
                "become smaller with each augmentation"
            )
        if self.gap_tolerance >= 1:
            raise SceneError(
                f"gap_tolerance is relative to the approach and must be below 1, got {self.gap_tolerance:g}: "
                f"{GAP_TOLERANCE:g} is the default"
            )

    @property
    def springs(self):
        """The factor of the springs between the pairs, those in the matrix of exact contact too [-].  Local."""
        return self.factor or (HELD if self.method == "exact" else FACTOR)


class PairRows:
    """A matrix with a row for each node pair, whose entries are at the two vertices of the pair.

    Collective on the prolongation's comm.

    Args:
        pairs: NodePairs.
        rows: two (n, 3) float64, the entries at the first and at the second vertex.
    """

    def __init__(self, pairs, rows):
        self._prolongation = pairs.prolongation
        # The touched unknowns alone, so that a product costs nothing but for the pairs.
        dofs = np.concatenate([3 * place[:, None] + np.arange(3) for place in (pairs.first, pairs.second)], axis=1)
        self._dofs, columns = np.unique(dofs, return_inverse=True)
        entries, indptr = np.concatenate(rows, axis=1).ravel(), np.arange(0, dofs.size + 1, 6)
        self._matrix = csr_matrix((entries, columns.ravel(), indptr), shape=(len(pairs), len(self._dofs)))
        self._transposed = self._matrix.T.tocsr()
        away = bool((self._dofs >= 3 * self._prolongation.owned).any())
        self._local = not self._prolongation.comm.allreduce(away, op=MPI.LOR)

    def times(self, u):
        """The product with conforming values.

        Collective.

        Args:
            u: (owned, 3) float64.

        Returns:
            (n,) float64.
        """
        u = u if self._local else self._prolongation.ghosted(u)
        return self._matrix @ u.reshape(-1)[self._dofs]

    def add_transposed(self, values, y):
        """Add the product of the transpose with values of the pairs to y.

        Collective.

        Args:
            values: (n,) float64.
            y: (owned, 3) float64, contiguous; changed in place.
        """
        if self._local:
            y.reshape(-1)[self._dofs] += self._transposed @ values
            return
        result = vector(self._prolongation.index_map, 3)
        result.array[self._dofs] = self._transposed @ values
        result.scatter_reverse(InsertMode.add)
        y += result.array[: y.size].reshape(-1, 3)


class Jump:
    """B on the components that no condition prescribes, and D less what the prescribed ones contribute.

    Collective on the prolongation's comm.

    Args:
        pairs: NodePairs.
        prescribed: (owned, 3) float64, prescribed displacements [m], NaN where free.

    Attributes:
        pairs: as given.
        rows: two (n, 3) float64, the entries of B at the vertices of each pair [-].
        matrix: PairRows of B.
        gap: (n,) float64 [m].
        movable: (n,) bool, where conditions leave the jump free.
    """

    #: Components of unit normals up to this one are rounding.
    _ROUNDING = 1e-8

    def __init__(self, pairs, prescribed):
        self.pairs = pairs
        known = pairs.prolongation.ghosted(prescribed)
        free, known = np.isnan(known), np.nan_to_num(known)
        across = np.abs(pairs.normal) > self._ROUNDING
        self.rows = [
            np.where(free[place] & across, sign * pairs.normal, 0.0)
            for place, sign in ((pairs.first, 1.0), (pairs.second, -1.0))
        ]
        self.matrix = PairRows(pairs, self.rows)
        self.movable = np.logical_or(*(row.any(axis=1) for row in self.rows))
        self.gap = pairs.gap - np.einsum("ni,ni->n", pairs.normal, known[pairs.first] - known[pairs.second])

    def with_gap(self, gap):
        """The same across other gaps: Jump.  Local.

        Args:
            gap: (n,) float64, less what prescribed components contribute [m].
        """
        other = copy(self)
        other.gap = gap
        return other


class Springs:
    """B^T k B beside a matrix, of any sign.

    Collective on the prolongation's comm.

    Args:
        jump: Jump.
        stiffness: (n,) float64, k [N/m].
    """

    def __init__(self, jump, stiffness):
        self._jump, self._stiffness = jump, stiffness

    def add_product(self, u, y):
        """y := y + B^T k B u; (owned, 3) float64, y contiguous.  Collective."""
        self._jump.matrix.add_transposed(self._stiffness * self._jump.matrix.times(u), y)

    def add_force(self, u, y):
        """y := y + B^T k (B u - D), without the rounding of k B u and k D; as in `add_product`.  Collective."""
        penetration = self._jump.matrix.times(u) - self._jump.gap
        self._jump.matrix.add_transposed(self._stiffness * penetration, y)


class PenaltyTerm:
    """B^T k B of the active pairs, in a matrix or beside it.

    Args:
        jump: Jump.
        stiffness: (n,) float64, k of each pair; None: k_N of the penalty [N/m].
    """

    def __init__(self, jump, stiffness=None):
        self._jump = jump
        self._stiffness = jump.pairs.stiffness if stiffness is None else stiffness

    def reserve(self, matrix):
        """Make room in a matrix for the blocks that couple the two vertices of every pair.  Local."""
        pairs = self._jump.pairs
        self._add(matrix, np.arange(len(pairs)), np.zeros(len(pairs)))

    def change(self, matrix, before, after):
        """Turn the term of one active set into that of another.

        Collective.

        Args:
            matrix: PETSc Mat that has the term of `before`.
            before, after: (n,) bool, active pairs.
        """
        changed = np.flatnonzero(before != after)
        sign = np.where(after[changed], 1.0, -1.0)
        self._add(matrix, changed, sign * self._stiffness[changed])
        matrix.assemble()

    def _add(self, matrix, which, stiffness):
        pairs = self._jump.pairs
        imap = pairs.prolongation.index_map
        nodes = np.stack([pairs.first[which], pairs.second[which]], axis=1).astype(np.int32)
        nodes = imap.local_to_global(nodes.ravel()).astype(np.int32).reshape(-1, 2)
        rows = np.stack([row[which] for row in self._jump.rows], axis=1)
        blocks = np.einsum("n,nai,nbj->nabij", stiffness, rows, rows)
        indptr = np.arange(0, 4 * len(which) + 1, 2, dtype=np.int32)
        columns = np.repeat(nodes, 2, axis=0).ravel()
        matrix.setValuesBlockedIJV(
            indptr, columns, np.ascontiguousarray(blocks), addv=PETSc.InsertMode.ADD, rowmap=nodes.ravel()
        )

    def difference(self, active, other, known):
        """What this term of one active set has more, or less, than another term of another set.

        Collective.

        Args:
            active, known: (n,) bool, active pairs of this term and of the other one.
            other: PenaltyTerm.

        Returns:
            Springs; None where there is no difference.
        """
        stiffness = active * self._stiffness - known * other._stiffness
        some = self._jump.pairs.prolongation.comm.allreduce(bool(stiffness.any()), op=MPI.LOR)
        return Springs(self._jump, stiffness) if some else None

    def right_hand_side(self, active, forces=0.0):
        """B^T (k D - f).

        Collective.

        Args:
            active: (n,) bool, the pairs that have k.
            forces: (n,) float64, f that act whatever the penetration, or 0 [N].

        Returns:
            (owned, 3) float64 [N].
        """
        result = np.zeros((self._jump.pairs.prolongation.owned, 3))
        self._jump.matrix.add_transposed(active * self._stiffness * self._jump.gap - forces, result)
        return result

    def force(self, u):
        """k (B u - D), the force of every pair that the penalty alone would exert.

        Collective.

        Args:
            u: (owned, 3) float64 [m].

        Returns:
            (n,) float64, compression positive [N].
        """
        return self._stiffness * self._jump.pairs.penetration(u)
