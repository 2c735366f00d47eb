"""Scores the four kinds of partition for 2 to 8192 parts, and predicts the strong scaling of an adaptive step.

The forests are those of adaptive runs of both benchmarks, every leaf refined once more, at degree 2 twice: over a
million leaves at degree 1. Each rank scores one benchmark by itself, so two ranks halve the time. A million leaves at
degree 2 take 10 GB a rank, so that the pages show what --quick gives there:

    mpirun -n 2 python3 -m studies.partition.run --quick
    mpirun -n 2 python3 -m studies.partition.run
    mpirun -n 2 python3 -m studies.partition.run --degree 2 --quick

It leaves in results/partition table.csv, model.csv, kernels.csv (at degree 2 table_degree2.csv and so on), quality.csv,
cost.md and pictures.
"""

import argparse
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from mpi4py import MPI

from demos.common import RankZeroParser, plain_errors
from fx_contact import adapt
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.leaf_graph import create_leaf_graph
from fx_contact.forest.partition import KINDS, Units, curve_keys
from fx_contact.parallel.errors import OutputError, PartitionError
from fx_contact.parallel.exchange import FEW_RANKS
from fx_contact.parallel.mpi import together
from fx_contact.plot import draw_parts
from fx_contact.scenes import hertz, indentation
from studies import tables
from studies.partition.figures import draw_cuts, side_by_side
from studies.partition.measures import Judge, Quality
from studies.partition.partitions import REPEATED, history, of_middle_cut, parents, partitions
from studies.partition.partners import Exchanges, Partners
from studies.partition.scaling_kernels import TIMES, counted, measure, migration
from studies.partition.scaling_model import Network, predict
from studies.partition.tables import model, quality, table

#: Benchmarks: how to make the scene on one rank, the tolerances of the run and of the quick one at degree 1 and 2,
#: unknowns in the paper, half width of the picture [m].
BENCHMARKS = {
    "hertz": (partial(hertz, comm=MPI.COMM_SELF), {1: (0.035, 0.07), 2: (0.004, 0.01)}, 18.3e6, 0.25),
    "indentation": (indentation, {1: (0.051, 0.1), 2: (0.03, 0.06)}, 295.9e6, 1.0),
}
#: Tolerances of the runs in which the kernels are measured, and of those of --quick, at degree 1 and 2.
TOLERANCES = {1: (0.05, 0.12), 2: (0.01, 0.05)}
COMM = MPI.COMM_WORLD


@dataclass(frozen=True)
class Score:
    """One row of the study.

    Attributes:
        scene: name of the benchmark.
        leaves, dofs: of its forest.
        kind: of the partition.
        quality: Quality.
        partners: Partners.
        seconds: to make the partition, once keys and graph are there.
    """

    scene: str
    leaves: int
    dofs: int
    kind: str
    quality: Quality
    partners: Partners
    seconds: float


def show(*words):
    """Print on rank 0."""
    if COMM.rank == 0:
        print(*words, flush=True)


def draw_in_32(name, forests, lineage, folder):
    """Pictures of each kind in 32 parts, as the paper's figure 3, of the first forest of 20,000 leaves or more."""
    make, *_, reach = BENCHMARKS[name]
    chosen = next((i for i, forest in enumerate(forests) if len(forest) >= 20_000), len(forests) - 1)
    forest, pictures = forests[chosen], {}
    pieces = {pairs: Units(forest, pairs) for pairs in (True, False)}
    judge = Judge(forest, Prolongation(Space(forest, 1)))
    for made in partitions(forests[: chosen + 1], lineage, 32, pieces):
        found, path = judge.score(made.part, 32), folder / f"{name}_{made.kind}_32.png"
        pictures[f"{made.kind}: {found.cut_facets:,} cut facets, {found.split_pairs:,} split pairs"] = path
        draw_parts(forest, made.part, make().contact_centre or (0.0, 0.0, 0.0), reach, path)
    side_by_side(pictures, f"{name}, {len(forest):,} leaves in 32 parts", folder / f"{name}_32.png")


