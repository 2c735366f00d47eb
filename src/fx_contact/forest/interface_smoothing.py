"""Shorter interfaces between the parts of a partition, at equal balance.

A space-filling curve cuts a mesh into parts with ragged interfaces.  Two steps straighten them.

1. Flow by mean curvature on a coarse graph, whose vertices are octree cells, some dozens a part: the indicators of the
   parts diffuse, then each cell joins the part of its largest indicator less a price; the prices keep the parts equally
   heavy.  This is auction dynamics (M. Jacobs, E. Merkurjev, S. Esedoglu, J. Comput. Phys. 354, 2018).  Where parts are
   few, and interfaces large, it is repeated on finer graphs.
2. Single vertices on an interface change sides where this shortens it (B. Kernighan, S. Lin, Bell Syst. Tech. J. 49,
   1970).

The flow ends in a minimum near its start.  With few parts it starts twice: from the pieces of the curve, and from
shells around the finest leaves, which lie where the bodies touch or stress is singular.  The shorter result counts.

Integers only, and sums that do not depend on their order: the result is the same on any number of ranks.
"""

import numpy as np
from mpi4py import MPI
from scipy.sparse import csr_matrix

from fx_contact.forest import space_filling_curve
from fx_contact.parallel.exchange import Exchange

#: Cells of the coarse graphs in a part of mean weight, one graph after the other.  All but the first graph must have
#: fewer cells than the second number; smaller graphs are gathered on every rank.  Measured in studies/partition.
BOXES, MOST_BOXES = (32, 128, 512), 1 << 14
#: Least leaves in a cell of a coarse graph but the first: on smaller meshes finer graphs cost more than they bring.
LEAST = 128
#: Least mean weight of a part for which interfaces flow.
WORTHWHILE = 1000
#: Most parts for which shells are tried as a second start.
FEW = 16
#: Diffusion steps between two decisions, and the most decisions.
STEPS, DECISIONS = 16, 10
#: Weight of a part over the mean that is allowed while the interfaces flow.
SLACK = 1.05
#: Rounds in which single vertices change sides, and most rounds while a part is still too heavy.
ROUNDS, PATIENCE = 16, 64
#: The indicator 1 as an integer.
_ONE = 1 << 20


def smoothed(graph, keys, weights, part, parts, limit):
    """Move vertices between parts so that fewer edges are cut.

    Collective on graph.comm.

    Args:
        graph: Graph.
        keys: (n,) int64, position of each vertex along the space-filling curve, distinct.
        weights: (n,) int64, positive.
        part: (n,) int32, the parts to start from; each of them lies on one rank.
        parts: number of parts.
        limit: most weight of a part.

    Returns:
        (n,) int32 parts, as given if they cannot be improved within the limit.
    """
    starts, mean = [], graph.comm.allreduce(int(weights.sum())) / parts
    if mean >= WORTHWHILE:
        starts.append(_straight(graph, keys, weights, part, parts))
        if parts <= FEW and BOXES[-1] in graphs(parts, mean):
            starts.append(_straight(graph, keys, weights, part, parts, shells=True))
    for chosen in (starts, [part]):
        ends = [_exchanged(graph, keys, weights, start, parts, limit) for start in chosen]
        light = [end for end in ends if _loads(graph.comm, end, weights, parts).max() <= limit]
        best = min(light, key=graph.cut, default=part)
        if graph.cut(best) < graph.cut(part):
            return best
    return part


def graphs(parts, mean):
    """Cells a part of the coarse graphs on which interfaces flow, one after the other.

    Local.

    Args:
        parts: number of parts.
        mean: their mean weight.

    Returns:
        tuple of int.
    """
    return BOXES[:1] + tuple(n for n in BOXES[1:] if n * parts <= MOST_BOXES and n * LEAST <= mean)


def _straight(graph, keys, weights, home, parts, shells=False):
    """The parts after the flow of their interfaces on coarse graphs; some may be too heavy, by `SLACK`.

    A cell of a coarse graph lies in one part of `home`, and each of these on one rank.  So the cells are the same on
    any number of ranks.
    """
    comm, part = graph.comm, home
    mean = comm.allreduce(int(weights.sum())) / parts
    for boxes in graphs(parts, mean):
        group, first, bits = _boxes(keys, weights, home.astype(np.int64) * parts + part, mean / boxes)
        coarse = graph.contracted(group, len(first))
        heavy = np.bincount(group, weights=weights, minlength=len(first)).astype(np.int64)
        state = {"keys": keys[first], "weights": heavy, "start": part[first], "bits": bits}
        if boxes * parts <= MOST_BOXES:  # all of it on every rank costs less than hundreds of messages
            mine = slice(coarse.offset, coarse.offset + coarse.size)
            state = {name: np.concatenate(comm.allgather(values)) for name, values in state.items()}
            coarse = coarse.gathered()
        else:
            mine = slice(None)
        flowed = _flowed(coarse, **state, parts=parts, mean=mean, shells=shells and boxes == BOXES[0])
        part = flowed[mine][group]
    return part


