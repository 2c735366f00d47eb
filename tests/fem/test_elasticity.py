"""Stiffness and contact terms on the conforming unknowns, against matrices gathered to every rank."""

import numpy as np
import pytest
import ufl
from conftest import WORLD, everywhere
from dolfinx.fem import form
from dolfinx.fem.petsc import assemble_matrix
from model_problems import (
    DISTRIBUTIONS,
    STEEL,
    conforming_positions,
    corner_scene,
    discrete,
    gathered,
    gathered_prolongation,
    grown,
    numbered,
    pressed,
    prolongation_of,
    roots,
    scramble,
    side_by_side,
    two_boxes,
)
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import coo_matrix, identity, kron

from fx_contact.contact.enforcement import Enforcement
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import PenaltyTerm, reserve
from fx_contact.contact.row_kinds import create_rows
from fx_contact.fem.dirichlet import find_supports
from fx_contact.fem.supports import Supports
from fx_contact.items.materials import Material

pytestmark = pytest.mark.ranks(1, 2, 3)


def by_key(rows, keys):
    """Positions of the three unknowns of each vertex in a matrix ordered by key."""
    return (3 * np.searchsorted(keys, rows)[:, None] + np.arange(3)).ravel()


def gathered_matrix(matrix, names, keys):
    """A PETSc matrix with blocks named by keys, on every rank, ordered by ascending key.  Collective."""
    place = by_key(names, keys)
    indptr, columns, values = matrix.getValuesCSR()
    rows = matrix.getOwnershipRange()[0] + np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    values, rows, columns = (gathered(WORLD, part) for part in (values, place[rows], place[columns]))
    return coo_matrix((values, (rows, columns)), shape=(3 * len(keys),) * 2).tocsr()


def full_stiffness(elasticity):
    """K on all nodes as dolfinx assembles it, gathered, ordered by key; its blocks at one node are added."""
    trial, test = ufl.TrialFunction(elasticity.function_space), ufl.TestFunction(elasticity.function_space)
    dx = ufl.Measure("dx", elasticity.mesh, metadata={"quadrature_degree": elasticity.quadrature_degree})
    matrix = assemble_matrix(form(ufl.inner(elasticity.hooke(trial), ufl.sym(ufl.grad(test))) * dx))
    matrix.assemble()
    imap = elasticity.function_space.dofmap.index_map
    names = gathered(WORLD, elasticity.prolongation.space.keys[elasticity.node_of_block[: imap.size_local]])
    keys = np.unique(names)
    shared = len(keys) == len(names) == imap.size_global
    assert shared or elasticity.prolongation.space.degree > 1, "dolfinx does not share the forest's vertices"
    return gathered_matrix(matrix, names, keys)


def largest(matrix):
    """Largest entry by modulus."""
    return np.abs(matrix.data).max(initial=0)


SCENES = dict(distortion=0.2), dict(margin=1, flat_contact=False), dict(order=2, bend=0.1)