def scored(name, degree, quick, most, folder):
    """All scores of one benchmark, and its cost in seconds.  Local."""
    make, tolerances, _, _ = BENCHMARKS[name]
    forests = history(make, tolerances[degree][quick], degree)
    lineage = [None, *(parents(a, b) for a, b in zip(forests, forests[1:]))]
    draw_in_32(name, forests, lineage, folder)

    forest, cost = forests[-1], {}
    if most > len(forest) // 2:
        raise PartitionError(
            f"--parts {most} is too much for the {len(forest):,} leaves of {name}: at most half of them"
        )
    pieces = {pairs: Units(forest, pairs) for pairs in (True, False)}
    # Nothing is known yet of leaves in random order, and nothing sorted.
    strewn = [forest.ordered(np.random.default_rng(0).permutation(len(forest))) for _ in range(2)]
    for title, step in {
        "keys": lambda: curve_keys(strewn[0]),
        "keys and sort": lambda: Units(strewn[1], True),
        "graph": lambda: pieces[True].graph,
    }.items():
        start = time.perf_counter()
        step()
        cost[title] = time.perf_counter() - start
    prolongation = Prolongation(Space(forest, degree))
    judge, dofs = Judge(forest, prolongation), 3 * prolongation.index_map.size_global
    exchanges = Exchanges(forest, prolongation, create_leaf_graph(forest))
    rows = []
    for parts in 2 ** np.arange(1, int(np.log2(most)) + 1):
        for made in partitions(forests, lineage, int(parts), pieces):
            part = made.part
            if made.kind == "graph" and parts <= REPEATED:
                part = of_middle_cut(pieces[KINDS[made.kind].pairs], int(parts), part)
            cuts = None if parts <= FEW_RANKS else made.cuts  # as in a run
            partners = exchanges.count(int(parts), part, cuts, made.rows, made.sums)
            quality = judge.score(part, int(parts))
            rows.append(Score(name, len(forest), dofs, made.kind, quality, partners, made.seconds))
        cuts = ", ".join(f"{row.kind} {row.quality.cut_facets:,}" for row in rows[-len(KINDS) :])
        print(f"{name}, {len(forest):,} leaves in {parts} parts, cut facets: {cuts}", flush=True)
    return rows, cost


def predicted(rows, kernels):
    """Seconds by stage: benchmark -> kind -> parts -> dict, at the size that the paper's meshes have."""
    result = {}
    for row in rows:
        if row.quality.parts < 32:
            continue
        dofs = BENCHMARKS[row.scene][2]
        scale = dofs / row.dofs
        # A part has more leaves, and each cut of the curve is found so many rounds later.
        later, sums = max(np.log2(scale), 0) * (row.kind != "equidistributed"), row.partners
        partners = replace(
            sums, reductions=sums.reductions + later, summed=sums.summed + later * (row.quality.parts - 1)
        )
        seconds = predict(replace(row, partners=partners), scale * row.leaves, dofs, kernels, Network(), scale)
        result.setdefault(row.scene, {}).setdefault(row.kind, {})[row.quality.parts] = seconds
    return result


def cost_table(costs, rows, moved):
    """What making a partition costs, in Markdown."""
    lines = ["| step | " + " | ".join(costs) + " |", "|---|" + "--:|" * len(costs)]
    leaves = {row.scene: row.leaves for row in rows}
    for title in next(iter(costs.values())):
        values = (f"{1e6 * cost[title] / leaves[name]:.2f}" for name, cost in costs.items())
        lines.append(f"| {title}, one rank, microseconds a leaf | " + " | ".join(values) + " |")
    for kind in KINDS:
        for parts in sorted({row.quality.parts for row in rows} & {2, 32, 1024}):
            found = {row.scene: row.seconds for row in rows if (row.kind, row.quality.parts) == (kind, parts)}
            values = (f"{1e6 * found[name] / leaves[name]:.2f}" for name in costs)
            lines.append(f"| {kind}, {parts} parts, microseconds a leaf | " + " | ".join(values) + " |")
    seconds, size, count = moved
    lines.append(
        f"\nMigration of all {count:,} leaves to the next of {COMM.size} ranks: "
        f"{1e6 * seconds * COMM.size / count:.2f} microseconds a leaf of a rank, {size} bytes a leaf."
    )
    return "\n".join(lines)