def _flowed(graph, *, keys, weights, start, bits, parts, mean, shells):
    """The parts of the cells after the flow of their interfaces.  Collective on graph.comm."""
    if shells:
        start = _shells(graph.comm, keys, bits, weights, parts)
    heaviest = graph.comm.allreduce(int(weights.max(initial=0)), op=MPI.MAX)
    slack = max(SLACK * mean, mean + heaviest)
    return _exchanged(graph, keys, weights, _flow(graph, weights, start, parts, slack), parts, slack)


def _shells(comm, keys, bits, weights, parts):
    """Parts of equal weight from the smallest cells to the largest: (n,) int32.  Collective on comm."""
    order = keys | bits // 3 << 58
    return np.searchsorted(space_filling_curve.cut_curve(comm, order, weights, parts), order, side="right").astype(
        np.int32
    )


def _loads(comm, part, weights, parts):
    """Weight of every part: (parts,) int64.  Collective on comm."""
    loads = np.bincount(part, weights=weights, minlength=parts).astype(np.int64)
    comm.Allreduce(MPI.IN_PLACE, loads)
    return loads


def _boxes(keys, weights, part, most):
    """The largest octree cells, restricted to a part, that are not heavier than a limit.

    Returns:
        (n,) int64, cell of each vertex; (m,) int64, first vertex of each cell; (m,) int64, number of low bits of the
        key in which the vertices of a cell may differ.
    """
    order = np.lexsort((keys, part))
    along, parts, heavy = keys[order], part[order], weights[order]
    box, size, first = np.arange(len(order)), np.zeros(len(order), dtype=np.int64), order
    for bits in range(3, 63, 3):
        new = np.ones(len(along), dtype=bool)
        new[1:] = (along[1:] >> bits != along[:-1] >> bits) | (parts[1:] != parts[:-1])
        number = np.cumsum(new) - 1
        fits = np.bincount(number, weights=heavy)[number] <= most
        if not fits.any():
            break
        size[fits] = bits
        kept = new | ~fits  # a cell that is too heavy stays in pieces, and so do all that contain it
        number = np.cumsum(kept) - 1
        box, heavy = number[box], np.bincount(number, weights=heavy)
        along, parts, size, first = along[kept], parts[kept], size[kept], first[kept]
    group = np.empty(len(order), dtype=np.int64)
    group[order] = box
    return group, first, size


def _flow(graph, weights, part, parts, limit):
    """Let the interfaces flow by their mean curvature: the parts of the least cut within the limit, (n,) int32."""
    comm = graph.comm
    degree = np.maximum(graph.degree, 1)
    prices = np.zeros(parts, dtype=np.int64)
    total = comm.allreduce(graph.size)
    best, shortest = part, graph.cut(part)
    for _ in range(DECISIONS):
        before = part
        indicators = csr_matrix(
            (np.full(graph.size, _ONE), part, np.arange(graph.size + 1)), shape=(graph.size, parts)
        )
        for _ in range(STEPS):
            around = graph.matrix @ graph.ghosted_rows(indicators)
            indicators.data *= np.repeat(degree, np.diff(indicators.indptr))
            indicators = (indicators + around).tocsr()
            indicators.data //= np.repeat(2 * degree, np.diff(indicators.indptr))
            indicators.eliminate_zeros()
        part, loads = _auction(comm, indicators, weights, prices, limit)
        length = graph.cut(part)
        if length < shortest and loads.max() <= limit:
            best, shortest = part, length
        if comm.allreduce(int((part != before).sum())) < 1e-3 * total:  # STEPS bounds it anyway: this saves time
            break
    return best


