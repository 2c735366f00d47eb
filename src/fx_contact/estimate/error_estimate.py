"""The Zienkiewicz-Zhu estimate: recovery, indicator (3), energies (4), marking (2), stop (6)."""

from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from fx_contact.fem.compilation import compiled
from fx_contact.fem.elasticity import QUADRATURE_DEGREE
from fx_contact.parallel.errors import SolveError

#: Rows and columns of the six components of a symmetric stress in recovered fields.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


#: The share of the tolerance at which the last refinement aims.
_AIM = 0.9
#: Thresholds between which it chooses, up to the largest error, and down to a part of that of criterion (2).
_THRESHOLDS, _LOWEST = 1024, 0.25
#: Error of a child relative to its parent's, where the solution is smooth: eight of them have a quarter of xi_T^2.
_CHILD = 32**-0.5
#: An estimate that sees so much of the error is taken at its word, as (6) does; one that sees less is divided by that.
ENOUGH_SEEN = 0.8
#: The part of the error that an estimate is taken to see where nothing else is known: 0.56 was seen on one and two
#: layers of tall cells between clamped ends, where stresses of neighbouring cells agree and yet are wrong.  And at
#: least: 0.43 was seen in thin plates, and refinement that changes nothing would show ever less.
UNKNOWN_SEEN, LEAST_SEEN = 0.5, 0.4
#: The least that refinement is taken to bring, so that a step that brings nothing does not mark for ever.
_LEAST_GAIN = 0.1


