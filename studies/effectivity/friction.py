"""Effectivity with friction: estimated over true errors of the energy norm, contact force and friction force.

    ./with-dolfinx python3 -m studies.effectivity.friction    # five minutes

Each scene is one load step from rest, on meshes of half the estimated error each.  The last one is the reference; its
own estimate is added in squares to the distance from it.
"""

import numpy as np

from fx_contact import (
    Beginning,
    ContactForce,
    ContactPair,
    Dirichlet,
    ErrorControl,
    FrictionForce,
    Material,
    Scene,
    SymmetryPlane,
    adapt,
    ball,
    block,
    ring,
    root_mesh_from_shapes,
)
from fx_contact.estimate.marking import for_tolerance
from fx_contact.results.accuracy import energy_distance
from studies.cost.friction import scene as ball_on_plane
from studies.tables import options, tabulate

#: Most unknowns, and coefficient of friction.
MOST, MU = 150_000, 0.5


def on_block(name, body, shape, down, shift, cells, order, modulus=100.0):
    """Half of a body, x <= 0 or x >= 0, pressed on a block and moved along y; meshed apart."""
    low = -2 if name == "stamp" else 0
    base = block((min(low, 0), -2, -2), (low + 2, 2, 0), cells, order)
    mesh = root_mesh_from_shapes({name: shape, "base": base})
    inside = "right" if name == "stamp" else "left"
    held = [Dirichlet(f"{name} {body[0]}", 0.0, shift, -down), Dirichlet("base bottom", 0.0, 0.0, 0.0)]
    held += [SymmetryPlane(f"{name} {body[1]}"), SymmetryPlane(f"base {inside}")]
    pair = ContactPair(f"{name} {body[2]}", "base top", friction=MU)
    return Scene(
        f"{name} on block", mesh, {name: Material(modulus, 0.3), "base": Material(1.0, 0.3)}, held, pair, symmetry=2
    )


def ball_on_block(shift=1e-3):
    """Half of a stiff ball."""
    top = ball(1.0, 2, 3, 2).placed(lambda x: (x[0], -x[1], 1.0 - x[2]))
    return on_block("ball", ("z = 0", "x = 0", "outside"), top, 0.01, shift, (4, 8, 4), 3)


def stamp_on_block(shift=2e-3):
    """Half of a stiff stamp with sharp edges."""
    cube = block((-1, -1, 0), (0, 1, 1), (1, 2, 1), 2)
    return on_block("stamp", ("top", "right", "bottom"), cube, 0.01, shift, (3, 6, 3), 2)


def press_fit(shift=1e-3):
    """A quarter of a shaft, pulled out of a hub."""
    shaft, hub = ring(0.5, 1.0, 2.0, (1, 3, 2), 3, quarters=1), ring(1.0, 2.0, 2.0, (2, 4, 3), 3, quarters=1)
    bodies = {"shaft": shaft, "hub": hub}
    held = [SymmetryPlane(f"{body} {side}") for body in bodies for side in ("x = 0", "y = 0")]
    held += [Dirichlet("shaft bottom", z=-shift), Dirichlet("hub top", z=0.0)]
    pair = ContactPair("shaft outside", "hub inside", clearance=-2e-3, friction=MU / 2)
    return Scene(
        "press fit", root_mesh_from_shapes(bodies), dict.fromkeys(bodies, Material(1.0, 0.3)), held, pair, symmetry=4
    )


def scenes():
    """Scenes, with the directions of their friction forces."""
    yield ball_on_plane(8e-4, MU, 0.3), (0, 1, 0)
    yield ball_on_block(), (0, 1, 0)
    yield stamp_on_block(), (0, 1, 0)
    yield press_fit(), (0, 0, 1)


def meshes(scene, direction):
    """Records of all meshes but the last, and their true errors in the energy norm; the goals of the last.

    The geometry is that of the root mesh: a tolerance of 0.99 allows plane facets, which no estimate of stresses shows.
    """
    beginning, records = None, []
    (pair,) = scene.contact
    goals = ContactForce(pair, 0.5), FrictionForce(pair, direction, 0.5)
    while True:
        order = scene.mesh.order
        (step,) = adapt(scene, 0.99, max_steps=1, beginning=beginning, goals=goals, geometry_order=order)
        if 2**1.5 * step.record.dofs > MOST:
            break
        records.append(step.record)
        marked, comm = np.zeros(len(step.forest), dtype=np.int8), step.forest.comm
        marked[step.leaf_mesh.leaf] = for_tolerance(
            step.estimate, step.record.estimate / 2, ErrorControl().target, comm
        )
        values = np.concatenate([step.nodal_displacement, step.carried, step.nodal_displacement], axis=2)
        beginning = Beginning(*step.forest.refined_with(marked, values))
    fields = np.split(step.carried, len(records), axis=2)
    true = [float(np.hypot(energy_distance(step, field), step.record.estimate)) for field in fields]
    return records, true, step.record.goals


def measured():
    """Rows of the table."""
    for scene, direction in scenes():
        records, errors, right = meshes(scene, direction)
        for number, (record, true) in enumerate(zip(records, errors)):
            row = {
                "scene": scene.name,
                "mesh": number,
                "dofs": record.dofs,
                "estimate": record.estimate,
                "true": true,
            }
            row["effectivity"] = record.estimate / true
            for name, goal, exact in zip(("normal", "friction"), record.goals, right):
                off = abs(goal.value - exact.value)
                row |= {
                    f"{name} true": off / abs(exact.value),
                    f"{name} effectivity": goal.error / off if goal.error else "",
                }
            yield row


def main():
    """Measure; print the table and keep it."""
    given = options(__doc__, "effectivity").parse_args()
    tabulate(measured(), given.output / "friction.csv")


if __name__ == "__main__":
    main()