def _auction(comm, indicators, weights, prices, limit):
    """Each vertex joins the part of its largest indicator, less its price; prices change until no part is too heavy.

    Collective on comm.  `prices` is changed.

    Returns:
        (n,) int32 parts, (parts,) int64 their weights.
    """
    parts = len(prices)
    bits = int(parts).bit_length()
    step, before = np.full(parts, _ONE / 20), np.zeros(parts)
    for _ in range(30):
        # One integer holds the offer, and below it the part: equal offers go to the lowest part.
        offer = ((indicators.data - prices[indicators.indices]) << bits) + (parts - indicators.indices)
        part = (parts - (np.maximum.reduceat(offer, indicators.indptr[:-1]) & (1 << bits) - 1)).astype(np.int32)
        loads = _loads(comm, part, weights, parts)
        if loads.max() <= limit:
            break
        excess = np.clip(loads * parts / loads.sum() - 1, -1, 1)
        step *= np.where(excess * before < 0, 0.5, 1.2)
        before = excess
        prices += np.rint(2 * step * excess).astype(np.int64)
    return part, loads


def _exchanged(graph, keys, weights, part, parts, limit):
    """The parts, (n,) int32, after vertices on interfaces have changed sides as long as this helps.

    Collective on graph.comm.  In one round vertices go to parts of higher number only, in the next to lower ones:
    neighbours do not swap places.
    """
    part = part.copy()
    loads = _loads(graph.comm, part, weights, parts)
    mean = loads.sum() / parts
    heaviest = graph.comm.allreduce(int(weights.max(initial=0)), op=MPI.MAX)
    quiet = 0
    for number in range(PATIENCE):
        # Where all parts around a heavy one are full, those above the mean make room.
        most = limit if number < ROUNDS else mean
        vertex, target, gain = _offers(graph, weights, part, loads, most, upward=number % 2 == 0)
        # A part that is too heavy gives vertices away at a loss, but no more than needed.
        willing = gain >= 0
        loss, spare = vertex[~willing], np.maximum(loads - np.int64(most), 0) + heaviest
        willing[~willing] = _admitted(graph.comm, part[loss], gain[~willing], keys[loss], weights[loss], spare)
        vertex, target, gain = vertex[willing], target[willing], gain[willing]
        taken = _admitted(graph.comm, target, gain, keys[vertex], weights[vertex], np.int64(limit) - loads)
        part[vertex[taken]] = target[taken]
        loads = _loads(graph.comm, part, weights, parts)
        quiet = 0 if graph.comm.allreduce(int(taken.sum())) else quiet + 1
        if quiet == 2 or (number + 1 >= ROUNDS and loads.max() <= limit):
            break
    return part


def _offers(graph, weights, part, loads, most, upward):
    """The best change of side of each vertex on an interface, where it helps.

    Returns:
        (k,) int64 vertices, (k,) int32 parts to go to, (k,) int64 weight of the edges that are cut no more.
    """
    parts = len(loads)
    everywhere = graph.ghosted(part)
    differs = np.flatnonzero(everywhere[graph.matrix.indices] != part[graph.rows])
    row, data = graph.rows[differs], graph.matrix.data[differs]
    there, here = everywhere[graph.matrix.indices[differs]], part[row]
    kept = graph.degree - np.bincount(row, weights=data, minlength=graph.size).astype(np.int64)
    across = there > here if upward else there < here
    pairs, slot = np.unique(row[across] * parts + there[across], return_inverse=True)
    vertex, target = np.divmod(pairs, parts)
    gain = np.bincount(slot, weights=data[across], minlength=len(pairs)).astype(np.int64) - kept[vertex]
    own = loads[part[vertex]]
    evens_out = loads[target] + weights[vertex] < own
    helps = (gain > 0) | evens_out & ((gain == 0) | (own > most))
    vertex, target, gain = vertex[helps], target[helps], gain[helps]
    order = np.lexsort((target, -gain, vertex))
    best = order[np.diff(vertex[order], prepend=-1) != 0]
    return vertex[best], target[best].astype(part.dtype), gain[best]


def _admitted(comm, part, gain, keys, weights, room):
    """Which of all ranks' candidates find room in a part: the most useful first, equals in the order of the curve.

    Collective on comm.  Each part is decided on by one rank.

    Args:
        comm: MPI communicator.
        part: (n,) int, the part that each candidate asks.
        gain, keys, weights: (n,) int64 of the candidates.
        room: (parts,) int64, how much weight each part admits.

    Returns:
        (n,) bool.
    """
    exchange = Exchange(comm, part.astype(np.int64) * comm.size // len(room))
    part, gain, keys, weights = exchange.forward(np.stack([part, gain, keys, weights], axis=1)).T
    order = np.lexsort((keys, -gain, part))
    weight, first = np.cumsum(weights[order]), np.flatnonzero(np.diff(part[order], prepend=-1))
    before = (weight - weights[order])[first]
    weight -= np.repeat(before, np.diff(np.append(first, len(order))))
    admitted = np.empty(len(order), dtype=bool)
    admitted[order] = weight <= room[part[order]]
    return exchange.backward(admitted)