def main():
    """Parse and run."""
    options = RankZeroParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="forests of some 100,000 leaves: two minutes")
    options.add_argument("--degree", type=int, choices=(1, 2), default=1, help="of the displacements (%(default)s)")
    options.add_argument("--parts", type=int, default=8192, help="most parts, 32 or more (%(default)s)")
    options.add_argument("--output", type=Path, default=Path("results/partition"), help="folder (%(default)s)")
    arguments = options.parse_args()
    if arguments.parts < 32 or arguments.parts & (arguments.parts - 1):
        options.error("--parts must be a power of two, and 32 or more for the prediction")
    with plain_errors(COMM):
        study(arguments)


def folder_for(path):
    """Make the folder of results; OutputError if that cannot be done.  Collective."""
    with together(COMM):
        if COMM.rank == 0:
            try:
                path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError(
                    f"cannot make the folder {str(path)!r}: {error}; name another with --output"
                ) from error
    return path


def study(arguments):
    """Score, measure, predict; all is written as soon as it is known.  Collective."""
    folder, degree = folder_for(arguments.output), arguments.degree
    with together(COMM):
        mine = {
            name: scored(name, degree, arguments.quick, arguments.parts, folder)
            for name in list(BENCHMARKS)[COMM.rank :: COMM.size]
        }
    found = {name: result for part in COMM.allgather(mine) for name, result in part.items()}
    rows = [row for name in BENCHMARKS for row in found[name][0]]
    made_by = f"mpirun -n {COMM.size} python3 -m studies.partition.run --parts {arguments.parts}"
    made_by += f" --degree {degree}" * (degree > 1) + " --quick" * arguments.quick
    if COMM.rank == 0:
        tables.write(folder / "quality.csv", list(quality(rows)), made_by)
        keep(folder, "table", degree, table(rows), made_by)
        draw_cuts(table(rows), folder / "cut.png")
    forecast(arguments, rows, {name: found[name][1] for name in BENCHMARKS}, made_by)
    show(f"results in {folder}")


def keep(folder, name, degree, rows, made_by):
    """Write rows to NAME.csv, at degree 2 NAME_degree2.csv, and show them as the page does.  Rank 0."""
    path = folder / f"{name}{'_degree2' * (degree > 1)}.csv"
    tables.write(path, rows, made_by)
    show(tables.TABLES[f"studies/partition/{path.name}"](rows))


def forecast(arguments, rows, costs, made_by):
    """Measure kernels, and predict the time of a step; made_by is the command.  Collective."""
    folder, degree = arguments.output, arguments.degree
    tolerance = TOLERANCES[degree][arguments.quick]
    *_, last = adapt(hertz(), tolerance, degree=degree)
    moved = (*migration(COMM, last.forest), last.forest.size_global)
    del last
    write(cost_table(costs, rows, moved), folder / "cost.md")

    counts = counted(COMM, tolerance, degree)
    if COMM.rank == 0:
        kernels = replace(measure(tolerance, degree), **counts)
        keep(folder, "kernels", degree, [{name: 1e6 * getattr(kernels, name) for name in TIMES}], made_by)
        dofs = {name: BENCHMARKS[name][2] for name in BENCHMARKS}
        keep(folder, "model", degree, list(model(predicted(rows, kernels), dofs)), made_by)


def write(text, path):
    """Show a text and keep it."""
    if COMM.rank == 0:
        path.write_text(text + "\n")
    show(text)


if __name__ == "__main__":
    main()
