"""Thin bodies in contact at degree 2: does a run end with many more unknowns than it needs?

    python3 -m studies.cost.thin    # a quarter of an hour

A run, against the fewest unknowns that meet the same tolerance, found by trial: by runs with looser tolerances that
aim at 0.9 and at all of them, and by a mesh that grows from tolerance to tolerance.  "plate": of 1:100, bent
onto a stop; "beam": 1:18, on four supports; "ring": 1:100, squeezed between two blocks.
"""

import numpy as np

from fx_contact import (
    ContactPair,
    Dirichlet,
    ErrorControl,
    Material,
    Pressure,
    Scene,
    adapt,
    block,
    root_mesh_from_shapes,
)
from fx_contact.adaptive.beginning import Beginning
from studies.runs import STAGES
from studies.stability.shapes import DOWN, between, four_supports, held, sides
from studies.tables import options, tabulate

#: Looser tolerances over the one that is asked for; those of the mesh that grows, each over the one before; and the
#: unknowns with which it ends at the latest.
LOOSER, STEP, MOST = np.array([1.0, 1.05, 1.1, 1.25, 1.5, 2.0]), 0.9, 400_000


def plate(thick=1.0, half=50.0, cells=8):
    """A quarter of a clamped plate 1 m thick and 100 m wide, bent by a pressure onto a stop below its middle."""
    wide = half / cells
    plate = block((0, 0, 0), (half, half, thick), (cells, cells, 1), 1).named("rim", "right", "back")
    plate = plate.named("above", "bottom", where=lambda x: between(0, wide)(x) & between(0, wide, axis=1)(x))
    stop = block((0, 0, -wide), (wide, wide, 0), (1, 1, 1), 1).shifted(z=-0.01)
    mesh = root_mesh_from_shapes({"plate": plate, "stop": stop})
    return Scene(
        "plate",
        mesh,
        dict.fromkeys(mesh.bodies, Material(1.0, 0.3)),
        (held("plate rim"), held("stop bottom"), *sides(*mesh.bodies)),
        (ContactPair("plate above", "stop top", DOWN),),
        (Pressure("plate top", 2e-8),),
    )


def ring(radius=10.0, thick=0.1, wide=2.0, cells=32, order=4):
    """A quarter of a ring of 1:100, half its width, that a block pushes upwards by a hundredth of the thickness."""
    angle = np.pi / 2

    def bent(x):
        theta, r = x[0] * angle / cells, radius - x[2]
        return r * np.sin(theta), x[1], radius - r * np.cos(theta)

    ring = block((0, 0, 0), (cells, wide, thick), (cells, 2, 1), order).named("above", "bottom", where=between(0, 2))
    base = block((0, 0, -1), (2, wide, 0), (2, 2, 1), order)
    base = base.placed(lambda x: (radius * np.sin(x[0] * angle / cells), x[1], x[2]))
    mesh = root_mesh_from_shapes({"ring": ring.placed(bent), "block": base})
    return Scene(
        "ring",
        mesh,
        dict.fromkeys(mesh.bodies, Material(1.0, 0.3)),
        (held("block bottom", thick / 100), Dirichlet("ring right", z=0.0), *sides(*mesh.bodies)),
        (ContactPair("ring above", "block top", DOWN),),
    )


#: Scenes, and the tolerance of each.
SCENES = {"plate": (plate, 0.05), "beam": (four_supports, 0.07), "ring": (ring, 0.05)}


def meets(step, control, tolerance):
    """Whether a step's energy error is small enough (6), forces and the gap between nodes apart."""
    return control.sought(step.estimate, tolerance, step.record.assumed_effectivity) is None


def by_trial(scene, tolerance):
    """The fewest unknowns of a mesh that meets a tolerance, of runs with looser ones and one that grows slowly."""
    eager, patient, found, start = ErrorControl(), ErrorControl(target=1.0), [np.inf], None
    for asked in tolerance * LOOSER:
        for control in (eager, patient):
            steps = adapt(scene, asked, control=control)
            found += [step.record.dofs for step in steps if meets(step, control, tolerance)]
    asked = 1.0
    while asked > tolerance:
        asked = max(asked * STEP, tolerance)
        for step in adapt(scene, asked, control=patient, beginning=start):
            if meets(step, patient, tolerance):
                found.append(step.record.dofs)
        if step.record.dofs > 2 * min(found) or step.record.dofs > MOST:
            break
        start = Beginning.after(step, np.zeros(len(step.forest), dtype=np.int8))
    return min(found)


def measured(name):
    """A row of the table."""
    make, tolerance = SCENES[name]
    scene, records = make(), []
    for step in adapt(scene, tolerance):
        records.append(step.record)
    last, fewest = records[-1], by_trial(scene, tolerance)
    return {
        "scene": name,
        "tolerance": tolerance,
        "steps": len(records),
        "dofs": last.dofs,
        "fewest": fewest,
        "ratio": last.dofs / fewest,
        "iterations": last.krylov_iterations[-1],
        "preconditioner": last.preconditioner,
        "contact_iterations": last.contact_iterations,
        "force": last.force,
        "us": 1e6 * sum(record.cpu_seconds[stage] for record in records for stage in STAGES) / last.dofs,
    }


def main():
    """Measure; print the table and keep it."""
    parser = options(__doc__, "cost")
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=list(SCENES), help="(all)")
    given = parser.parse_args()
    tabulate(map(measured, given.scene), given.output / "thin.csv")


if __name__ == "__main__":
    main()
