"""What a solution must satisfy, and by how much it may deviate: bounds that follow from the record of the run itself.

linear solver   PCG stops at `energy_error`, the preconditioned norm of its residual. The true error is larger by
                sqrt(cond) = 2 n / ln(2/t), from n iterations to a tolerance t. The sum of forces on a body is v^T K e,
                with v its translation: at most |v|_K |e|_K, where |v|_K^2 = v^T K v + sum k. Rounding in products with
                K and k is added. At least 1e-7, the contract; at most 1 %: a larger error without a warning fails.
discretisation  With prescribed displacements, energy and force err by the square of the relative error in the energy
                norm: at most e^2, and at most (xi / (0.8 omega theta))^2 by the record, where the effectivity theta
                counts below 0.8. Uniform stresses are exact.
round contact   Between nodes h apart the sphere bulges by h^2/8R. Relative to the approach a^2/R, with n pairs on
                pi a^2 and F ~ approach^(3/2), this is 1.5 pi / (8 n) of the force.
penalty         To first order a penalty lowers the force F to F (1 - s), s = sum(f penetration) / (F approach), in a
                linear problem exactly. Forces are corrected by it; the rest is of order s^2.
"""

from copy import copy
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem

from fx_contact import Solver
from fx_contact.contact.constraint_rows import Role
from fx_contact.contact.row_motions import RowMotions
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.external_forces import load
from fx_contact.linalg.stopping import ROUNDING
from fx_contact.scene.rigid_faces import RigidFace

#: Forces and displacements hold to this part of them, whatever the number of ranks and the solver: the contract.
CONTRACT = 1e-7
#: The most that linear solver and rounding may change in forces.
LOST = 0.01
#: Pairs may penetrate by this part of the approach, or be apart and carry force: the gap tolerance of the program.
GAP_TOLERANCE = 1e-6
#: Effectivity of the estimate down to which a solution counts as accurate: the target of studies/effectivity.
TRUSTED = 0.8


@dataclass(frozen=True)
class Check:
    """One thing that must hold, how far it is from holding, relative, and how far it may be."""

    name: str
    deviation: float
    allowed: float

    @property
    def holds(self):
        """A deviation that is not a number does not."""
        return bool(self.deviation <= self.allowed)


