"""The contact loop over active sets."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fx_contact.activeset import ActiveSet
from fx_contact.enforcement import Jump, PenaltyTerm
from fx_contact.errors import SolveError
from fx_contact.guess import relax
from fx_contact.krylov import ROUNDING, ConjugateGradients
from fx_contact.petsc_objects import PetscObjects
from fx_contact.projection import Projection

#: Overlap that conditions leave between vertices, relative to the approach, up to which it is rounding,
_OVERLAP = 1e-6
#: and relative to the largest displacement, where there is hardly an approach.
_MOVED = 1e-12


@dataclass(frozen=True, eq=False)
class ContactSolution:
    """The end of the contact loop.

    Attributes:
        displacement: (owned, 3) float64, conforming [m].
        active: (n,) bool, status of this rank's node pairs.
        force: (n,) float64, contact force of each pair, compression positive [N]; none where conditions hold both
            vertices across the contact: they carry it.
        penetration: (n,) float64, positive where the bodies overlap [m].
        contact_iterations: number of active sets tried, and of augmentations.
        krylov_iterations: of each linear solve.
        preconditioner: name of the one that the last solve used, as `ConjugateGradients` has it.
        energy_error: how far the linear solver may be from the solution in the operator's norm [J^(1/2)].
        rounding: what rounding may leave of a rigid motion in the energy norm (4) [J^(1/2)].
    """

    displacement: np.ndarray
    active: np.ndarray
    force: np.ndarray
    penetration: np.ndarray
    contact_iterations: int
    krylov_iterations: list[int]
    preconditioner: str
    energy_error: float
    rounding: float


def solve_contact(
    matrix, load, pairs, prescribed, start, energy_norm, solver, stages, enforcement=None, scene=None, motions=None
):
    """Solve K u + B^T f = L with f >= 0, B u <= D, f (B u - D) = 0, the latter as the enforcement has it.

    Collective on matrix.mat.comm.  Active sets change until one repeats itself; the linear systems are solved loosely
    until then.

    Args:
        matrix: BlockMatrix, P^T K P not yet assembled; it is used up.
        load: (owned, 3) float64 external forces [N].
        pairs: NodePairs or None; without, one linear solve.
        prescribed: (owned, 3) float64 prescribed displacements [m], NaN where free.
        start: (owned, 3) float64 first guess [m]; its penetrations are the first guess of the active set.
        energy_norm: function of a displacement (owned, 3) float64 [m], its energy norm omega (4) [J^(1/2)]; collective.
        solver: Solver.
        stages: Stages, for the times.
        enforcement: Enforcement, with which the pairs were made; None without pairs.
        scene: Scene, to name the bodies that an active set leaves loose; None: not checked.
        motions: RigidMotions, of bodies that are at rest and are to be moved as a whole first; None: they stay.

    Returns:
        ContactSolution.

    Raises:
        SolveError: a linear solve fails, there are too many active sets or augmentations, nothing holds a body once
            the contact opens, or conditions press vertices into each other.
    """
    with PetscObjects(matrix.mat) as objects:
        u = np.where(np.isnan(prescribed), start, prescribed)
        with stages("system"):
            jump = None if pairs is None else Jump(pairs, prescribed)
            if pairs is not None:
                PenaltyTerm(jump).reserve(matrix.mat)
            matrix.mat.assemble()
            base, scale = _impose(matrix.mat, load, prescribed)
        if pairs is None:
            return _solve_linear(matrix, base, u, energy_norm, solver, stages, scale, objects)
        with stages("solve"):
            status = ActiveSet(pairs, scene, u, solver.max_contact)
            bounded = PenaltyTerm(jump, pairs.bounded_stiffness)
            if motions is not None:
                stiffness = status.active * pairs.bounded_stiffness
                u = motions.move(matrix.mat, base, jump, stiffness, u, np.isnan(prescribed))
            bounded.change(matrix.mat, np.zeros_like(status.active), status.active)
            if pairs.prolongation.comm.allreduce(bool(start.any()), op=MPI.LOR):
                u = relax(matrix.mat, base, bounded, u, status)
                status.forget()
        with stages("system"):
            linear = _ClosedPairs(
                matrix, base, jump, status.active, energy_norm, solver, enforcement, stages, objects
            )

        tolerance, augmentations = solver.loose_tolerance, 0
        while True:
            u = linear.solve(status.active, u, tolerance)
            trial = linear.trial(u)
            linear.check_apart(trial, u)
            wanted = status.wanted(trial, linear.noise * solver.tolerance / tolerance)
            if status.differs(wanted) and not (tolerance > solver.tolerance and status.cycles(wanted)):
                status.update(wanted)
            elif linear.augment(trial, u):
                augmentations += 1
                if augmentations > solver.max_contact:
                    raise SolveError(
                        f"{solver.max_contact} augmentations have not brought the penetration below the gap tolerance "
                        f"{enforcement.gap_tolerance:g}; use a larger penalty factor or the enforcement 'exact'"
                    )
            elif tolerance > solver.tolerance:
                tolerance = solver.tolerance
                status.forget()
            else:
                status.check_held()
                force = np.where(status.active & jump.movable, trial, 0.0)
                break
        return ContactSolution(
            u,
            status.active,
            force,
            pairs.penetration(u),
            status.updates + augmentations,
            linear.iterations,
            linear.preconditioner,
            linear.noise,
            _rounding(u, scale, pairs.prolongation.comm),
        )


def _solve_linear(matrix, base, u, energy_norm, solver, stages, scale, objects):
    """The solution without contact."""
    with stages("system"):
        cg = ConjugateGradients(matrix, solver, energy_norm, objects)
    with stages("setup"):
        cg.set_up()
    with stages("solve"):
        u = cg.solve(base, u, solver.tolerance)
    none, rounding = np.zeros(0), _rounding(u, scale, matrix.comm)
    return ContactSolution(
        u, none.astype(bool), none, none, 1, cg.iterations, cg.preconditioner, cg.energy_error, rounding
    )


def _rounding(u, scale, comm):
    """What rounding leaves of a displacement in the energy norm, from the roots of the stiffness' diagonal."""
    return ROUNDING * float(np.sqrt(comm.allreduce(float(((scale * u) ** 2).sum()))))


