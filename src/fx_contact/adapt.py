"""The adaptive loop: solve, estimate, mark, refine, repartition; a record and the solution a step."""

from dataclasses import dataclass
from numbers import Real

import numpy as np
from mpi4py import MPI

from fx_contact.conditions import load, prescribed_displacements, shear_free_components
from fx_contact.contact import Penalty, node_pairs
from fx_contact.elasticity import Elasticity
from fx_contact.errors import PartitionError, SceneError
from fx_contact.estimate import estimate
from fx_contact.forest import Forest
from fx_contact.hanging import Prolongation
from fx_contact.krylov import Solver
from fx_contact.mesh import leaf_mesh, sufficient_order
from fx_contact.partition import repartition
from fx_contact.quality import brief
from fx_contact.report import versions
from fx_contact.scene import Scene
from fx_contact.solve import solve_contact
from fx_contact.stages import Stages

#: Share of the prescribed error that the leaf maps may deviate from the root cells' maps, relative to the leaf's size,
#: where the program chooses the geometry order.
GEOMETRY_SHARE = 0.1
#: Energy norms up to so many times the linear solver's error are noise: nothing is refined for them.
NOISE = 1e3


@dataclass(frozen=True, eq=False)
class Step:
    """The state after one adaptive step.

    Attributes:
        record: dict, the contract of `steps.jsonl`.
        scene: Scene.
        forest: Forest.
        leaf_mesh: LeafMesh.
        elasticity: Elasticity; its `u` is the displacement.
        pairs: NodePairs or None.
        start: (owned, 3) float64, displacement carried from the step before, where the solve began [m].
        contact: ContactSolution.
        estimate: Estimate.
        stages: Stages of this step, from the refinement that led to it.
    """

    record: dict
    scene: object
    forest: Forest
    leaf_mesh: object
    elasticity: Elasticity
    pairs: object
    start: np.ndarray
    contact: object
    estimate: object
    stages: Stages

    def __del__(self):
        # Where steps are collected and a later one fails, Python drops them while the error is under way; communicators
        # of dolfinx freed then hang in mpi4py (see `_mpi`).  Inside `__del__` the error is set aside.
        self.__dict__.clear()


def adapt(
    scene,
    tolerance,
    comm=MPI.COMM_WORLD,
    *,
    max_steps=20,
    geometry_order=None,
    penalty=None,
    solver=None,
    partition_kind="contact-sfc",
):
    """Solve a scene to a prescribed accuracy, refining where the error is.

    Collective on comm; so is every step of the iteration.

    Args:
        scene: Scene, the same on all ranks.
        tolerance: prescribed relative error e in the energy norm, (6) [-].
        comm: MPI communicator.
        max_steps: most solves.
        geometry_order: order of the leaf maps; None: the lowest that holds the root map to
            `GEOMETRY_SHARE` times the tolerance.
        penalty: Penalty; None: the default one.
        solver: Solver; None: the default one.
        partition_kind: a key of `partition.KINDS`.

    Yields:
        Step, until xi / (e omega) <= 1 or max_steps are done.

    Raises:
        SceneError: a tolerance that is not positive, an order above that of the root mesh, an unknown partition.
        PartitionError: a rank would get no leaf.
        SolveError: a solve fails; what was yielded before stays valid.
    """
    penalty = Penalty() if penalty is None else penalty
    solver = Solver() if solver is None else solver
    _check_arguments(scene, tolerance, max_steps, geometry_order, penalty, solver)
    carried, stages = None, Stages()
    with stages("partition"):
        forest = _first_forest(scene, comm, partition_kind)
    for number in range(max_steps):
        with stages("partition"):
            if number:
                forest, carried = repartition(forest, carried, partition_kind)
            quality = brief(forest, partition_kind)
        with stages("hanging"):
            prolongation = Prolongation(forest)
            start, carried = _start(forest, prolongation, carried), None
        step = _solve(
            number, scene, forest, prolongation, start, tolerance, geometry_order, penalty, solver, stages, quality
        )
        yield step
        if step.record["ratio"] <= 1 or number == max_steps - 1:
            return
        stages = Stages()
        with stages("refine"):
            forest, carried = _refine(step, tolerance)
        del step


def _check_arguments(scene, tolerance, max_steps, geometry_order, penalty, solver):
    if not isinstance(scene, Scene):
        raise SceneError(f"adapt needs a Scene, got {scene!r}")
    if not isinstance(tolerance, Real) or not (np.isfinite(tolerance) and tolerance > 0):
        raise SceneError(f"the tolerance must be a positive number, got {tolerance!r}")
    if not isinstance(max_steps, int) or max_steps < 1:
        raise SceneError(f"max_steps must be a whole number, at least 1, got {max_steps!r}")
    for name, value, kind in (("penalty", penalty, Penalty), ("solver", solver, Solver)):
        if not isinstance(value, kind):
            raise SceneError(f"{name} must be a {kind.__name__}, got {value!r}")
    orders = range(1, scene.mesh.order + 1)
    if geometry_order is not None and not (isinstance(geometry_order, int) and geometry_order in orders):
        raise SceneError(
            f"the geometry order must be 1 to {scene.mesh.order}, that of the root mesh, got {geometry_order}"
        )