@pytest.fixture(params=SCENES, ids=["alike", "wider", "curved"])
def scene(request):
    return pressed(two_boxes(**request.param))


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_stiffness_is_the_product(scene, distribution, degree):
    """P^T K P assembled cell by cell equals the product of the gathered matrices, to 1e-12."""
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 4 - degree, share=0.1))
    elasticity = discrete(scene, forest, scene.mesh.order, degree)
    assert elasticity.prolongation.hanging_global > 50
    total, _, columns = gathered_prolongation(elasticity.prolongation)
    total = kron(total, identity(3))
    expected = total.T @ full_stiffness(elasticity) @ total
    matrix = elasticity.stiffness().mat
    matrix.assemble()
    found = gathered_matrix(matrix, numbered(elasticity.prolongation), columns)
    assert largest(found - expected) < 1e-12 * largest(expected)
    assert matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["mallocs"] == 0


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize("contact", ["flat", "in a corner"])
def test_contact_term_is_the_product(distribution, contact):
    """With pairs active the matrix is P^T K P + B^T diag(k) B of the gathered pairs; closing and opening undo it."""
    scene = pressed(two_boxes(margin=1)) if contact == "flat" else corner_scene()
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 3, share=0.1))
    elasticity = discrete(scene, forest)
    prolongation = elasticity.prolongation
    pairs = create_rows(scene, prolongation, Enforcement())
    names = numbered(prolongation)
    keys = np.sort(names)
    supports = find_supports(scene, forest, prolongation)
    imap, nodes = prolongation.index_map, pairs.entries.node.astype(np.int32)
    first, second = imap.local_to_global(nodes[::2]), imap.local_to_global(nodes[1::2])
    everywhere(contact != "flat" or len(np.unique(first)) == len(first), "a vertex in two pairs")
    active = scramble(names[first], 4) % np.uint64(2) == 0
    assert 5 < WORLD.allreduce(int(active.sum())) < WORLD.allreduce(len(pairs)) - 5

    plain = elasticity.stiffness().mat
    plain.assemble()
    stiff = gathered_matrix(plain, names, keys)
    matrix = elasticity.stiffness(pairs).mat
    jump = Jump(pairs, supports)
    term = PenaltyTerm(jump, pairs.stiffness)
    reserve(matrix, jump)
    matrix.assemble()
    assert matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["mallocs"] == 0
    assert largest(gathered_matrix(matrix, names, keys) - stiff) < 1e-14 * largest(stiff)

    # B of the gathered pairs on the components that are free: rows +n at the first and -n at the second vertex.
    free = np.zeros((len(keys), 3))
    mine = np.searchsorted(keys, gathered(WORLD, names[slice(*imap.local_range)]))
    free[mine] = np.isnan(gathered(WORLD, supports.prescribed))
    normal, k, on = (gathered(WORLD, column) for column in (pairs.normal, pairs.stiffness, active))
    count = len(normal)
    rows = np.repeat(np.arange(count), 3)
    ends = [by_key(names[gathered(WORLD, column)], keys) for column in (first, second)]
    shape = count, 3 * len(keys)
    b = sum(coo_matrix((sign * normal.ravel(), (rows, end)), shape) for sign, end in zip((1, -1), ends))
    b = b @ coo_matrix((free.ravel(), (np.arange(3 * len(keys)),) * 2))
    expected = (b.T @ coo_matrix((k * on, (np.arange(count),) * 2)) @ b).tocsr()
    term.of(active).add_to(matrix)
    found = gathered_matrix(matrix, names, keys)
    assert largest(expected) > largest(stiff)
    assert largest(found - stiff - expected) < 1e-12 * largest(expected)
    term.of(1.0 - 2.0 * active).add_to(matrix)
    opposite = (b.T @ coo_matrix((k * ~on, (np.arange(count),) * 2)) @ b).tocsr()
    found = gathered_matrix(matrix, names, keys)
    assert largest(found - stiff - opposite) < 1e-12 * largest(expected)


def test_pairs_are_local_on_the_contact_partition(scene):
    """Both vertices of every pair are owned by its rank: B^T B is the same where messages are forbidden."""
    forest = DISTRIBUTIONS["contact-sfc"](grown(roots(scene), 3, share=0.1))
    elasticity = discrete(scene, forest)
    prolongation = elasticity.prolongation
    pairs = create_rows(scene, prolongation, Enforcement("penalty"))
    assert WORLD.allreduce(int(len(pairs) > 0)) > min(1, WORLD.size - 1), "one rank holds all pairs"
    everywhere((pairs.first < prolongation.owned).all(), "a first vertex belongs to another rank")
    everywhere((pairs.entries.node < prolongation.owned).all(), "a second vertex belongs to another rank")
    matrix = elasticity.stiffness(pairs).mat
    jump = Jump(pairs, Supports(np.full((prolongation.owned, 3), np.nan)))
    reserve(matrix, jump)
    matrix.assemble()
    silent, before = matrix.duplicate(copy=True), matrix.norm()
    silent.setOption(PETSc.Mat.Option.NO_OFF_PROC_ENTRIES, True)
    for one in (matrix, silent):
        PenaltyTerm(jump, pairs.stiffness).add_to(one)
    assert matrix.norm() > 2 * before
    assert (matrix - silent).norm() == 0


def free_boxes(distribution):
    """Elasticity, rows and jump of two boxes with hanging nodes, of which nothing is prescribed."""
    scene = pressed(two_boxes(margin=1))
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 3, share=0.1))
    elasticity = discrete(scene, forest)
    prolongation = elasticity.prolongation
    pairs = create_rows(scene, prolongation, Enforcement())
    jump = Jump(pairs, Supports(np.full((prolongation.owned, 3), np.nan)))
    return elasticity, pairs, jump


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
def test_hypre_copy_follows_the_blocks(distribution):
    """Every row is as long as foreseen; the copy in hypre's format is the same matrix, after a change of status too."""
    elasticity, pairs, jump = free_boxes(distribution)
    blocks = elasticity.stiffness(pairs)
    reserve(blocks.mat, jump)
    blocks.mat.assemble()
    info = blocks.mat.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)
    foreseen = WORLD.allreduce(sum(int(lengths.sum()) for lengths in blocks.row_lengths))
    assert info["nz_used"] == info["nz_allocated"] == 9 * foreseen

    mat = blocks.mat.copy()
    copy = blocks.in_format_of("hypre")
    assert copy.type == "hypre"
    x, expected = mat.createVecs()
    found = expected.duplicate()
    x.array[:] = np.sin(scramble(np.arange(*mat.getOwnershipRange()), 5).astype(float))
    active = (
        scramble(pairs.prolongation.index_map.local_to_global(pairs.first.astype(np.int32)), 4) % np.uint64(2) == 0
    )
    term = PenaltyTerm(jump, pairs.stiffness)
    for change in (0.0 * active, 1.0 * active, 1.0 - 2.0 * active):
        reference = expected.copy()
        for matrix, y in ((mat, expected), (copy, found)):
            term.of(change).add_to(matrix)
            matrix.mult(x, y)
        assert (expected - found).norm() < 1e-14 * expected.norm()
        moved = (expected - reference).norm() > 0.1 * expected.norm()
        assert moved or not change.any()


