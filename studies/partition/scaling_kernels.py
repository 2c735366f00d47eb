"""What the model of `scaling_model` needs to know of this machine, measured with the package's objects."""

import ctypes
import os
import re
import tempfile
import time

import numpy as np
from mpi4py import MPI

from fx_contact import Solver, adapt
from fx_contact.contact.jump import Jump
from fx_contact.contact.penalty_term import reserve
from fx_contact.fem.dirichlet import find_supports
from fx_contact.scenes import hertz
from studies.partition.scaling_model import KEYS

#: Runs, of which each kernel's shortest time counts: other programs disturb, and only ever for the worse.
REPEATS = 3
#: Products of matrix and vector that are timed together.
PRODUCTS = 20
#: Measured: CPU seconds a cell of partition, mesh, hanging nodes and refinement, of assembly, of the estimate; and CPU
#: seconds an unknown of the preconditioner's set-up, of a matrix times a vector, of a V-cycle.
TIMES = ("tree", "assemble", "estimate", "setup", "product", "cycle")


class Counting(MPI.Intracomm):
    """A communicator that counts the sparse all-to-all exchanges: each is an Alltoall, then an Alltoallv each way."""

    __module__ = MPI.Intracomm.__module__  # petsc4py takes communicators of mpi4py by the name of their module
    lengths = rows = away = 0

    def Alltoall(self, *buffers):  # noqa: N802
        """As MPI's, and count."""
        Counting.lengths += 1
        return super().Alltoall(*buffers)

    def Alltoallv(self, *buffers):  # noqa: N802
        """As MPI's, and count."""
        Counting.rows += 1
        _, sent, datatype = buffers[0]
        Counting.away += int(sent.sum() - sent[self.rank]) * datatype.Get_size()
        return super().Alltoallv(*buffers)

    @classmethod
    def last_step(cls, steps):
        """How many of both the last of adaptive steps took, and bytes a cell that this rank has sent to others."""
        for step in steps:
            counted, away = np.array([cls.lengths, cls.rows]), cls.away / step.record.cells
            cls.lengths = cls.rows = cls.away = 0
        return counted, away


def measure(tolerance, degree=1):
    """Run the Hertz problem on one rank some times and take the shortest seconds of its last step's stages.

    Local.  CPU seconds, which other programs disturb less.

    Args:
        tolerance: of the run.
        degree: of the displacements.

    Returns:
        dict: `TIMES`; `iterations` of PCG, of all solves of a step; `levels`, rows of unknowns over those of the
        finest level and of entries a row.
    """
    runs = [_measured(tolerance, degree) for _ in range(REPEATS)]
    return runs[0] | {name: min(run[name] for run in runs) for name in TIMES} | {"levels": _levels(tolerance, degree)}


def counted(comm, tolerance, degree=1):
    """How often rows travel in the last step of the Hertz problem, and how many bytes.  Collective on comm.

    Args:
        comm: MPI communicator.
        tolerance: of the run.
        degree: of the displacements.

    Returns:
        dict: `exchanges`, how often ranks tell each other how many rows will come, and how often rows travel; `volume`,
        bytes of those by keys over the bytes of all keys, `KEYS` a cell, once.
    """
    counts, away = Counting.last_step(adapt(hertz(comm=comm), tolerance, Counting(comm), degree=degree))
    # Of hashed keys one in as many as there are ranks stays.
    volume = comm.allreduce(away) * comm.size / max(comm.size - 1, 1) / KEYS[degree]
    return {"exchanges": counts.tolist(), "volume": volume}


def _measured(tolerance, degree):
    """Times and iterations of one run."""
    *_, step = adapt(hertz(comm=MPI.COMM_SELF), tolerance, MPI.COMM_SELF, degree=degree)
    record = step.record
    cells, dofs, seconds, iterations = record.cells, record.dofs, record.cpu_seconds, sum(record.krylov_iterations)
    supports = find_supports(step.scene, step.forest, step.elasticity.prolongation)
    blocks = step.elasticity.stiffness(step.rows, degree > 1, supports=supports)
    reserve(blocks.mat, Jump(step.rows, supports))
    blocks.mat.assemble()
    matrix = blocks.in_format_of("mg" if degree > 1 else "hypre")
    x, y = matrix.createVecs()
    x.set(1.0)
    start = time.process_time()
    for _ in range(PRODUCTS):
        matrix.mult(x, y)
    product = (time.process_time() - start) / PRODUCTS
    return {
        "tree": sum(seconds[name] for name in ("partition", "hanging", "mesh", "refine")) / cells,
        "assemble": (seconds["assemble"] + seconds["system"]) / cells,
        "estimate": seconds["estimate"] / cells,
        "setup": seconds["setup"] / dofs,
        "product": product / dofs,
        "cycle": (seconds["solve"] / iterations - product) / dofs,
        "iterations": iterations,
    }


def _levels(tolerance, degree):
    """Unknowns relative to the finest, and entries a row, of the levels of hypre's hierarchy, as hypre prints them.

    At degree 2 that hierarchy is below the finest level, which has the neighbours of the first below it.
    """
    options = {"mg_coarse_" * (degree > 1) + "pc_hypre_boomeramg_print_statistics": 1}
    with tempfile.TemporaryFile("w+") as printed:
        ctypes.CDLL(None).fflush(None)
        screen = os.dup(1)
        os.dup2(printed.fileno(), 1)
        try:
            solver = Solver(options=options)
            *_, step = adapt(hertz(comm=MPI.COMM_SELF), tolerance, MPI.COMM_SELF, degree=degree, solver=solver)
            ctypes.CDLL(None).fflush(None)
        finally:
            os.dup2(screen, 1)
            os.close(screen)
        printed.seek(0)
        table = printed.read().split("Operator Matrix Information")[-1].split("Interpolation Matrix")[0]
    rows = re.findall(r"^ +\d+ +(\d+) +(\d+) +[\d.]+ +\d+ +\d+ ", table, flags=re.MULTILINE)
    unknowns, entries = np.array(rows, dtype=float).T
    levels = np.stack([unknowns / step.record.dofs, entries / unknowns], axis=1)
    return levels if degree == 1 else np.concatenate([[[1.0, levels[0, 1]]], levels])
