"""A MODEL of the time of an adaptive step on many processors: exact halo counts, measured kernels, a stated network.

Each part computes at the rate that was measured here, and exchanges messages that cost a latency each and their bytes
over a bandwidth (the alpha-beta model); a reduction costs log2 P latencies.  The slowest part sets the pace.
"""

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
from fx_contact.parallel.exchange import FEW_RANKS
from fx_contact.scenes import hertz

STAGES = ("tree", "assemble", "setup", "solve", "estimate")
#: A cluster of many-core nodes, not measured, stated: latency of a message between two processors [s], bandwidth of one
#: processor while all of its node send, 100 Gbit/s for 128 processors [B/s], one level of an all-reduce [s].
LATENCY, BANDWIDTH, REDUCTION = 2e-6, 12.5e9 / 128, 3e-6
#: Matrix products in a V-cycle on a level: Chebyshev of second order before and after, residual, and two transfers.
PRODUCTS = 7
#: Exchanges on a level while the hierarchy is set up: strength, coarsening, interpolation, triple product.
SETUP_EXCHANGES = 12
#: Reductions of an iteration of PCG in the natural norm.
REDUCTIONS = 2
#: Exchanges by keys in a step, there and back, bytes that they move a cell at the surface of a part over those of a
#: displacement there, sums over all ranks for the cuts of the curve, and numbers in these over the cuts: 29 exchanges
#: were counted on 64 ranks (7af08d1); 51 sums of 9 P to 18 P numbers, and 7 keys a cell (8 bytes each), once each, on
#: forests of a million leaves (5653145).
EXCHANGES, KEY_BYTES, CUT_SUMS, CUT_NUMBERS = 29, 7 * 8 / 24, 51, 13
#: Runs, of which each kernel's shortest time counts: other programs disturb, and only ever for the worse.
REPEATS = 3
#: Products of matrix and vector that are timed together.
TIMED = 20
#: Measured: CPU seconds a cell of partition, mesh, hanging nodes and refinement, of assembly, of the estimate; and CPU
#: seconds an unknown of the preconditioner's set-up, of a matrix times a vector, of a V-cycle.
TIMES = ("tree", "assemble", "estimate", "setup", "product", "cycle")


def predict(score, dofs, kernels):
    """Seconds of the stages of one adaptive step.

    Args:
        score: row of `quality.csv`, a dict, of a mesh that may be smaller: halos grow with the surface of a part.
        dofs: of the mesh that is predicted.
        kernels: as `measure` gives them.

    Returns:
        dict: seconds of `STAGES` and of `total`, and `waiting`, the share of messages and reductions in the solve.
    """
    parts, scale = score["parts"], dofs / score["dofs"]
    most_dofs = score["imbalance"] * dofs / parts
    most_cells = most_dofs * score["leaves"] / score["dofs"]
    halo, reduction = score["halo_bytes_max"] * scale ** (2 / 3) / 2, REDUCTION * np.log2(parts)

    def exchange(rows=1.0, entries=1.0):
        """One halo exchange on a level, rows and entries a row relative to the finest."""
        holders = min(parts, max(dofs * rows, 1))
        messages = min(holders - 1, score["neighbours_max"] * max(1.0, entries))
        return LATENCY * messages + halo * rows ** (2 / 3) * max(1.0, entries) / BANDWIDTH

    hierarchy = _deepened(kernels["levels"], dofs)
    levels = np.array([exchange(rows, entries / hierarchy[0, 1]) for rows, entries in hierarchy])
    messages = exchange() + PRODUCTS * levels.sum() + (REDUCTIONS + 1) * reduction
    iteration = most_dofs * (kernels["product"] + kernels["cycle"]) + messages
    seconds = {
        "tree": most_cells * kernels["tree"] + _by_keys(score, most_cells, halo),
        "assemble": most_cells * kernels["assemble"] + exchange(),
        "setup": most_dofs * kernels["setup"] + SETUP_EXCHANGES * levels.sum() + len(levels) * reduction,
        "solve": kernels["iterations"] * iteration,
        "estimate": most_cells * kernels["estimate"] + 2 * exchange(),
    }
    return seconds | {"total": sum(seconds.values()), "waiting": messages / iteration}