class State:
    """What the checks need of the last step of a run, for the modelled part.

    Args:
        step: Step of a run on one rank.
        penalty: whether contact is enforced by a penalty.

    Attributes:
        record: of the step.
        force: sum of all contact forces [N].
        energy: twice the energy stored in the bodies, of their stress [J].
        sprung: twice the energy of springs [J].
        potential: the quantity whose error is the square of the solution's: twice the potential energy, of bodies,
            springs, penalty and loads [J].  The energy differs from it by what loads do while gaps close, so that its
            error is also that of the contact force.
        given: twice the work of tensions and rigid loads along the motions that they find, part of the potential [J].
        work: of loads and reactions [J].
        yielded: sum of force times penetration: twice what the penalty stores [J].
        scale: a force to measure others by: contact, load, those of ties, springs and stress-free strains or, without
            any, what may be lost [N].
        noise: what linear solver and rounding may change in forces, relative.
        energy_noise: what rounding may change in the energy besides, relative.
        restraint: energy that errors of the record are relative to, over `energy`, at least 1: with stress-free strains
            the square of the norm is at least (e omega_0)^2, of those of full restraint times the tolerance [-].
    """

    def __init__(self, step, penalty=False):
        self.record, self._step, self._penalty = step.record, step, penalty
        rows, contact = step.rows, step.solution
        u = contact.displacement
        supports = find_supports(step.scene, step.forest, step.elasticity.prolongation)
        self._load, held = load(step.scene, step.forest, step.elasticity), ~supports.free
        self._contact, self._springs = np.zeros_like(u), _spring_forces(step)
        if contact.rows is not None:
            entries, forces = contact.rows.entries, contact.row_force[contact.rows.entries.row, None]
            np.add.at(self._contact, entries.node, -forces * contact.rows.values)
        self._body = _bodies(step.forest, step.elasticity.prolongation)
        self.copies = step.scene.symmetry
        strained = step.elasticity.stress_free_forces()
        inner, lever2, diagonal = _stiffness(step, self._body, held)
        self._reaction = np.where(held, inner - strained - self._load - self._contact, 0.0)

        self.gap = self.penetration = self._resultants = np.zeros(0)
        self._facing, penalties = np.zeros((0, 2), dtype=np.int32), 0.0
        if rows is not None:
            self.gap, self.penetration, self._facing = rows.gap, rows.penetration(u), rows.bodies
            self._resultants = rows.force_components(contact.force)
            penalties = rows.capped_stiffness[contact.active].sum() if penalty else 0.0
        self.force = float(np.abs(contact.force).sum())
        self.energy, self._inside = _energies(step)
        self.sprung = -float((u * self._springs).sum())
        self.given, self._pulled, self._unlike = _of_motions(step)
        self.work = float((u * (self._load + self._reaction)).sum())
        self.yielded = float(contact.force @ self.penetration)
        loads = 2 * float((u * self._load).sum()) + self.given
        self.potential = self.energy + self.sprung + self.yielded - loads
        self.size = float(np.abs(u).max())
        spread = max(1.0, 2 * sum(contact.krylov_iterations) / np.log(2 / Solver().tolerance))
        loss = spread * contact.energy_error * np.sqrt(lever2 + penalties)
        entries = 3 * (2 * self.record.degree + 1) ** 3  # most of a row of the stiffness, whose roundings add up
        loss += entries * np.finfo(float).eps * (diagonal + penalties) * self.size
        others = [contact.row_force, self._springs, strained, self._reaction * (not step.scene.contact)]
        measured = max(self.force, np.abs(self._load).sum()) or max(np.abs(some).sum() for some in others)
        self.scale = measured or loss / CONTRACT or 1.0
        self.noise = CONTRACT + min(float(loss / self.scale), LOST)
        least = (self.record.tolerance * step.elasticity.restraint_norm()) ** 2
        self.restraint = max(1.0, least / self.energy) if self.energy > 0 else 1.0
        # Of u^T K u, relative to u^T D u: bodies may move much further than they deform.
        self.energy_noise = contact.rounding**2 / (ROUNDING * self.energy) if self.energy > 0 else 0.0

    def without_step(self):
        """The State with its numbers and its record alone, all that `against_twin` needs of a twin."""
        kept = copy(self)
        kept.__dict__ = {name: value for name, value in vars(self).items() if np.isscalar(value) or name == "record"}
        return kept

    @property
    def softness(self):
        """Share of the energy that is in the penalty."""
        return self.yielded / self.energy if self.force and self.energy > 0 else 0.0

    def stated(self):
        """What discretisation changes in force and energy by the record, at most, relative.

        A run takes an estimate at its word; of later meshes than the first its effectivity may be `TRUSTED`.
        """
        return self.restraint * (self.record.estimate / (TRUSTED * self.record.assumed_effectivity)) ** 2

    def asked(self):
        """What discretisation changes in force and energy if the run is as accurate as it was asked to be, relative.

        Beside large stress-free strains the force of a contact pair is still held to the tolerance.
        """
        return min(self.restraint * self.record.tolerance**2, self.record.tolerance)

    def bulge(self):
        """What the rim of a round contact changes in them, relative.

        With F(a) = 2 E* a (d - a^2 / (3 R)), a rim that is off by s changes the force by (3/2) (s / a)^2, in the mean
        by h^2 / (8 a^2) where it lies anywhere in a facet of size h; N closed nodes of degree p: pi a^2 = N (h / p)^2.
        """
        return 1.5 * np.pi * self.record.degree**2 / (8 * max(1, self.record.active_pairs * self.copies))

    def interfaces(self):
        """Contact force of the whole bodies between each two bodies: (n,) float64 [N]."""
        between, place = np.unique(self._facing, axis=0, return_inverse=True)
        sums = np.bincount(place.ravel(), self._resultants, minlength=len(between))
        return self.copies * sums

    def checks(self):
        """What any solution must satisfy: list of Check."""
        contact = self._step.solution
        all_forces = self._reaction + self._load + self._contact + self._springs
        bodies = range(len(self._step.scene.mesh.bodies))
        unbalanced = max(np.linalg.norm(all_forces[self._body == body].sum(axis=0)) for body in bodies)
        tension = -contact.force.min(initial=0.0) / max(contact.force.max(initial=0.0), self.noise * self.scale)
        depth = np.where(contact.active, 0.0 if self._penalty else np.abs(self.penetration), self.penetration)
        depth = depth.max(initial=0.0)
        approach = min(self.size, self.energy / self.force) if self.force else self.size
        clapeyron = self.work - self._inside - self.sprung - contact.force @ (self.gap + self.penetration)
        clapeyron += self._pulled
        parts = abs(self.work) + self.energy + np.abs(contact.force * self.gap).sum() + abs(self.yielded)
        parts += self.sprung + abs(self._inside - self.energy) + abs(self._pulled)
        lost = self.noise * self.scale * self.size
        said = np.array([self.record.force, sum(self.record.pair_forces)])
        unlike = np.abs(said - self.copies * self._resultants.sum()).max()
        springs = [one.force for one in self.record.resultants if one.kind == "spring"]
        if springs:
            known = self._step.scene.mirrors.force(self._springs.sum(axis=0))
            unlike = max(unlike, np.abs(np.sum(springs, axis=0) - known).max())
        return [
            Check("forces of the record", unlike / self.scale, CONTRACT),
            Check("given forces", self._unlike / self.scale, self.noise),
            Check("balance of each body", unbalanced / self.scale, self.noise),
            Check("no tension", tension, self.noise * np.sqrt(len(self.gap))),
            Check("no penetration but the penalty's", depth / (approach or 1.0), GAP_TOLERANCE),
            Check(
                "work is stored", abs(clapeyron) / (parts + lost or 1.0), self.noise + lost / (parts + lost or 1.0)
            ),
        ]

    def against_exact(self, exact):
        """Comparison with a known answer: list of Check."""
        allowed = self.noise + exact.unsure + (self.bulge() if exact.curved else 0.0)
        if not exact.linear:
            allowed += min(self.stated(), self.asked())
        result = []
        if exact.energy == 0:
            stress = np.sqrt(self.energy) / self._step.elasticity.restraint_norm()
            return [Check("no stress", stress, self.noise + (0.0 if exact.linear else self.record.tolerance))]
        if exact.energy is not None:
            off = abs(self.energy * self.copies / exact.energy - 1)
            result.append(Check("energy against the reference", off, allowed + self.energy_noise))
        if exact.force is None:
            return result
        if not exact.force:
            return [Check("no contact force", self.force / self.scale, 0.0)]
        forces = self.interfaces()
        soft = self.yielded * self.copies / (forces.mean() * exact.approach) if self.force else 0.0
        if not exact.linear:
            allowed += soft**2
        off = np.abs(forces / (1 - soft) / exact.force - 1).max()
        return [*result, Check("force against the reference", off, allowed)]

    def against_twin(self, other, twin):
        """Comparison with the last step of a twin: list of Check."""
        allowed, rounded = self.noise + other.noise, self.energy_noise + other.energy_noise
        size, other_size = ((record.cells, record.active_pairs) for record in (self.record, other.record))
        same = twin.same_mesh and size == other_size
        if not same:
            # Energies err upwards where motions are prescribed and downwards below loads: the twin's error adds up.
            asked = self.asked() + other.asked() * twin.held
            allowed += min(self.stated() + other.stated(), asked)
        if not same and twin.curved:
            allowed += self.bulge() + other.bulge()
        if not twin.same_contact:
            allowed += self.softness + other.softness
        force, potential = (
            [getattr(state, name) * state.copies for state in (self, other)] for name in ("force", "potential")
        )
        potential[0] += self.given * self.copies * twin.held
        stored = (other.energy + other.sprung) * other.copies  # of which the potential may be a small difference
        result = [
            Check("force against the twin", _off(force[0] * twin.force, force[1]), allowed),
            Check(
                "energy against the twin",
                _off(stored + twin.energy * potential[0] - potential[1], stored),
                allowed + rounded,
            ),
        ]
        if twin.each:  # held to e of it, or e^2 of the largest
            tolerance = self.record.tolerance
            one, two = (np.array(record.pair_forces) for record in (self.record, other.record))
            off = np.abs(one * twin.force - two) / np.maximum(two, tolerance * two.max())
            result[0] = Check("force of each pair against the twin", off.max(), tolerance)
        if same and twin.same_contact:
            pressure = self.record.max_pressure * twin.pressure
            allowed *= np.sqrt(len(self.gap))
            result.append(Check("pressure against the twin", _off(pressure, other.record.max_pressure), allowed))
        return result


