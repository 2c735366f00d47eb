"""Products with half of a symmetric matrix are those with the whole one, on ranks with many, few and no rows."""

import ctypes

import numpy as np
import pytest
from conftest import WORLD, everywhere
from dolfinx.common import IndexMap
from petsc4py import PETSc
from scipy.sparse import csr_matrix, identity
from scipy.sparse import random as random_matrix
from scipy.sparse import vstack

from fx_contact.linalg import petsc_objects, symmetric_product
from fx_contact.linalg.matrix import create_matrix
from fx_contact.parallel.errors import CompilationError

pytestmark = pytest.mark.ranks(1, 2, 3)


def filled(symmetric, rows):
    """A matrix with the same random symmetric blocks in each format, each rank's rows after those of the one before."""
    count, first = WORLD.allreduce(rows), WORLD.exscan(rows) or 0
    graph = random_matrix(count, count, 0.1, format="csr", random_state=1)
    graph = ((graph + graph.T + identity(count)) != 0).tocsr()
    mine = np.arange(first, first + rows)
    ghosts = np.setdiff1d(np.unique(graph[mine].indices), mine).astype(np.int64)
    owner = np.searchsorted(np.cumsum(WORLD.allgather(rows)), ghosts, side="right").astype(np.int32)
    imap = IndexMap(WORLD, rows, ghosts, owner)
    local = np.concatenate([mine, ghosts])
    known = vstack([graph[mine][:, local], csr_matrix((len(ghosts), len(local)), dtype=bool)], format="csr")
    matrix = create_matrix(WORLD, known, imap, symmetric)
    for row in mine:
        for column in graph[row].indices:
            low, high = sorted((row, column))
            block = np.random.default_rng([low, high]).normal(size=(3, 3))
            block = block + block.T if low == high else block if row == low else block.T
            matrix.mat.setValuesBlocked([row], [column], np.ascontiguousarray(block), addv=PETSc.InsertMode.ADD)
    matrix.mat.assemble()
    return matrix.mat


def product(mat):
    """This rank's entries of the product with numbers that all ranks agree on."""
    x, y = mat.createVecs()
    first, last = mat.getOwnershipRange()
    x.array[:] = np.sin(np.arange(first, last))
    mat.mult(x, y)
    return y.array_r.copy()


@pytest.mark.parametrize("rows", [(30, 30, 30), (59, 1, 30), (30, 0, 60)], ids=str)
def test_product(rows):
    """The product of the half that is stored is that of the whole matrix."""
    half, whole = (filled(symmetric, rows[WORLD.rank]) for symmetric in (True, False))
    assert "sbaij" in half.type and "sbaij" not in whole.type
    everywhere(np.allclose(product(half), product(whole), rtol=0, atol=1e-13), "product")
    for mat in (half, whole):
        for row in range(*(end // 3 for end in mat.getOwnershipRange())):
            mat.setValuesBlocked([row], [row], 5.0 * np.eye(3), addv=PETSc.InsertMode.ADD)
        mat.assemble()
    everywhere(np.allclose(product(half), product(whole), rtol=0, atol=1e-13), "product after a change")


def test_own_loop(monkeypatch):
    """PETSc multiplies by this loop: with another sign in it the product is another."""
    before = product(filled(True, 9))
    monkeypatch.setattr(symmetric_product, "_SOURCE", symmetric_product._SOURCE.replace("+= sum", "-= sum"))
    everywhere(not np.allclose(product(filled(True, 9)), before), "the loop is not in use")


@pytest.mark.parametrize("kind", [ctypes.c_int, ctypes.c_bool])
def test_type_of_petsc_bool(monkeypatch, kind):
    """By the bytes that PETSc writes: of an int, or of one byte."""
    true = bytes(kind(True))

    class Library:
        """PETSc of some release."""

        def __init__(self, _):
            """Loaded."""

        def PetscInitialized(self, place):  # noqa: N802
            """Writes a PetscBool."""
            ctypes.memmove(place, true, len(true))

    monkeypatch.setattr(petsc_objects.ctypes, "CDLL", Library)
    assert petsc_objects.bool_type() is kind


def test_no_compiler(monkeypatch):
    """Without a C compiler there is no matrix: the same error on all ranks."""
    monkeypatch.setenv("CC", "/bin/false")
    with pytest.raises(CompilationError, match="there is a C compiler"):
        filled(True, 2)
