"""The stiffness without entries is the assembled one: products, held forces, blocks, factors, and whole solutions."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import (
    DISTRIBUTIONS,
    EXACT,
    STEEL,
    conforming_positions,
    discrete,
    grown,
    pressed,
    roots,
    strewn,
    two_boxes,
)
from mpi4py import MPI

from fx_contact import Elastic, Enforcement, Material, Orthotropic, Solver, block, root_mesh_from_shapes
from fx_contact.contact.contact_problem import ContactProblem, SolveOptions
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm, reserve
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.coarse_level import create_coarse_level
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.elasticity import Elasticity
from fx_contact.fem.sum_factorisation import energy_norm, matrix_free
from fx_contact.fem.supports import Supports
from fx_contact.law.contact_solver import solve_contact
from fx_contact.linalg.matrix import as_aij, diagonal_blocks
from fx_contact.parallel.errors import CompilationError, SolveError
from fx_contact.parallel.timing import Stages

pytestmark = pytest.mark.ranks(1, 2, 3)

WOOD = Orthotropic((12.0, 1.0, 0.6), (0.4, 0.35, 0.3), (0.7, 0.6, 0.05), axes=((1, 2, 0), (0, 0, 1)))
#: Materials of the upper box: of the lower one, STEEL.
MATERIALS = {"isotropic": STEEL, "orthotropic": WOOD, "rubber": Material(1.0, 0.49), "mixed": Material(1.0, 0.49)}


def meshed_apart():
    """A box on a block with other cells, by the names of `two_boxes`."""
    bodies = {"lower": block((0, 0, -1), (2, 2, 0), (2, 2, 1), 1), "upper": block((0, 0, 0), (2, 2, 1), (3, 3, 2), 1)}
    names = {"lower z low": "lower bottom", "upper z high": "upper top", "upper x high": "upper right"}
    return root_mesh_from_shapes(bodies, names | {"lower contact": "lower top", "upper contact": "upper bottom"})


def discretised(material=STEEL, distribution="strewn", springs=True, apart=False, **mesh):
    """Two boxes with hanging nodes, their elasticity, rows of contact, and supports with an oblique plane."""
    mesh = meshed_apart() if apart else two_boxes(**{"distortion": 0.15, **mesh})
    scene = pressed(mesh, materials=(STEEL, material))
    if springs:
        scene = replace(scene, springs=(Elastic("upper x high", normal=3.0, x=2.0),))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 2, share=0.2))
    elasticity = discrete(scene, forest, scene.mesh.order, degree=2)
    assert elasticity.prolongation.hanging_global > 0
    position, _ = conforming_positions(forest, elasticity.prolongation)
    free, normal = position[:, [2, 0, 1]] > 0.3, np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    nodes = np.flatnonzero((position[:, 0] > 0.5) & free.all(axis=1))
    along = np.broadcast_to(np.eye(3) - np.outer(normal, normal), (len(nodes), 3, 3))
    supports = Supports(np.where(free, np.nan, np.sin(position)), (nodes, along))
    return elasticity, create_rows(scene, elasticity.prolongation, Enforcement()), supports, position


def product(mat, u):
    """A matrix times a displacement."""
    x, y = mat.createVecs()
    x.array[:] = u.ravel()
    mat.mult(x, y)
    return y.array.reshape(-1, 3).copy()


def close(one, other, tolerance, what):
    """Arrays agree relative to the largest entry on any rank."""
    scale = WORLD.allreduce(float(np.abs(other).max(initial=0.0)), op=MPI.MAX)
    assert scale > 0
    everywhere(np.abs(one - other).max(initial=0.0) <= tolerance * scale, what)


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize("material", [*MATERIALS, "meshed apart"])
def test_product(material, distribution):
    """To 1e-13, with the penalty of contact; oblique planes, prescribed components and springs."""
    apart = material == "meshed apart"
    given = WOOD if apart else MATERIALS[material]
    elasticity, rows, supports, position = discretised(given, distribution, apart=apart)
    mixed = material == "mixed"
    entire = elasticity.stiffness(rows, mixed, supports)
    free = matrix_free(elasticity, rows, mixed, supports)
    close(*(supports.free_part(one.held) for one in (free, entire)), 1e-13, "other held forces")
    volume = elasticity.volume_term(supports) if mixed else None
    moved = supports.admissible(np.sin(3 * position)) + np.array([0.0, 0.0, 1e4]) * (material != "mixed")
    energy = energy_norm(elasticity, free, volume)(moved), elasticity.energy_norm(moved)
    assert abs(energy[0] / energy[1] - 1) < 1e-10 and energy_norm(elasticity, entire, volume)(moved) == energy[1]
    jump = Jump(rows, supports)
    for one in (entire, free):
        reserve(one.mat, jump)
        PenaltyTerm(jump, rows.stiffness).add_to(one.mat)
        supports.add_normal_part(one.mat, np.ones_like(position))
    u = np.sin(3 * position + [0.0, 1.0, 2.0])
    u = np.where(supports.free, u, 0.0)
    close(product(free.mat, u), product(entire.mat, u), 1e-13, "another product")
    close(product(as_aij(free.mat), u), product(entire.mat, u), 1e-13, "another product with entries")
    held = np.where(supports.free, 0.0, 1.0)
    everywhere((product(free.mat, held)[supports.free] == 0).all(), "constrained directions are coupled")
    diagonal = free.mat.getDiagonal().array.reshape(-1, 3)
    close(product(free.mat, held)[~supports.free], diagonal[~supports.free], 1e-14, "another diagonal where held")


@pytest.mark.parametrize("order, affine", [(1, True), (1, False), (2, False)])
def test_cells(order, affine):
    """Boxes keep one point each; so do all others as many as they need."""
    elasticity, rows, supports, position = discretised(
        order=order, distortion=0.0 if affine else 0.15, bend=0.1 if order > 1 else 0.0, springs=False
    )
    free = matrix_free(elasticity, rows, supports=supports)
    cells = free.mat.getPythonContext().operator._cells
    points = WORLD.allreduce({some.metric.shape[1] for some in cells}, op=MPI.Op.Create(lambda a, b, _: a | b))
    assert points == {1} if affine else 27 in points
    u = np.where(supports.free, np.cos(position), 0.0)
    entire = elasticity.stiffness(rows, supports=supports)
    for one in (entire, free):
        one.mat.assemble()
    close(product(free.mat, u), product(entire.mat, u), 1e-13, "another product")


@pytest.mark.parametrize("material", ["orthotropic", "rubber"])
def test_diagonal_blocks(material):
    """They are those of the matrix where no node hangs, and positive definite where they do."""
    elasticity, rows, supports, position = discretised(MATERIALS[material])
    free, entire = matrix_free(elasticity, None, False, supports), elasticity.stiffness(None, False, supports)
    for one in (free, entire):
        one.mat.assemble()
    unknowns = np.arange(*entire.mat.getOwnershipRange(), dtype=np.int32).reshape(-1, 3)
    ours, theirs = (
        np.array([mat.getValues(i, i) for i in unknowns]).reshape(-1, 3, 3)
        for mat in (diagonal_blocks(free.mat), entire.mat)
    )
    prolongation = elasticity.prolongation
    masters = np.unique(prolongation.matrix[prolongation.hanging].indices)
    alone = prolongation.zeros(1)
    alone[masters] = 1.0
    alone = prolongation.summed(alone)[:, 0] == 0
    everywhere(WORLD.allreduce(int(alone.sum())) > 20, "hardly a node without hanging ones")
    close(ours[alone], theirs[alone], 1e-13, "other blocks")
    along = np.abs(np.linalg.eigvalsh(ours)).min(axis=1) / np.abs(ours).max(axis=(1, 2))
    planes = np.isin(np.arange(len(ours)), supports.oblique_nodes)
    everywhere((along[~planes] > 1e-3).all() and (np.einsum("nii->ni", ours) >= 0).all(), "not positive")


def test_blocks_follow_the_matrix():
    """The inverses of the smoother are those of the matrix with another penalty."""
    elasticity, rows, supports, _ = discretised()
    mat, jump = matrix_free(elasticity, rows, False, supports).mat, Jump(rows, supports)
    reserve(mat, jump)
    for factor in (0.0, 1.0, 5.0):
        PenaltyTerm(jump, factor * rows.stiffness).add_to(mat)
        blocks = diagonal_blocks(mat)
        inverses = np.asarray(blocks.invertBlockDiagonal()).reshape(-1, 3, 3).swapaxes(1, 2)
        unknowns = np.arange(*mat.getOwnershipRange(), dtype=np.int32).reshape(-1, 3)
        values = np.array([blocks.getValues(i, i) for i in unknowns]).reshape(-1, 3, 3)
        off = np.abs(inverses @ values - np.eye(3)).max(axis=(1, 2), initial=0.0)
        planes = np.isin(np.arange(len(off)), supports.oblique_nodes)
        everywhere((off[~planes] < 1e-6).all(), "inverses of another matrix")


@pytest.mark.parametrize("preconditioner", [None, "boomeramg", "boomeramg-robust", "cholesky"])
@pytest.mark.parametrize("material", ["isotropic", "rubber"])
def test_solution(material, preconditioner):
    """Displacements, active rows and forces are those by the matrix, with every preconditioner."""
    scene = pressed(two_boxes(distortion=0.15), materials=(STEEL, MATERIALS[material]))
    forest = strewn(grown(roots(scene), 2, share=0.2))
    elasticity = discrete(scene, forest, degree=2)
    rows = create_rows(scene, elasticity.prolongation, Enforcement())
    supports = find_supports(scene, forest, elasticity.prolongation)
    mixed = elasticity.mixed and preconditioner != "cholesky"
    solver, found = replace(EXACT, preconditioner=preconditioner), []
    for make in (matrix_free, Elasticity.stiffness):
        matrix = make(elasticity, rows, mixed, supports)
        coarse = create_coarse_level(elasticity, supports) if preconditioner is None else None
        volume = elasticity.volume_term(supports) if mixed else None
        zero = np.zeros_like(supports.prescribed)
        terms = (elasticity.energy_norm, rows, None, coarse, volume)
        found.append(
            solve_contact(ContactProblem(matrix, zero, supports, *terms), zero, SolveOptions(solver), Stages())
        )
    ours, theirs = found
    close(ours.displacement, theirs.displacement, 1e-7, "other displacements")
    everywhere((ours.active == theirs.active).all(), "other rows are closed")
    close(ours.force, theirs.force, 1e-7, "other forces")
    assert abs(sum(ours.krylov_iterations) - sum(theirs.krylov_iterations)) <= 0.2 * sum(theirs.krylov_iterations) + 2


def test_factors_take_over():
    """Where p-multigrid fails, factors of the assembled matrix replace it."""
    elasticity, rows, supports, position = discretised()
    zero = np.zeros_like(position)
    matrix, coarse = matrix_free(elasticity, None, False, supports), create_coarse_level(elasticity, supports)
    problem = ContactProblem(matrix, zero, supports, elasticity.energy_norm, coarse=coarse)
    assert solve_contact(problem, zero, SolveOptions(Solver(max_krylov=3)), Stages()).preconditioner == "cholesky"


def test_no_compiler(monkeypatch):
    """Without a C compiler there is no product: the same error on all ranks."""
    elasticity, rows, supports, _ = discretised(springs=False)
    monkeypatch.setenv("CC", "/bin/false")
    with pytest.raises(CompilationError, match="there is a C compiler"):
        matrix_free(elasticity, rows, False, supports)


def test_no_memory(monkeypatch):
    """The metric would not fit: an error before it is made."""
    elasticity, rows, supports, _ = discretised(springs=False)
    monkeypatch.setattr("fx_contact.parallel.memory.available", partial(int, 1000))
    with pytest.raises(SolveError, match="the stiffness of .* unknowns needs"):
        matrix_free(elasticity, rows, False, supports)