def _stiffness(step, body, held):
    """Internal forces (n, 3) of the displacement without stress-free strains, with springs [N], and two norms.

    Returns:
        The forces; v^T K v of the translation that takes most energy where prescribed displacements hold the body
        [N/m]; the norm of K's diagonal [N/m].
    """
    stiffness = step.elasticity.stiffness().mat
    stiffness.assemble()
    x, y = stiffness.createVecs()
    x.array[:] = step.solution.displacement.ravel()
    stiffness.mult(x, y)
    inner, lever2 = y.array.reshape(-1, 3).copy(), 0.0
    for one in range(len(step.scene.mesh.bodies)):
        for axis in range(3):
            x.array[:] = 0
            x.array.reshape(-1, 3)[:, axis] = (body == one) & ~held[:, axis]
            stiffness.mult(x, y)
            lever2 = max(lever2, x.dot(y))
    diagonal = np.sqrt((stiffness.getDiagonal().array ** 2).sum())
    stiffness.destroy()
    return inner, lever2, diagonal


def _spring_forces(step):
    """Forces of springs on the conforming nodes: (n, 3) [N]."""
    elasticity, springs = step.elasticity, step.elasticity.springs
    if springs is None:
        return np.zeros_like(step.solution.displacement)
    return -springs.internal_forces(elasticity.at_leaves(elasticity.field(step.solution.displacement).function))