@pytest.mark.parametrize("distribution", list(DISTRIBUTIONS))
@pytest.mark.parametrize("make", [corner_scene, side_by_side])
def test_pairs_of_two_surfaces(make, distribution):
    """Where two contact pairs of a scene meet, in a corner or a plane, areas of node pairs add up to both surfaces'."""
    scene = make()
    forest = DISTRIBUTIONS[distribution](grown(roots(scene), 2))
    pairs = create_rows(scene, prolongation_of(scene, forest), Enforcement())
    vertical = np.abs(pairs.normal[:, 2]) > 0.5
    for which, exact in ((vertical, 2), (~vertical, 2)) if make is corner_scene else ((vertical, 4),):
        area = WORLD.allreduce(pairs.area[which].sum())
        assert abs(area - exact) < 1e-13, f"{exact - area} m^2 of contact surface have no node pair"
    if make is side_by_side:
        assert WORLD.allreduce(int((np.abs(pairs.position[:, 0] - 1) < 1e-9).sum())) >= 4, "no pairs on the seam"


def test_same_pairs_on_any_distribution():
    """Area, stiffness, normal and position of each pair are those of a serial run."""
    scene = pressed(two_boxes(margin=1, order=2, bend=0.1), direction=None)
    columns = []
    for comm, distribution in ((MPI.COMM_SELF, "roots"), *((WORLD, d) for d in DISTRIBUTIONS)):
        forest = DISTRIBUTIONS[distribution](grown(roots(scene, comm), 3, share=0.1))
        prolongation = prolongation_of(scene, forest)
        pairs = create_rows(scene, prolongation, Enforcement())
        keys = numbered(prolongation)[prolongation.index_map.local_to_global(pairs.entries.node.astype(np.int32))]
        names = [gathered(comm, side) for side in (keys[::2], keys[1::2])]
        order = np.argsort(names[0])
        rows = gathered(comm, np.column_stack([pairs.area, pairs.stiffness, pairs.normal, pairs.position, pairs.gap]))
        columns.append((names[0][order], names[1][order], rows[order]))
    assert len(columns[0][0]) > 30
    for first, second, rows in columns[1:]:
        assert np.array_equal(first, columns[0][0]) and np.array_equal(second, columns[0][1])
        assert np.abs(rows - columns[0][2]).max() < 1e-13 * np.abs(rows).max()


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_fields_do_not_disturb_each_other(poisson):
    """Neither a displacement nor its mean volume strains change by another, nor by energies: its forces stay."""
    scene = pressed(two_boxes(bend=0.2), materials=(STEEL, Material(young=1.0, poisson=poisson)))
    forest = grown(roots(scene), 2, share=0.2)
    elasticity = discrete(scene, forest)
    position, _ = conforming_positions(forest, elasticity.prolongation)
    one = elasticity.field(position**2)
    functions = [one.function, *filter(None, [one.projected])]
    before, forces = [function.x.array.copy() for function in functions], elasticity.internal_forces(one)
    other = elasticity.internal_forces(elasticity.field(np.sin(position)))
    assert WORLD.allreduce(float(np.abs(other - forces).sum())) > 0
    assert elasticity.energy_norm(np.sin(position)) > 0 and elasticity.change_norm(np.cos(position)) > 0
    same = [(function.x.array == values).all() for function, values in zip(functions, before)]
    everywhere(all(same) and len(same) == 1 + (poisson > 0.4), "another displacement")
    everywhere((elasticity.internal_forces(one) == forces).all(), "other forces")


def test_ranks_without_leaves():
    """One rank has all of them: the matrix is assembled and gives rigid motions no force."""
    forest = roots(pressed(two_boxes(), contact=False))
    forest, _ = forest.moved(np.full(len(forest), WORLD.size - 1))
    matrix = discrete(pressed(two_boxes(), contact=False), forest).stiffness().mat
    matrix.assemble()
    x, y = matrix.createVecs()
    x.set(1.0)
    matrix.mult(x, y)
    assert y.norm() < 1e-13 * matrix.norm() * x.norm()
