"""A MODEL of the time of an adaptive step on many processors: exact halo counts, measured kernels, a stated network.

Each part computes at the rate that was measured here, and exchanges messages that cost a latency each and their bytes
over a bandwidth (the alpha-beta model); a reduction costs log2 P latencies.  The slowest part sets the pace.
"""

from dataclasses import dataclass

import numpy as np

from fx_contact.parallel.exchange import FEW_RANKS

STAGES = ("tree", "assemble", "setup", "solve", "estimate")


@dataclass(frozen=True)
class Network:
    """Constants of a cluster of many-core nodes: not measured, stated.

    Attributes:
        latency: of a message between two processors [s].
        bandwidth: of one processor while all of its node send [B/s]: 100 Gbit/s for 128 processors.
        reduction: of one level of an all-reduce [s].
    """

    latency: float = 2e-6
    bandwidth: float = 12.5e9 / 128
    reduction: float = 3e-6


@dataclass(frozen=True)
class Kernels:
    """What was measured on this machine.

    Attributes:
        tree, assemble, estimate: CPU seconds a cell: partition, mesh, hanging nodes and refinement; assembly of the
            matrix; recovery and indicator.
        setup, product, cycle: CPU seconds a dof: set-up of the preconditioner, matrix times vector, V-cycle.
        iterations: of PCG, all solves of an adaptive step together.
        exchanges: of an adaptive step: how often ranks tell each other how many rows will come, and how often rows
            travel, which they never do on one rank.
        volume: bytes of those by keys over the bytes of all keys, `KEYS` a cell, once; 0 on one rank.
        levels: (levels, 2) rows (unknowns over those of the finest level, entries a row) of the hierarchy.
    """

    tree: float
    assemble: float
    estimate: float
    setup: float
    product: float
    cycle: float
    iterations: int
    exchanges: tuple
    volume: float
    levels: np.ndarray


#: Bytes a cell of the keys of nodes, edges and faces, by degree: in a large mesh of hexahedra there are 1 or 8, 3 and 3
#: a cell.
KEYS = {1: 8 * 7, 2: 8 * 14}
#: Matrix products in a V-cycle on a level: Chebyshev of second order before and after, residual, and two transfers.
PRODUCTS = 7
#: Exchanges on a level while the hierarchy is set up: strength, coarsening, interpolation, triple product.
SETUP_EXCHANGES = 12
#: Reductions of an iteration of PCG in the natural norm.
REDUCTIONS = 2


def predict(score, cells, dofs, kernels, network, scale=1.0):
    """Seconds of the stages of one adaptive step.

    Args:
        score: Score of the partition, of a mesh that may be smaller: its kind, Quality and Partners.
        cells, dofs: of the mesh that is predicted.
        kernels: Kernels.
        network: Network.
        scale: volume of the predicted mesh over that of the scored one; halos grow with the surface, scale^(2/3).

    Returns:
        dict: seconds of `STAGES` and of `total`; of those of the tree `exchanges` and `reductions`; and `waiting`, the
        share of messages and reductions in the solve.
    """
    quality, parts = score.quality, score.quality.parts
    most_cells, most_dofs = quality.imbalance * cells / parts, quality.imbalance * dofs / parts
    halo, neighbours = quality.halo_bytes_max * scale ** (2 / 3) / 2, quality.neighbours_max
    reduction = network.reduction * np.log2(max(parts, 2)) * (parts > 1)

    def exchange(rows=1.0, entries=1.0):
        """One halo exchange on a level, rows and entries a row relative to the finest."""
        holders = min(parts, max(dofs * rows, 1))
        messages = min(holders - 1, neighbours * max(1.0, entries))
        return network.latency * messages + halo * rows ** (2 / 3) * max(1.0, entries) / network.bandwidth

    hierarchy = _deepened(kernels.levels, dofs)
    levels = np.array([exchange(rows, entries / hierarchy[0, 1]) for rows, entries in hierarchy])
    messages = exchange() + PRODUCTS * levels.sum() + (REDUCTIONS + 1) * reduction
    iteration = most_dofs * (kernels.product + kernels.cycle) + messages
    exchanges = _exchanges(score, kernels, network, scale) * (parts > 1)
    reductions = score.partners.reductions * reduction + 2 * 8 * score.partners.summed / network.bandwidth
    seconds = {
        "tree": most_cells * kernels.tree + exchanges + reductions,
        "assemble": most_cells * kernels.assemble + exchange(),
        "setup": most_dofs * kernels.setup + SETUP_EXCHANGES * levels.sum() + len(levels) * reduction,
        "solve": kernels.iterations * iteration,
        "estimate": most_cells * kernels.estimate + 2 * exchange(),
    }
    total = sum(seconds.values())
    return seconds | {
        "total": total,
        "exchanges": exchanges,
        "reductions": reductions,
        "waiting": messages / iteration,
    }


def _exchanges(score, kernels, network, scale):
    """Seconds of the exchanges of the tree.

    On few ranks they are all to all: numbers of rows, four bytes for each rank, in log2 P rounds (Bruck), then a
    message to each.  On more, a message and its acknowledgement for each partner and a barrier, then a message for
    each.  Rows go with the keys that leave a part: those that do not meet at home are at its surface, hashed ones
    everywhere in it.
    """
    parts, partners, rounds = score.quality.parts, score.partners.partners_max, np.log2(max(score.quality.parts, 2))
    lengths, rows = kernels.exchanges
    volume = scale if score.kind == "equidistributed" or parts <= FEW_RANKS else scale ** (2 / 3)
    moved = kernels.volume * score.partners.key_bytes_max / 2 * volume / network.bandwidth
    if parts <= FEW_RANKS:
        found, partners = rounds * (network.latency + 2 * parts / network.bandwidth), parts - 1
    else:
        found = 2 * network.latency * partners + network.reduction * rounds
    return lengths * found + rows * network.latency * partners + moved


def _deepened(levels, dofs):
    """Levels of a hierarchy, coarsened on by the same factor until ten unknowns are left."""
    factor = (levels[-2, 0] / levels[1, 0]) ** (1 / max(len(levels) - 3, 1))
    result = list(levels[:-1])
    while result[-1][0] * dofs > 10 and factor < 1:
        result.append(np.array([result[-1][0] * factor, result[-1][1]]))
    return np.array(result)