def _energies(step):
    """Twice the energy of the stress, int s : C^-1 s, and int s : eps(u), alike without stress-free strains [J]."""
    elasticity = step.elasticity
    if not (step.scene.strains or step.scene.springs):
        energy = elasticity.energy_norm(step.solution.displacement) ** 2
        return energy, energy
    stress = elasticity.stress(step.field)
    densities = elasticity.work(stress, stress), ufl.inner(stress, ufl.grad(step.field.function))
    energy, inside = (fem.assemble_scalar(fem.form(one * elasticity.measure())) for one in densities)
    return float(energy), float(inside)


def _of_motions(step):
    """Tensions and rigid loads, of the modelled part.

    Returns:
        Twice their work along the motions that they find, by the given forces; the work of all ties, by theirs [J];
        the largest difference of a force, or moment over size, from that given [N].
    """
    if step.solution.rows is None:
        return 0.0, 0.0, 0.0
    ties = step.solution.rows.part(Role.EQUATION)
    force, u = step.solution.row_force[step.solution.rows.role == Role.EQUATION], step.solution.displacement
    motions, unlike = RowMotions.of(ties, turning=False), 0.0
    given = 2 * float(motions.loads @ motions.found(ties.penetration(u))) if len(motions) else 0.0
    for kind in motions.kinds:
        ours, contact = ties.contact == kind.index, kind.contact
        push = -force[ours, None] * ties.normal[ours]  # on the first surface
        if isinstance(contact, RigidFace):
            motion = contact.motion
            moment = np.cross(ties.position[ours] - motion.centroid, push).sum(axis=0)
            found = motion.basis.T @ np.concatenate([push.sum(axis=0), moment / motion.size])
        else:
            found = push.sum(axis=0) @ contact.unit_axis
        unlike = max(unlike, np.abs(found - motions.loads[motions.interface == kind.index]).max())
    return given, -float(force @ (ties.gap + ties.penetration(u))), float(unlike)


def _off(value, expected):
    if not expected:
        return 0.0 if not value else np.inf
    return float(abs(value / expected - 1))


def _bodies(forest, prolongation):
    """Body of each owned conforming vertex: (owned,) int."""
    own = (prolongation.conforming >= 0) & (prolongation.conforming < prolongation.owned)
    result = np.empty(prolongation.owned, dtype=np.int64)
    leaf = prolongation.space.example[own, 0]
    result[prolongation.conforming[own]] = forest.mesh.body[forest.cell[leaf]]
    return result