def _solve(number, scene, forest, prolongation, start, tolerance, geometry_order, penalty, solver, stages, quality):
    """One step on a given forest."""
    comm = forest.comm
    with stages("mesh"):
        order = geometry_order or sufficient_order(forest, GEOMETRY_SHARE * tolerance)
        cells = leaf_mesh(forest, order)
    with stages("assemble"):
        materials = np.array([[m.young, m.poisson] for m in (scene.materials[b] for b in scene.mesh.bodies)])
        elasticity = Elasticity(cells, materials, scene.mesh.body[forest.cell[cells.leaf]], prolongation, stages)
        pairs = node_pairs(scene, forest, prolongation, penalty) if scene.contact else None
        matrix = elasticity.stiffness(pairs)
    with stages("system"):
        prescribed = prescribed_displacements(scene, forest, prolongation)
        forces = load(scene, forest, elasticity)
    contact = solve_contact(matrix, forces, pairs, prescribed, start, solver, stages, scene)
    with stages("estimate"):
        elasticity.set_displacement(contact.displacement)
        shear_free = shear_free_components(scene, forest, prolongation)
        error = estimate(elasticity, shear_free, stages, NOISE * contact.energy_error)
    record = {
        "scene": scene.name,
        "step": number,
        "ranks": comm.size,
        "cells": forest.size_global,
        "dofs": 3 * prolongation.index_map.size_global,
        "hanging_nodes": prolongation.hanging_global,
        "max_level": comm.allreduce(int(forest.level.max(initial=0)), op=MPI.MAX),
        "geometry_order": order,
        **_contact_results(scene, pairs, contact, comm),
        "contact_iterations": contact.contact_iterations,
        "krylov_iterations": contact.krylov_iterations,
        "estimate": error.relative,
        "tolerance": tolerance,
        "ratio": error.relative / tolerance,
        "partition": quality,
        **stages.costs(comm),
        "versions": versions(),
    }
    return Step(record, scene, forest, cells, elasticity, pairs, start, contact, error, stages)


def _start(forest, prolongation, carried):
    """First guess of the conforming displacement from the values that the leaves carry: (owned, 3)."""
    start = np.zeros((prolongation.owned, 3))
    if carried is not None:
        leaf, corner = prolongation.vertices.example.T
        own = (prolongation.conforming >= 0) & (prolongation.conforming < prolongation.owned)
        start[prolongation.conforming[own]] = carried[leaf[own], corner[own]]
    return start


def _first_forest(scene, comm, kind):
    """The root cells, refined alike until every rank can have some; on few ranks they are not refined."""
    forest = Forest.of_roots(comm, scene.mesh, scene.pairing)
    while True:
        try:
            return repartition(forest, None, kind)[0]
        except PartitionError:
            if forest.size_global > 64 * comm.size:
                raise
        forest, _ = forest.refined(np.ones(len(forest), dtype=bool))


def _refine(step, tolerance):
    """The next forest and the displacement carried along, at the corners of its leaves (n, 8, 3)."""
    marked = np.zeros(len(step.forest), dtype=bool)
    marked[step.leaf_mesh.leaf] = step.estimate.marked(tolerance)
    values = step.elasticity.prolongation.prolong(step.contact.displacement)
    forest, glue = step.forest.refined(marked)
    return forest, glue.carry(values[step.forest.vertices.cells])


def _contact_results(scene, pairs, contact, comm):
    """Force, radius, pressure and penetration of the whole bodies, whatever symmetry was used."""
    if pairs is None:
        return dict(active_pairs=0, force=0.0, contact_radius=0.0, max_pressure=0.0, max_penetration=0.0)
    force = contact.force
    arm = pairs.position - scene.contact_centre
    radius2 = (arm**2).sum(axis=1) - np.einsum("ni,ni->n", arm, pairs.normal) ** 2
    total, moment, active = comm.allreduce(np.array([force.sum(), force @ radius2, contact.active.sum()]), op=MPI.SUM)
    pressure = comm.allreduce(float((force / pairs.area).max(initial=0.0)), op=MPI.MAX)
    return {
        "active_pairs": int(active),
        "force": float(total * scene.symmetry),
        "contact_radius": float(np.sqrt(2.5 * moment / total)) if total else 0.0,
        "max_pressure": pressure,
        "max_penetration": comm.allreduce(float(contact.penetration.max(initial=0.0)), op=MPI.MAX),
    }