def _by_keys(score, most_cells, halo):
    """Seconds of the exchanges by keys and of the sums for the cuts of the curve.

    Homes of keys are on the curve, so that parts have their neighbours as partners; of "equidistributed" and on few
    ranks they are hashed, so that all parts are partners and all keys travel.
    """
    parts = score["parts"]
    hashed = score["kind"] == "equidistributed" or parts <= FEW_RANKS
    partners = parts - 1 if hashed else score["neighbours_max"]
    moved = KEY_BYTES * (24 * most_cells if hashed else halo) / BANDWIDTH
    sums = 0.0 if score["kind"] == "equidistributed" else CUT_SUMS * REDUCTION * np.log2(parts)
    numbers = 0.0 if score["kind"] == "equidistributed" else 2 * 8 * CUT_NUMBERS * parts / BANDWIDTH
    return EXCHANGES * 4 * LATENCY * partners + moved + sums + numbers


def _deepened(levels, dofs):
    """Levels of a hierarchy, coarsened on by the same factor until ten unknowns are left."""
    factor = (levels[-2, 0] / levels[1, 0]) ** (1 / max(len(levels) - 3, 1))
    result = list(levels[:-1])
    while result[-1][0] * dofs > 10 and factor < 1:
        result.append(np.array([result[-1][0] * factor, result[-1][1]]))
    return np.array(result)


def measure(tolerance):
    """Run the Hertz problem at degree 1 on one rank some times; the shortest CPU seconds of its last step's stages.

    Local.

    Returns:
        dict: `TIMES`; `iterations` of PCG, of all solves of a step; `levels`, rows of unknowns over those of the
        finest level and of entries a row.
    """
    runs = [_measured(tolerance) for _ in range(REPEATS)]
    return runs[0] | {name: min(run[name] for run in runs) for name in TIMES} | {"levels": _levels(tolerance)}


def _last_step(tolerance, **how):
    *_, step = adapt(hertz(), tolerance, MPI.COMM_SELF, degree=1, **how)
    return step


def _measured(tolerance):
    """Times and iterations of one run."""
    step = _last_step(tolerance)
    record = step.record
    cells, dofs, seconds, iterations = record.cells, record.dofs, record.cpu_seconds, sum(record.krylov_iterations)
    supports = find_supports(step.scene, step.forest, step.elasticity.prolongation)
    blocks = step.elasticity.stiffness(step.rows, supports=supports)
    reserve(blocks.mat, Jump(step.rows, supports))
    blocks.mat.assemble()
    matrix = blocks.in_format_of("hypre")
    x, y = matrix.createVecs()
    x.set(1.0)
    start = time.process_time()
    for _ in range(TIMED):
        matrix.mult(x, y)
    product = (time.process_time() - start) / TIMED
    return {
        "tree": sum(seconds[name] for name in ("partition", "hanging", "mesh", "refine")) / cells,
        "assemble": (seconds["assemble"] + seconds["system"]) / cells,
        "estimate": seconds["estimate"] / cells,
        "setup": seconds["setup"] / dofs,
        "product": product / dofs,
        "cycle": (seconds["solve"] / iterations - product) / dofs,
        "iterations": iterations,
    }


def _levels(tolerance):
    """Unknowns relative to the finest, and entries a row, of the levels of hypre's hierarchy, as hypre prints them."""
    with tempfile.TemporaryFile("w+") as printed:
        ctypes.CDLL(None).fflush(None)
        screen = os.dup(1)
        os.dup2(printed.fileno(), 1)
        try:
            step = _last_step(tolerance, solver=Solver(options={"pc_hypre_boomeramg_print_statistics": 1}))
            ctypes.CDLL(None).fflush(None)
        finally:
            os.dup2(screen, 1)
            os.close(screen)
        printed.seek(0)
        table = printed.read().split("Operator Matrix Information")[-1].split("Interpolation Matrix")[0]
    rows = re.findall(r"^ +\d+ +(\d+) +(\d+) +[\d.]+ +\d+ +\d+ ", table, flags=re.MULTILINE)
    unknowns, entries = np.array(rows, dtype=float).T
    return np.stack([unknowns / step.record.dofs, entries / unknowns], axis=1)