@dataclass(frozen=True, eq=False)
class Estimate:
    """Error and energy of a displacement field.

    Attributes:
        stress: recovered stress, a dolfinx Function of six components a vertex (`VOIGT`) [Pa].
        error: (ncells,) float64, xi_T of this rank's cells (3) [J^(1/2)].
        energy: (ncells,) float64, strain energy of this rank's cells, twice [J].
        error_global: xi of all cells (6) [J^(1/2)].
        energy_norm: omega (4) [J^(1/2)].
        cells: number of cells on all ranks.
    """

    stress: object
    error: np.ndarray
    energy: np.ndarray
    error_global: float
    energy_norm: float
    cells: int

    @property
    def relative(self):
        """xi / omega [-]."""
        return self.error_global / self.energy_norm if self.energy_norm else 0.0

    def marked(self, tolerance, comm, gain=None):
        """How often to refine each cell, by criterion (2): xi_T > e omega / sqrt(N), or as the tolerance needs it.

        Collective on comm.  Halved cells of Q1 lose three quarters of xi_T^2 where the solution is smooth.  Cells whose
        children would meet the criterion again are refined twice at once.  If a higher threshold brings the whole below
        the tolerance, only the worst cells are refined: the last step does no work that was not asked for.  If a lower
        one does, that counts: a solve on a mesh of intermediate size costs more than the cells that it would spare.

        Args:
            tolerance: prescribed accuracy e [-].
            comm: MPI communicator of the mesh's forest.
            gain: what refinement brings, relative to a smooth solution; None: that is not known, and the threshold not
                lowered [-].

        Returns:
            (ncells,) int8, 0, 1 or 2, and the expected loss of xi^2 for a gain of 1 [J].
        """
        error2, criterion = self.error**2, tolerance * self.energy_norm / np.sqrt(self.cells)
        largest = comm.allreduce(float(self.error.max(initial=0)), op=MPI.MAX)
        if largest <= criterion:
            return np.zeros(len(error2), dtype=np.int8), 0.0
        low, high = np.geomspace([_LOWEST * criterion, criterion], [criterion, largest], _THRESHOLDS // 2).T
        thresholds = np.concatenate([low[:-1], high])[::-1]
        # The first threshold, from the highest down, that a cell exceeds, and that its children would.
        once, twice = (np.searchsorted(-thresholds, -e, side="right") for e in (self.error, _CHILD * self.error))
        sums = np.stack([np.bincount(n, weights=error2, minlength=len(thresholds) + 1)[:-1] for n in (once, twice)])
        comm.Allreduce(MPI.IN_PLACE, sums, op=MPI.SUM)
        sums = np.cumsum(sums, axis=1)

        def lost(gain):
            """Loss of xi^2 with each threshold."""
            left = 1 - 0.75 * gain
            return (1 - left) * (sums[0] + left * sums[1])

        need = self.error_global**2 - (_AIM * tolerance * self.energy_norm) ** 2
        chosen = int(np.searchsorted(lost(gain or 1.0), need))
        if chosen >= (len(high) if gain is None else len(thresholds)):
            chosen = len(high) - 1
        return (once <= chosen).astype(np.int8) + (twice <= chosen), float(lost(1.0)[chosen])


@dataclass
class Gain:
    """What refinement has brought in a run: to the estimate, and to the solution against what the estimate said.

    Attributes:
        before: xi^2 of the mesh that was refined last [J].
        expected: what refining it would have taken from that, had the solution been smooth; 0: nothing is known [J].
        effectivity: xi over the true error, `LEAST_SEEN` to 1, as far as the changes of the solution show it [-].
        refined: whether the present mesh comes from refining the one before.
        compared: whether a refinement has shown what the estimate had seen: without, no mesh is fine enough.
    """

    before: float = 0.0
    expected: float = 0.0
    effectivity: float = UNKNOWN_SEEN
    refined: bool = False
    compared: bool = False

    def observe(self, error, change):
        """See how much of the error on the last mesh the estimate had caught.

        Local.  The finer solution is closest to the exact one among all on its mesh, so that squares add up (Galerkin
        orthogonality): the error on the last mesh is the change of the solution and the error that is left.  The
        estimate of what is left is taken to see as much as it did on the mesh before that, then, having learned, as
        on the last one.  Towards a singularity and on few layers of cells it sees less than all.

        Args:
            error: Estimate on the present mesh.
            change: energy norm of the difference of the solutions on this mesh and the last one, without that of mean
                volume strains, with which squares nearly add up [J^(1/2)].
        """
        if not self.refined:
            return
        self.compared = True
        for _ in range(2):
            on_last_mesh = np.hypot(change, error.error_global / self.effectivity)
            seen = float(np.sqrt(self.before) / on_last_mesh) if on_last_mesh else 1.0
            self.effectivity = min(max(seen, LEAST_SEEN), 1.0)

    @property
    def sees(self):
        """The part of the error that the estimate sees, 1 if that is enough to take it at its word [-]."""
        return 1.0 if self.effectivity >= ENOUGH_SEEN else self.effectivity

    def aim(self, error, tolerance):
        """The tolerance to refine for, or None where the prescribed one is reached, (6).

        Local.  On a first mesh the estimate may be blind, as where all vertices are held: it is refined to see.

        Args:
            error: Estimate on the present mesh.
            tolerance: prescribed accuracy e [-].
        """
        if error.relative > tolerance:
            return tolerance
        trusted = self.sees * tolerance
        return trusted if error.relative > trusted or not self.compared else None

    def marked(self, error, tolerance, comm):
        """Cells of the present mesh to refine: all of a first mesh whose estimate meets the tolerance.

        Collective on comm.

        Args:
            error: Estimate on the present mesh.
            tolerance: prescribed accuracy e [-].
            comm: MPI communicator of the mesh's forest.

        Returns:
            (ncells,) int8, how often to refine each.
        """
        gain, square = None, error.error_global**2
        tolerance, self.refined = self.aim(error, tolerance) or tolerance, True
        if not self.compared and error.relative <= tolerance:
            self.before, self.expected = square, 0.75 * square
            return np.ones(len(error.error), dtype=np.int8)
        if self.expected:
            gain = min(max((self.before - square) / self.expected, _LEAST_GAIN), 1.0)
        marked, self.expected = error.marked(tolerance, comm, gain)
        self.before = square
        return marked


class Recovery:
    """The recovery of stresses on a mesh, and what errors that shows.

    Collective.  It is a lumped L2 projection on the conforming vertices; bodies do not share vertices, so each is
    recovered by itself.

    Args:
        elasticity: Elasticity.
        shear_free: (owned, 3) bool, where the recovered shear stress on planes across an axis is zero: at a symmetry
            plane it would cancel with that of the mirrored cells.
        stages: Stages, for the times.
    """

    def __init__(self, elasticity, shear_free, stages):
        self._prolongation, self._vertex = elasticity.prolongation, elasticity.vertex_of_block
        self._shear_free, mesh, comm = shear_free, elasticity.mesh, self._prolongation.comm
        dx = ufl.Measure("dx", mesh, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        moments = fem.functionspace(mesh, ("Lagrange", 1, (7,)))
        self._recovered = fem.Function(fem.functionspace(mesh, ("Lagrange", 1, (6,))), name="stress")
        cellwise = fem.functionspace(mesh, ("DG", 0, (2,)))
        with stages("compile"):
            sigma = elasticity.stress(elasticity.u, elasticity.volume_strain)
            integrand = ufl.as_vector([*(sigma[i, j] for i, j in VOIGT), 1])
            self._moments = compiled(comm, ufl.inner(integrand, ufl.TestFunction(moments)) * dx)
            smooth = ufl.as_matrix([[self._recovered[_position(i, j)] for j in range(3)] for i in range(3)])
            both = ufl.as_vector([_energy(elasticity, smooth - sigma), _energy(elasticity, sigma)])
            self._energies = compiled(comm, ufl.inner(both, ufl.TestFunction(cellwise)) * dx)

    def estimate(self, noise=0.0):
        """Recover the stress of the elasticity's displacement `u`, and estimate its error.

        Collective.

        Args:
            noise: energy norm below which a displacement field is taken for a rigid motion, without error [J^(1/2)].

        Returns:
            Estimate.

        Raises:
            SolveError: the energy is not a finite number.
        """
        prolongation = self._prolongation
        local = np.empty((len(prolongation.vertices), 7))
        local[self._vertex] = fem.assemble_vector(self._moments).array.reshape(-1, 7)
        sums = prolongation.restrict(local)
        for component, (i, j) in enumerate(VOIGT):
            if i != j:
                sums[self._shear_free[:, i] | self._shear_free[:, j], component] = 0
        values = prolongation.prolong(sums[:, :6] / sums[:, 6:])
        self._recovered.x.array[:] = values[self._vertex].ravel()

        energies = fem.assemble_vector(self._energies).array.reshape(-1, 2)
        error2, energy2 = np.maximum(energies, 0).T
        total = prolongation.comm.allreduce(np.array([error2.sum(), energy2.sum(), len(error2)]), op=MPI.SUM)
        if not np.isfinite(total).all():
            raise SolveError("the strain energy is not a finite number: check the units of moduli and lengths")
        error, omega = np.sqrt(total[0]), np.sqrt(total[0] + total[1])
        if omega <= noise:
            error2, energy2, error, omega = np.zeros_like(error2), np.zeros_like(energy2), 0.0, 0.0
        return Estimate(self._recovered.copy(), np.sqrt(error2), energy2, error, omega, int(total[2]))


def _position(i, j):
    return VOIGT.index((min(i, j), max(i, j)))


def _energy(elasticity, stress):
    """stress : C^-1 stress, twice the energy density."""
    first, second = elasticity.lame
    trace = ufl.tr(stress)
    return (ufl.inner(stress, stress) - first / (3 * first + 2 * second) * trace**2) / (2 * second)
