"""A MODEL of the time of an adaptive step on many processors: exact halo counts, measured kernels, a stated network.

Each part computes at the rate that was measured here, and exchanges messages that cost a latency each and their bytes
over a bandwidth (the alpha-beta model); a reduction costs log2 P latencies.  The slowest part sets the pace.
"""

import numpy as np

from fx_contact.parallel.exchange import FEW_RANKS

STAGES = ("tree", "assemble", "setup", "solve", "estimate")
#: A cluster of many-core nodes, not measured, stated: latency of a message between two processors [s], bandwidth of one
#: processor while all of its node send, 100 Gbit/s for 128 processors [B/s], one level of an all-reduce [s].
LATENCY, BANDWIDTH, REDUCTION = 2e-6, 12.5e9 / 128, 3e-6
#: Bytes a cell of the keys of nodes, edges and faces, by degree: in a large mesh of hexahedra there are 1 or 8, 3 and 3
#: a cell.
KEYS = {1: 8 * 7, 2: 8 * 14}
#: Matrix products in a V-cycle on a level: Chebyshev of second order before and after, residual, and two transfers.
PRODUCTS = 7
#: Exchanges on a level while the hierarchy is set up: strength, coarsening, interpolation, triple product.
SETUP_EXCHANGES = 12
#: Reductions of an iteration of PCG in the natural norm.
REDUCTIONS = 2


def predict(score, dofs, kernels):
    """Seconds of the stages of one adaptive step.

    Args:
        score: row of `quality.csv`, a dict, of a mesh that may be smaller: halos grow with the surface of a part.
        dofs: of the mesh that is predicted.
        kernels: as `scaling_kernels.measure` and `counted` give them.

    Returns:
        dict: seconds of `STAGES` and of `total`; of those of the tree `exchanges` and `reductions`; and `waiting`, the
        share of messages and reductions in the solve.
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
    exchanges = _exchanges(score, kernels, scale)
    # A part has more leaves than in the scored mesh, and each cut of the curve is found so many rounds later.
    later = max(np.log2(scale), 0) * (score["kind"] != "equidistributed")
    sums, numbers = score["reductions"] + later, score["summed"] + later * (parts - 1)
    reductions = sums * reduction + 2 * 8 * numbers / BANDWIDTH
    seconds = {
        "tree": most_cells * kernels["tree"] + exchanges + reductions,
        "assemble": most_cells * kernels["assemble"] + exchange(),
        "setup": most_dofs * kernels["setup"] + SETUP_EXCHANGES * levels.sum() + len(levels) * reduction,
        "solve": kernels["iterations"] * iteration,
        "estimate": most_cells * kernels["estimate"] + 2 * exchange(),
    }
    total = sum(seconds.values())
    return seconds | {
        "total": total,
        "exchanges": exchanges,
        "reductions": reductions,
        "waiting": messages / iteration,
    }


def _exchanges(score, kernels, scale):
    """Seconds of the exchanges of the tree.

    On few ranks they are all to all: numbers of rows, four bytes for each rank, in log2 P rounds (Bruck), then a
    message to each.  On more, a message and its acknowledgement for each partner and a barrier, then a message for
    each.  Rows go with the keys that leave a part: those that do not meet at home are at its surface, hashed ones
    everywhere in it.
    """
    parts, partners = score["parts"], score["partners_max"]
    lengths, rows = kernels["exchanges"]
    volume = scale if score["kind"] == "equidistributed" or parts <= FEW_RANKS else scale ** (2 / 3)
    moved = kernels["volume"] * score["key_bytes_max"] / 2 * volume / BANDWIDTH
    if parts <= FEW_RANKS:
        found, partners = np.log2(parts) * (LATENCY + 2 * parts / BANDWIDTH), parts - 1
    else:
        found = 2 * LATENCY * partners + REDUCTION * np.log2(parts)
    return lengths * found + rows * LATENCY * partners + moved


def _deepened(levels, dofs):
    """Levels of a hierarchy, coarsened on by the same factor until ten unknowns are left."""
    factor = (levels[-2, 0] / levels[1, 0]) ** (1 / max(len(levels) - 3, 1))
    result = list(levels[:-1])
    while result[-1][0] * dofs > 10 and factor < 1:
        result.append(np.array([result[-1][0] * factor, result[-1][1]]))
    return np.array(result)
