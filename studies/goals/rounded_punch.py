"""Largest pressure below a flat punch with a rounded edge, where the curvature jumps.

A steel punch of radius 50, its edge rounded with a radius of 10, stands on an aluminium block under a pressure of 100.
"""

from dataclasses import replace

import numpy as np

from fx_contact import (
    ContactPair,
    Dirichlet,
    Material,
    Pressure,
    Scene,
    SymmetryPlane,
    cylinder,
    join,
    ring,
    root_mesh_from_shapes,
    sweep_side,
)

#: Radius of the flat part and of the edge, height of the punch, radius and depth of the block [mm].
FLAT, EDGE, HEIGHT, BLOCK = 40.0, 10.0, 60.0, 200.0
#: Pressure on the punch [MPa]; 156 on the flat part.
APPLIED = 100.0
MATERIALS = {"punch": Material(young=210e3, poisson=0.3), "block": Material(young=70e3, poisson=0.3)}


def rounded_punch(cells=1, order=6):
    """A quarter of punch and block.

    Args:
        cells: root cells along an eighth of a circle.
        order: of the root mesh.
    """
    lip, twice = FLAT + EDGE * np.sqrt(0.5), 2 * cells

    def turned(x):
        """A quarter of a disc turned about the axis of the punch: its arc is the rounded edge."""
        r, angle = FLAT + x[0], np.pi / 2 * x[2]
        return r * np.cos(angle), r * np.sin(angle), EDGE - x[1]

    def depth(t):
        return -BLOCK * t * (0.2 + 0.8 * t)

    def outwards(x):
        """Cells of the ring beside the punch, smaller near it."""
        r = np.hypot(x[0], x[1])
        t = (r - lip) / (BLOCK - lip)
        factor = (lip + (BLOCK - lip) * t * (0.4 + 0.6 * t)) / r
        return factor * x[0], factor * x[1], depth(1 - x[2] / BLOCK)

    edge = cylinder(EDGE, 1.0, (cells, twice), order, 1)
    edge = edge.named("foot", "outside", where=lambda x: x[0] < lip - FLAT + 1e-6).placed(turned)
    sides = {"foot": edge.sides["foot"], "y = 0": edge.sides["bottom"], "x = 0": edge.sides["top"]}
    core = cylinder(FLAT, EDGE, (cells, twice), order, 1).named("foot", "bottom")
    above = cylinder(FLAT, HEIGHT - EDGE, (cells, 2 * twice), order, 1).shifted(z=EDGE)
    rim = ring(FLAT, FLAT + EDGE, HEIGHT - EDGE, (twice, twice, 2 * twice), order, 1).shifted(z=EDGE)
    punch = join(replace(edge, sides=sides), core, above, rim)
    below = sweep_side(punch, "foot", lambda x, t: (x[0], x[1], np.full_like(x[0], depth(t))), layers=2 * twice)
    beside = ring(lip, BLOCK, BLOCK, (2 * twice, twice, 2 * twice), order, 1).placed(outwards)
    block = join(below, beside.named("end", "bottom"))
    return Scene(
        name="rounded punch",
        mesh=root_mesh_from_shapes({"punch": punch, "block": block}),
        materials=MATERIALS,
        dirichlet=(
            Dirichlet("block end", z=0.0),
            *(SymmetryPlane(f"{body} {plane}") for body in ("punch", "block") for plane in ("x = 0", "y = 0")),
        ),
        tractions=(Pressure("punch top", APPLIED),),
        contact=(ContactPair("punch foot", "block start", direction=(0.0, 0.0, -1.0)),),
        symmetry=4,
        contact_centre=(0.0, 0.0, 0.0),
    )
