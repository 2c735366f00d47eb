"""Thin bodies in contact at degree 2: does a run end with many more unknowns than it needs?

    python3 -m studies.cost.thin    # a quarter of an hour

A run, against the fewest unknowns that meet the same tolerance, found by trial: by runs with looser tolerances that
aim at 0.9 and at all of them, and by a mesh that grows from tolerance to tolerance.  "plate": of 1:100, bent
onto a stop; "beam": 1:18, on four supports; "ring": 1:100, squeezed between two blocks.
"""

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from fx_contact import ContactPair, Dirichlet, ErrorControl, Material, Pressure, Scene, SymmetryPlane, adapt
from fx_contact.adaptive.beginning import Beginning
from studies.boxes import BACK, DOWN, FRONT, LEFT, RIGHT, UP, Boxes
from studies.runs import STAGES
from studies.stability.shapes import four_supports
from studies.tables import plain, write

#: Looser tolerances over the one that is asked for; those of the mesh that grows, each over the one before; and the
#: unknowns with which it ends at the latest.
LOOSER, STEP, MOST = np.array([1.0, 1.05, 1.1, 1.25, 1.5, 2.0]), 0.9, 400_000


def plate(thick=1.0, half=50.0, cells=8):
    """A quarter of a clamped plate 1 m thick and 100 m wide, bent by a pressure onto a stop below its middle."""
    boxes, wide = Boxes(1), half / cells
    boxes.add("plate", (0.0, 0.0, 0.0), (half, half, thick), (cells, cells, 1))
    boxes.add("stop", (0.0, 0.0, -wide), (wide, wide, 0.0), (1, 1, 1))
    below = boxes.facets(DOWN, 0.0, "plate")
    surfaces = {"load": boxes.facets(UP, thick, "plate"), "foot": boxes.facets(DOWN, -wide)}
    surfaces |= {"rim": np.concatenate([boxes.facets(face, half, "plate") for face in (RIGHT, BACK)])}
    surfaces |= {"left": boxes.facets(LEFT, 0.0), "front": boxes.facets(FRONT, 0.0)}
    surfaces |= {"above": below[:1], "head": boxes.facets(UP, 0.0, "stop")}
    held = [Dirichlet(name, 0.0, 0.0, 0.0) for name in ("rim", "foot")]
    mesh = boxes.mesh(
        surfaces, place=lambda name, x: x - np.outer(np.full(len(x), 0.01 * (name == "stop")), [0, 0, 1])
    )
    return Scene(
        "plate",
        mesh,
        dict.fromkeys(mesh.bodies, Material(1.0, 0.3)),
        (*held, SymmetryPlane("left"), SymmetryPlane("front")),
        (ContactPair("above", "head", direction=(0, 0, -1)),),
        (Pressure("load", 2e-8),),
    )


def ring(radius=10.0, thick=0.1, wide=2.0, cells=32, order=4):
    """A quarter of a ring of 1:100, half its width, that a block pushes upwards by a hundredth of the thickness."""
    boxes, angle = Boxes(order), np.pi / 2
    boxes.add("ring", (0.0, 0.0, 0.0), (cells, wide, thick), (cells, 2, 1))
    boxes.add("block", (0.0, 0.0, -1.0), (2.0, wide, 0.0), (2, 2, 1))

    def place(name, x):
        theta = x[:, 0] * angle / cells
        if name == "ring":
            r = radius - x[:, 2]
            return np.column_stack([r * np.sin(theta), x[:, 1], radius - r * np.cos(theta)])
        return np.column_stack([radius * np.sin(theta), x[:, 1], x[:, 2]])

    below = boxes.facets(DOWN, 0.0, "ring")
    surfaces = {"foot": boxes.facets(DOWN, -1.0), "end": boxes.facets(RIGHT, float(cells), "ring")}
    surfaces |= {"left": boxes.facets(LEFT, 0.0), "front": boxes.facets(FRONT, 0.0)}
    surfaces |= {"above": below[below[:, 0] % cells < 2], "head": boxes.facets(UP, 0.0, "block")}
    return Scene(
        "ring",
        boxes.mesh(surfaces, place=place),
        dict.fromkeys(("ring", "block"), Material(1.0, 0.3)),
        (
            Dirichlet("foot", 0.0, 0.0, thick / 100),
            Dirichlet("end", z=0.0),
            SymmetryPlane("left"),
            SymmetryPlane("front"),
        ),
        (ContactPair("above", "head", direction=(0, 0, -1)),),
    )


#: Scenes, and the tolerance of each.
SCENES = {"plate": (plate, 0.05), "beam": (partial(four_supports, 18), 0.07), "ring": (ring, 0.05)}


def meets(step, control, tolerance):
    """Whether a step's energy error is small enough (6), forces and the gap between nodes apart."""
    return step.history.compared and control.sought(step.estimate, tolerance, step.history) is None


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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", choices=SCENES, nargs="+", default=list(SCENES), help="(all)")
    rows = []
    for name in parser.parse_args().scene:
        rows.append(measured(name))
        write(Path("results/cost/thin.csv"), rows)
    print(plain(rows))


if __name__ == "__main__":
    main()
