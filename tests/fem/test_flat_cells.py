"""Blocks of nodes that flat cells couple: which they are, and iterations that do not depend on the aspect."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from model_problems import conforming_positions, discrete, grown, roots, strewn
from mpi4py import MPI
from petsc4py import PETSc

from fx_contact import ContactPair, Dirichlet, Material, Scene, Solver, Traction, adapt
from fx_contact.fem.coarse_level import FLAT, strong_blocks
from fx_contact.linalg.p_multigrid import solved_here, within_blocks
from studies.boxes import DOWN, UP, Boxes

pytestmark = pytest.mark.ranks(1, 2, 3)


def slab(aspect, poisson=0.3):
    """Three layers of flat cells on a rigid base, pressed in the middle."""
    boxes, height = Boxes(1), 3 / aspect
    boxes.add("slab", (-3, -3, 0), (3, 3, height), (6, 6, 3))
    surfaces = {"base": boxes.facets(DOWN, 0.0), "top": boxes.facets(UP, height, within=1.1)}
    conditions = (Dirichlet("base", 0.0, 0.0, 0.0),)
    loads = (Traction("top", (0.0, 0.0, -1e-6)),)
    return Scene("slab", boxes.mesh(surfaces), {"slab": Material(1.0, poisson)}, conditions, (), loads)


def elasticity_of(scene, distribute=lambda forest: forest):
    """Elasticity of degree 2 on the root cells."""
    return discrete(scene, distribute(roots(scene)), degree=2)


def test_cubes_have_no_blocks():
    """Nor have cells of less than the limit."""
    assert strong_blocks(elasticity_of(slab(1.0))) is None
    assert strong_blocks(elasticity_of(slab(0.99 * FLAT))) is None


@pytest.mark.parametrize("aspect, lines", [(1.01 * FLAT, (0, 1)), (0.99 / FLAT, (2,))])
def test_blocks_are_lines_along_short_axes(aspect, lines):
    """Nodes above each other are a block in flat cells, those of a layer in tall ones, also where ranks cut them."""
    elasticity = elasticity_of(slab(aspect), strewn)
    blocks = np.concatenate(WORLD.allgather(strong_blocks(elasticity)))
    position, _ = conforming_positions(elasticity.prolongation.space.forest, elasticity.prolongation)
    position = np.concatenate(WORLD.allgather(position))
    assert len(np.unique(blocks)) == (13**2 if len(lines) == 2 else 7)
    for block in np.unique(blocks):
        assert np.ptp(position[blocks == block][:, lines], axis=0).max() < 1e-12


def test_hanging_nodes_are_in_no_block():
    """Blocks of a refined mesh are of conforming nodes; all of these have one."""
    scene = slab(4.0)
    elasticity = discrete(scene, strewn(grown(roots(scene), 1, share=0.2)), degree=2)
    assert elasticity.prolongation.hanging_global > 0
    blocks = strong_blocks(elasticity)
    assert len(blocks) == elasticity.prolongation.owned
    everywhere(len(blocks) == 0 or blocks.min() >= 0, "a node without a block")


def test_entries_within_blocks():
    """They are those of the matrix, and no others are kept; each block is solved for by one rank."""
    elasticity = elasticity_of(slab(4.0), strewn)
    matrix = elasticity.stiffness().mat
    matrix.assemble()
    blocks = strong_blocks(elasticity)
    kept, here = within_blocks(matrix, blocks), solved_here(matrix, blocks).getIndices()
    local, everything = np.arange(*kept.getOwnershipRange()), np.arange(kept.getSize()[0])
    whole, part = (
        m.convert(PETSc.Mat.Type.AIJ, PETSc.Mat()).getValues(local.astype("i4"), everything.astype("i4"))
        for m in (matrix, kept)
    )
    block = np.repeat(np.concatenate(WORLD.allgather(blocks)), 3)
    same = block[local][:, None] == block
    rounding = 1e-14 * np.abs(whole).max(initial=1)
    everywhere((np.abs(part - np.where(same, whole, 0.0)) <= rounding).all(), "other entries")
    everywhere((part[~same] == 0).all(), "blocks are coupled")
    assert (np.sort(np.concatenate(WORLD.allgather(here))) == everything).all()
    everywhere(not np.isin(block[here], np.delete(block, here)).any(), "a block of two ranks")
    everywhere(WORLD.size == 1 or 0.1 < len(here) * WORLD.size / len(everything) < 1.7, "one rank solves for most")


def iterations(aspect, poisson=0.3):
    """Of the last solve of the slab."""
    (step,) = adapt(slab(aspect, poisson), 0.9, degree=2, max_steps=1, geometry_order=1)
    assert step.record.preconditioner == "p-multigrid"
    return step.record.krylov_iterations[-1]


@pytest.mark.parametrize("poisson", [0.3, 0.49])
def test_iterations_hardly_depend_on_the_aspect(poisson):
    """At most twice those on cubes, on any number of ranks."""
    cubes = iterations(1.0, poisson)
    assert cubes > 5
    found = [iterations(aspect, poisson) for aspect in (4.0, 16.0, 100.0, 1000.0)]
    assert max(found) < 2 * cubes, (cubes, found)


def test_contact_that_changes():
    """The penalty of closed contact changes the matrix, and with it the smoother: the solution is that of Cholesky."""
    boxes = Boxes(1)
    boxes.add("lower", (-3, -3, -0.5), (3, 3, 0), (6, 6, 2))
    boxes.add("upper", (-3, -3, 0), (3, 3, 0.5), (6, 6, 2))
    surfaces = {"base": boxes.facets(DOWN, -0.5), "top": boxes.facets(UP, 0.5, within=1.1)}
    surfaces |= {"below": boxes.facets(UP, 0.0, "lower"), "above": boxes.facets(DOWN, 0.0, "upper")}
    scene = Scene(
        "receding contact",
        boxes.mesh(surfaces),
        dict.fromkeys(("lower", "upper"), Material(1.0, 0.3)),
        (Dirichlet("base", 0.0, 0.0, 0.0), Dirichlet("top", x=0.0, y=0.0)),
        (ContactPair("below", "above", direction=(0, 0, 1)),),
        (Traction("top", (0.0, 0.0, -1e-3)),),
    )
    one, other = (next(adapt(scene, 0.9, max_steps=1, solver=Solver(name))) for name in ("p-multigrid", "cholesky"))
    assert one.record.preconditioner == "p-multigrid" and one.record.contact_iterations > 3
    everywhere((one.solution.active == other.solution.active).all(), "another active set")
    most = WORLD.allreduce(float(other.solution.force.max(initial=0)), op=MPI.MAX)
    everywhere(np.abs(one.solution.force - other.solution.force).max(initial=0) < 1e-6 * most, "other forces")