class _ClosedPairs:
    """The linear system of closed pairs, and what is kept from one active set to the next.

    Args:
        matrix: BlockMatrix with the penalty term of `active`; it is used up.
        base: (owned, 3) float64, right-hand side without contact [N].
        jump: Jump.
        active: (n,) bool, closed pairs.
        energy_norm, solver, enforcement, stages: as in `solve_contact`.
        objects: PetscObjects, with which what is made here is freed.
    """

    def __init__(self, matrix, base, jump, active, energy_norm, solver, enforcement, stages, objects):
        self._base, self._jump, self._active, self._stages = base, jump, active, stages
        self._solver, self._enforcement, self._energy_norm = solver, enforcement, energy_norm
        pairs = jump.pairs
        self._comm = pairs.prolongation.comm
        self._bounded, self._nearest = PenaltyTerm(jump, pairs.bounded_stiffness), Projection(jump)
        if enforcement.method == "exact":
            self._term, self._holdable, self._held = self._bounded, np.ones_like(active), self._nearest
        else:
            self._term = PenaltyTerm(jump)
            self._holdable = pairs.stiffness > pairs.bounded_stiffness
            self._held = Projection(jump, pairs.stiffness) if self._any(self._holdable) else None
        self._forces = np.zeros(len(active))  # of the augmented Lagrangian
        self._known, self._is_set_up = active, False  # the active set in the matrix
        self._cg = ConjugateGradients(matrix, solver, energy_norm, objects)

    @property
    def iterations(self):
        """list of int, Krylov iterations of each solve."""
        return self._cg.iterations

    @property
    def preconditioner(self):
        """Name of the present preconditioner."""
        return self._cg.preconditioner

    @property
    def noise(self):
        """Error of the last solution in the norm of the operator [J^(1/2)]."""
        return self._cg.energy_error

    def solve(self, active, u, tolerance):
        """The displacement of some closed pairs.

        Args:
            active: (n,) bool, closed pairs.
            u: (owned, 3) float64, first guess [m].
            tolerance: of the linear solver [-].

        Returns:
            (owned, 3) float64 [m].
        """
        late = tolerance <= self._solver.tolerance and self._disturbs(active)
        if not self._is_set_up or late or self._cg.stops_paying():
            with self._stages("setup"):
                self._bounded.change(self._cg.matrix, self._known, active)
                self._cg.set_up()
            self._known, self._is_set_up = active, True
        with self._stages("system"):
            self._active, self._forces = active, np.where(active, self._forces, 0.0)
            right_hand_side = self._system(self._term)
            if not self._any(active) and not self._any(self._base):
                # At rest; from elsewhere PCG would come close, but not by the energy of what is left.
                u = np.zeros_like(u)
            self._nearest.close(active)
            if self._held is not None:
                self._held.close(active & self._holdable)
                u = self._held.onto_closed(u)
        with self._stages("solve"):
            return self._cg.solve(right_hand_side, u, tolerance, self._held)

    def _system(self, term):
        """Let the operator have a penalty term of the closed pairs; the right-hand side that belongs to it."""
        self._cg.correct(term.difference(self._active, self._bounded, self._known))
        return self._base + self._bounded.right_hand_side(self._known, self._forces)

    def check_apart(self, trial, u):
        """See that conditions do not press closed pairs into each other: no force could keep their vertices apart.

        Collective.  They do where the nearest displacement that closes the pairs leaves overlaps, and no gaps: the
        jumps of such pairs, weighted by their overlaps, add up to one that conditions alone decide.  Beside a gap that
        is not known yet: the pair that has it will open.

        Args:
            trial: (n,) float64, as from `trial` [N].
            u: (owned, 3) float64, the last solution [m].

        Raises:
            SolveError: they do, by more than rounding.
        """
        rounding = self._rounding(trial, u)
        pairs, u = self._jump.pairs, self._nearest.onto_closed(u)
        overlap = np.where(self._active, pairs.penetration(u), 0.0)
        if self._largest(np.minimum(overlap, 0.0)) > rounding:
            return
        worst = int(overlap.argmax()) if len(overlap) else 0
        mine = (float(overlap[worst]), pairs.position[worst].tolist()) if len(overlap) else (0.0, [])
        deepest, place = max(self._comm.allgather(mine))
        if deepest > rounding:
            raise SolveError(
                f"displacements prescribed on both surfaces of a contact, or around it, press them {deepest:.3g} m "
                f"into each other, at ({', '.join(f'{x:.4g}' for x in place)}): contact cannot keep them apart; leave "
                "one of them free"
            )

    def _disturbs(self, active):
        """Whether an active set differs from that of the preconditioner by other pairs than such as are held now.

        Each is an outlier of the spectrum that costs some iterations, and many soon more than a new set-up.  In the
        norm of a preconditioner that has a stiff pair as closed, a penetration that nothing resists any more looks
        small.  So the last solve allows none.
        """
        return self._any((self._known != active) & ~(active & self._holdable))

    def trial(self, u):
        """Force of closed pairs, and of open ones the force that a penalty would exert.

        That of held pairs is what keeps the forces on their vertices in balance, whatever rounding does to their
        penetration.  Held pairs whose gap others that share their vertex leave open, however near, count as open.

        Args:
            u: (owned, 3) float64, the last solution [m].

        Returns:
            (n,) float64, compression positive [N].
        """
        trial = self._forces + self._bounded.force(u)
        if self._held is None:
            return trial
        residual = self._cg.residual(self._system(self._bounded), u)
        held = trial + self._held.apply_transpose(residual)
        penetration = self._jump.pairs.penetration(self._nearest.onto_closed(u))
        closed = self._held.closed & (penetration >= -self._rounding(held, u))
        return np.where(closed, held, trial)

    def _rounding(self, trial, u):
        """Gaps and overlaps of closed pairs up to which they are rounding: float [m]."""
        return max(_OVERLAP * self._approach(self._pressing(trial), u), _MOVED * self._largest(u))

    def _any(self, values):
        """Whether one of the values on any rank is not 0."""
        return self._comm.allreduce(bool(values.any()), op=MPI.LOR)

    def _largest(self, values):
        """The largest absolute value on all ranks: float."""
        return self._comm.allreduce(float(np.abs(values).max(initial=0.0)), op=MPI.MAX)

    def augment(self, trial, u):
        """Add the penalty's forces to those of the augmented Lagrangian, if they still leave a penetration.

        Args:
            trial: (n,) float64, as from `trial` [N].
            u: (owned, 3) float64, the last solution [m].

        Returns:
            bool, whether that has changed the system.
        """
        if self._enforcement.method != "augmented-lagrangian":
            return False
        pairs = self._jump.pairs
        penetration = pairs.penetration(u)
        beyond_noise = np.abs(penetration) * np.sqrt(pairs.stiffness) > self.noise
        force = self._pressing(trial)
        count = self._comm.allreduce(int(pairs.contact.max(initial=-1)) + 1, op=MPI.MAX)
        _, approach = pairs.pressing(force, pairs.contact, count)
        approach = np.minimum(approach, self._approach(force, u))[pairs.contact]
        penetrating = self._active & self._jump.movable & beyond_noise
        if not self._any(penetrating & (np.abs(penetration) > self._enforcement.gap_tolerance * approach)):
            return False
        self._forces = force
        return True

    def _pressing(self, trial):
        """Forces of the closed pairs that press: (n,) float64 [N]."""
        return np.where(self._active, np.maximum(trial, 0.0), 0.0)

    def _approach(self, force, u):
        """About how far bodies approach each other: their energy over the force, for they may come from afar [m]."""
        pressed = self._comm.allreduce(float(force.sum()))
        moved = self._largest(u)
        return min(moved, self._energy_norm(u) ** 2 / pressed) if pressed > 0 else moved


def _impose(matrix, load, prescribed):
    """Eliminate prescribed components symmetrically, identity rows scaled like the others.

    Returns:
        (owned, 3) float64 right-hand side [N], and the roots of the diagonal.

    Raises:
        SolveError: the matrix is not finite.
    """
    with PetscObjects() as objects:
        x, b = map(objects.add, matrix.createVecs())
        x.array[:], b.array[:] = np.nan_to_num(prescribed).ravel(), load.ravel()
        rows = matrix.getOwnershipRange()[0] + np.flatnonzero(~np.isnan(prescribed).ravel()).astype(np.int32)
        diagonal = objects.add(matrix.getDiagonal())
        scale = diagonal.sum() / diagonal.getSize()
        if not (np.isfinite(scale) and scale > 0 and np.isfinite(b.norm())):
            raise SolveError(
                "the stiffness or the load is not a finite number: check the units of moduli and lengths"
            )
        matrix.zeroRowsColumns(rows, diag=scale, x=x, b=b)
        return b.array.reshape(-1, 3).copy(), np.sqrt(np.abs(diagonal.array)).reshape(-1, 3)
