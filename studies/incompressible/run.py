"""What nearly incompressible bodies cost: iterations, CPU seconds and memory of the last step, and Hertz's force.

    python3 -m studies.incompressible.run                     # three scenes, six Poisson's ratios
    python3 -m studies.incompressible.run --only "hertz 0.49"
    python3 -m studies.incompressible.run --matrix 0 0.2 0.3 0.4 0.45    # Poisson's ratio of the matrix, Hertz at 0.49

Each run is a process of its own, on one rank.
"""

import json
from itertools import product
from pathlib import Path

from fx_contact import Material, adapt
from fx_contact.fem import elasticity
from fx_contact.scenes import hertz, indentation, stack
from studies.runs import by_itself
from studies.stability.shapes import clamped
from studies.tables import options, plain, read, tabulate

RATIOS = (0.3, 0.45, 0.49, 0.499, 0.4999, 0.49999)
HERE = Path(__file__).parent


def of_hertz(poisson):
    """HERTZ-A."""
    return hertz(material=Material(1.0, poisson), order=6, coarse=2)


def of_indentation(poisson):
    """INDENT-A, a quarter: the cube is 100 times as stiff."""
    return indentation(block=Material(1.0, poisson), cube=Material(100.0, poisson))


def of_blocks(poisson):
    """Two blocks on each other, one three times as stiff, clamped at both ends."""
    return clamped(stack([Material(1.0, poisson), Material(3.0, poisson)], cells=(4, 4, 4)))


#: Scenes, tolerances, and those of steel, nu = 0.3, for 100 thousand unknowns and more.
SCENES = {
    "hertz": (of_hertz, 0.01, 0.01),
    "indentation": (of_indentation, 0.04, 0.04),
    "clamped blocks": (of_blocks, 0.02, 0.01),
}


def measured(name, poisson):
    """The row of one run."""
    make, tolerance, of_steel = SCENES[name]
    *_, step = adapt(make(poisson), of_steel if poisson == RATIOS[0] else tolerance)
    record = step.record
    return {
        "scene": name,
        "nu": poisson,
        "dofs": record.dofs,
        "solves": len(record.krylov_iterations),
        "iterations": record.krylov_iterations[-1],
        "all_iterations": sum(record.krylov_iterations),
        "preconditioner": record.preconditioner,
        "solver_us": 1e6 * (record.cpu_seconds["setup"] + record.cpu_seconds["solve"]) / record.dofs,
        "cpu_us": 1e6 * record.cpu_seconds["total"] / record.dofs,
        "kB": record.peak_memory_bytes / 1e3 / record.dofs,
        "force": record.force,
    }


def with_matrix(ratio):
    """The row of Hertz at 0.49 with another Poisson's ratio of the matrix."""
    elasticity.MATRIX_POISSON = ratio
    return measured("hertz", 0.49)


def with_reference(row):
    """The row with the error of Hertz's force, against the finest axisymmetric one."""
    forces = {r["nu"]: r["force"] for r in read(HERE / "axisymmetric.csv")[1]}
    return row | {"error_force": row["force"] / forces[row["nu"]] - 1 if row["scene"] == "hertz" else ""}


def main():
    """All runs, one after the other."""
    parser = options(__doc__, "incompressible")
    parser.add_argument("--only", help="one run: scene and Poisson's ratio; its row is printed")
    parser.add_argument("--matrix", type=float, nargs="+", help="Poisson's ratios of the matrix of the mixed form")
    given = parser.parse_args()
    if given.matrix:
        print(plain([{"of the matrix": ratio} | with_matrix(ratio) for ratio in given.matrix]))
        return
    if given.only:
        name, _, poisson = given.only.rpartition(" ")
        print(json.dumps(measured(name, float(poisson))))
        return
    cases = (f"{name} {poisson}" for name, poisson in product(SCENES, RATIOS))
    rows = (with_reference(by_itself("studies.incompressible.run", "--only", case)) for case in cases)
    tabulate(rows, given.output / "table.csv")


if __name__ == "__main__":
    main()
