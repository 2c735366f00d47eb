"""Effectivity of the error estimate at both degrees: estimated over true error.

Each case is solved on meshes of half the estimated error each. The solution on the last one is the reference, with its
own estimate added in squares; of the manufactured solution the error is known.

    python3 -m studies.effectivity.run [--only WORD] [--degree P] [--most UNKNOWNS]

It leaves table.csv in results/effectivity.
"""

from functools import partial

import numpy as np

from demos.manufactured_solution import adapt_manufactured
from fx_contact import Dirichlet, ErrorControl, Material, Pressure, Scene, adapt, block, root_mesh_from_shapes
from fx_contact.adaptive.beginning import Beginning
from fx_contact.estimate.marking import for_tolerance
from fx_contact.results.accuracy import energy_distance
from fx_contact.scenes import hertz, indentation
from studies.tables import options, tabulate


def plate(poisson=0.3, slender=20):
    """Half of a square plate, clamped at one side, under pressure: free boundaries, one layer of cells."""
    shape = block((0, 0, 0), (slender, slender / 2, 1), (slender // 2, slender // 4, 1), 1)
    return Scene(
        name="plate",
        mesh=root_mesh_from_shapes({"plate": shape}),
        materials={"plate": Material(1.0, poisson)},
        dirichlet=(Dirichlet("plate left", x=0.0, y=0.0, z=0.0), Dirichlet("plate front", y=0.0)),
        tractions=(Pressure("plate top", 1e-6),),
    )


def manufactured(degree, most, **how):
    """(cells, dofs, estimate, true error) of each mesh of the manufactured solution."""
    for step in adapt_manufactured(1e-3, degree=degree, **how):
        record = step.record
        yield record.cells, record.dofs, record.estimate, record.true_error
        if 8 * record.dofs > most:
            return


def overrefined(scene, degree, most):
    """The same of a scene, but for the last mesh: its solution is the reference."""
    beginning, control, records = None, ErrorControl(), []
    while True:
        (step,) = adapt(scene, 0.01, degree=degree, control=control, max_steps=1, beginning=beginning)
        if 2 ** (3 / degree) * step.record.dofs > most:  # the optimal rate: errors fall like dofs^(-degree / 3)
            break
        records.append(step.record)
        marked = np.zeros(len(step.forest), dtype=np.int8)
        tolerance, comm = step.record.estimate / 2, step.forest.comm
        marked[step.leaf_mesh.leaf] = for_tolerance(step.estimate, tolerance, control.target, comm)
        values = np.concatenate([step.nodal_displacement, step.carried, step.nodal_displacement], axis=2)
        beginning = Beginning(*step.forest.refined_with(marked, values))
    for number, record in enumerate(records):
        distance = energy_distance(step, step.carried[:, :, 3 * number : 3 * number + 3])
        true = float(np.hypot(distance, step.record.estimate))
        yield record.cells, record.dofs, record.estimate, true


def cases():
    """Name -> function of the degree and the most unknowns that gives the figures of each mesh."""
    result = {
        "manufactured, straight cells": partial(manufactured, order=1),
        "manufactured, curved cells": partial(manufactured, order=3),
        "manufactured, uniform": partial(manufactured, order=3, uniform=True),
        "hertz": partial(overrefined, hertz()),
        "indentation": partial(overrefined, indentation()),
        "plate 1:20": partial(overrefined, plate()),
    }
    for poisson in (0.39, 0.45, 0.49):
        result[f"hertz, nu = {poisson}"] = partial(overrefined, hertz(material=Material(1.0, poisson)))
        result[f"plate 1:20, nu = {poisson}"] = partial(overrefined, plate(poisson))
    return result


def rows(only, degrees, most):
    """A row for each mesh of the cases with a word in their name."""
    for name, figures in cases().items():
        for degree in degrees if only in name else ():
            for cells, dofs, estimate, true in figures(degree, most):
                row = {"case": name, "degree": degree, "cells": cells, "dofs": dofs, "estimate": estimate}
                yield row | {"true_error": true, "effectivity": estimate / true}


def main():
    """Run the cases and write the table."""
    parser = options(__doc__, "effectivity")
    parser.add_argument("--only", default="", help="cases with this word in their name")
    parser.add_argument(
        "--degree", type=int, choices=(1, 2), nargs=1, default=(1, 2), help="of the displacements (both)"
    )
    parser.add_argument("--most", type=int, default=150_000, help="unknowns of a mesh, about (%(default)s)")
    given = parser.parse_args()
    tabulate(rows(given.only, given.degree, given.most), given.output / "table.csv")


if __name__ == "__main__":
    main()
