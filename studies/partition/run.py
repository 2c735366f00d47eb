"""Scores the four kinds of partition for 2 to 8192 parts, and predicts the strong scaling of an adaptive step.

The forests are those of adaptive runs of both benchmarks at degree 1, every leaf refined once more.  Each rank scores
one benchmark by itself, so two ranks halve the time:

    mpirun -n 2 python3 -m studies.partition.run            # some 100,000 leaves: two minutes
    mpirun -n 2 python3 -m studies.partition.run --large    # over a million: 20 minutes

It leaves in results/partition table.csv, model.csv, kernels.csv, quality.csv and pictures.
"""

import argparse
from pathlib import Path

import numpy as np
from mpi4py import MPI

from demos.common import RankZeroParser, plain_errors
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.partition import KINDS, Units
from fx_contact.parallel.errors import OutputError, PartitionError
from fx_contact.parallel.mpi import together
from fx_contact.plot.bodies import add_numbers
from fx_contact.plot.canvas import add_legend, look_at, plotter_for
from fx_contact.plot.surfaces import face_points, visible_faces
from fx_contact.scenes import hertz, indentation
from studies import tables
from studies.partition.cluster_model import TIMES, measure, predict
from studies.partition.figures import draw_cuts, side_by_side
from studies.partition.measures import Judge
from studies.partition.partitions import history, parents, partitions
from studies.partition.tables import model, table

#: Benchmarks: how to make the scene on one rank, the tolerances of the run and of the large one, unknowns in the paper,
#: half width of the picture [m].
BENCHMARKS = {"hertz": (hertz, (0.07, 0.035), 18.3e6, 0.25), "indentation": (indentation, (0.1, 0.051), 295.9e6, 1.0)}
#: Tolerance of the runs in which the kernels are measured.
TOLERANCE = 0.05
COMM = MPI.COMM_WORLD


def draw_in_32(name, forests, lineage, folder):
    """Pictures of each kind in 32 parts, as the paper's figure 3, of the first forest of 20,000 leaves or more."""
    make, *_, reach = BENCHMARKS[name]
    chosen = next((i for i, forest in enumerate(forests) if len(forest) >= 20_000), len(forests) - 1)
    forest, pictures, centre = forests[chosen], {}, np.array(make().contact_centre or (0.0, 0.0, 0.0))
    pieces = {pairs: Units(forest, pairs) for pairs in (True, False)}
    judge = Judge(forest, Prolongation(Space(forest, 1)))
    for kind, part in partitions(forests[: chosen + 1], lineage, 32, pieces):
        found, path = judge.score(part, 32), folder / f"{name}_{kind}_32.png"
        pictures["{}: {cut_facets:,} cut facets, {split_pairs:,} split pairs".format(kind, **found)] = path
        leaf, face = visible_faces(forest, centre, reach)
        points = face_points(forest, leaf, face)
        with plotter_for(path) as plotter:
            add_numbers(plotter, points, np.repeat(part[leaf], points.shape[1]), "part")
            look_at(plotter, centre, 0.7 * reach)
            add_legend(plotter, "")
    side_by_side(pictures, f"{name}, {len(forest):,} leaves in 32 parts", folder / f"{name}_32.png")


def scored(name, large, most, folder):
    """Rows of one benchmark: all measures of all partitions.  Local."""
    make, tolerances, _, _ = BENCHMARKS[name]
    forests = history(make, tolerances[large])
    lineage = [None, *(parents(a, b) for a, b in zip(forests, forests[1:]))]
    draw_in_32(name, forests, lineage, folder)

    forest = forests[-1]
    if most > len(forest) // 2:
        raise PartitionError(
            f"--parts {most} is too much for the {len(forest):,} leaves of {name}: at most half of them"
        )
    pieces = {pairs: Units(forest, pairs) for pairs in (True, False)}
    prolongation = Prolongation(Space(forest, 1))
    judge = Judge(forest, prolongation)
    about = {"benchmark": name, "leaves": len(forest), "dofs": 3 * prolongation.index_map.size_global}
    rows = []
    for parts in 2 ** np.arange(1, int(np.log2(most)) + 1):
        for kind, part in partitions(forests, lineage, int(parts), pieces):
            rows.append(about | {"kind": kind, "parts": int(parts), **judge.score(part, int(parts))})
        cuts = ", ".join(f"{row['kind']} {row['cut_facets']:,}" for row in rows[-len(KINDS) :])
        print(f"{name}, {len(forest):,} leaves in {parts} parts, cut facets: {cuts}", flush=True)
    return rows


def main():
    """Parse and run."""
    options = RankZeroParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--large", action="store_true", help="forests of over a million leaves: 20 minutes")
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
    folder, large = folder_for(arguments.output), arguments.large
    with together(COMM):
        mine = {
            name: scored(name, large, arguments.parts, folder) for name in list(BENCHMARKS)[COMM.rank :: COMM.size]
        }
    found = {name: rows for part in COMM.allgather(mine) for name, rows in part.items()}
    if COMM.rank:
        return
    rows = [row for name in BENCHMARKS for row in found[name]]
    made_by = f"mpirun -n {COMM.size} python3 -m studies.partition.run" + " --large" * large

    def keep(name, rows):
        """Write rows to NAME.csv, and show them."""
        tables.write(folder / f"{name}.csv", rows, made_by)
        print(tables.plain(rows), flush=True)

    tables.write(folder / "quality.csv", rows, made_by)
    keep("table", list(table(rows)))
    draw_cuts(list(table(rows)), folder / "cut.png")
    kernels = measure(TOLERANCE)
    keep("kernels", [{name: 1e6 * kernels[name] for name in TIMES}])
    dofs = {name: BENCHMARKS[name][2] for name in BENCHMARKS}  # at the size that the paper's meshes have
    keys = {(row["benchmark"], row["parts"], row["kind"]): row for row in rows if row["parts"] >= 32}
    predicted = {key: predict(row, dofs[key[0]], kernels) for key, row in keys.items()}
    keep("model", list(model(predicted, dofs)))
    print(f"results in {folder}")


if __name__ == "__main__":
    main()
