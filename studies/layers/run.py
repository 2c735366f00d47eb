"""A rigid sphere on a coated cylinder: cost and force by the coating's modulus, against `studies.layers.axisymmetric`.

    python3 -m studies.layers.run               # twelve minutes
    python3 -m studies.layers.run --only 10     # one ratio of moduli

The coating has a thousandth of the cylinder's size.  "graded" root cells grow from the contact outwards and downwards,
"flat" ones have one size, 1:250 in the coating.
"""

import numpy as np

from fx_contact import (
    ContactForce,
    ContactPair,
    Dirichlet,
    Material,
    RigidSphere,
    Scene,
    SymmetryPlane,
    adapt,
    cylinder,
    join,
    ring,
    root_mesh_from_shapes,
)
from studies.layers.axisymmetric import COATING_POISSON, POISSON, RATIOS, SIZE, THICKNESS, WIDTHS, YOUNG, sphere
from studies.tables import TOP, options, read, tabulate

#: Order of the cells; tolerance of the force.
ORDER, FORCE = 2, 2e-3
#: Rows with flat root cells: radius of the contact over the thickness, ratio of moduli.
FLAT = (10.0, 1e-3), (10.0, 10.0)


def doubled(first: float, end: float) -> np.ndarray:
    """Places from 0 to the end, each cell twice as long as the one before: the first has about this length."""
    count = int(np.ceil(np.log2(end / first)))
    return end * (2.0 ** np.arange(count + 1) - 1) / (2.0**count - 1)


def layers(radii, heights):
    """A quarter of a cylinder about the z axis, upwards from z = 0: a core of 2 x 2 cells and rings about it."""
    rings, count = len(radii) - 2, len(heights) - 1
    core = cylinder(1, count, (2, count), ORDER, quarters=1)
    around = ring(1, 1 + rings, count, (rings, 4, count), ORDER, quarters=1)

    def placed(x):
        """Positions with the given radii and heights."""
        r = np.hypot(x[0], x[1])
        scale = np.interp(r, range(rings + 2), radii) / np.maximum(r, 1e-300)
        return scale * x[0], scale * x[1], np.interp(x[2], range(count + 1), heights)

    return join(core, around).placed(placed)


def coated(width: float, ratio: float, root: str = "graded") -> Scene:
    """A quarter of the cylinder below z = 0, on a plane without friction, and the sphere of `sphere`."""
    radius, depth = sphere(width)
    if root == "graded":
        core = 4 * THICKNESS * max(1.0, width)
        radii = np.concatenate([[0.0], core + doubled(core, SIZE - core)])
        heights = -THICKNESS - doubled(max(THICKNESS, core / 4), SIZE - THICKNESS)[::-1]
    else:
        radii, heights = np.array([0.0, SIZE / 2, SIZE]), np.linspace(-SIZE, -THICKNESS, 5)
    substrate = layers(radii, heights).as_part("substrate")
    coating = layers(radii, np.array([-THICKNESS, 0.0])).as_part("coating")
    planes = (SymmetryPlane("disc x = 0"), SymmetryPlane("disc y = 0"))
    ball = RigidSphere((0.0, 0.0, radius), radius)
    return Scene(
        name="coated cylinder",
        mesh=root_mesh_from_shapes({"disc": join(substrate, coating)}),
        materials={
            "disc substrate": Material(YOUNG, POISSON),
            "disc coating": Material(ratio * YOUNG, COATING_POISSON),
        },
        dirichlet=(*planes, Dirichlet("disc bottom", z=0.0)),
        contact=(ContactPair("disc top", ball, (0.0, 0.0, 1.0), moved=(0.0, 0.0, -depth)),),
        symmetry=4,
    )


def known(width: float, ratio: float) -> float:
    """The force of the axisymmetric solution on the finest mesh."""
    rows = read(TOP / "studies/layers/axisymmetric.csv")[1]
    return [row["force"] for row in rows if (row["width"], row["ratio"]) == (width, ratio)][-1]


def measured(width, ratio, root, tolerance):
    """A row of the table."""
    scene = coated(width, ratio, root)
    goal = ContactForce(scene.contact[0].name, FORCE)
    steps = [step.record for step in adapt(scene, tolerance, goals=goal, allow=("large strain",))]
    last = steps[-1]
    return {
        "width": width,
        "ratio": ratio,
        "root": root,
        "steps": len(steps),
        "dofs": last.dofs,
        "estimate": last.estimate,
        "force_estimate": last.goals[0].error / last.force,
        "force": last.force / known(width, ratio) - 1,
        "iterations": max(max(record.krylov_iterations) for record in steps),
        "at_the_end": last.preconditioner,
        "cpu_s": sum(record.cpu_seconds["total"] for record in steps),
    }


def main():
    """Measure; print the table, and keep that of one rank."""
    parser = options(__doc__, "layers")
    parser.add_argument("--only", type=float, nargs="+", choices=RATIOS, default=RATIOS, help="ratios of moduli")
    parser.add_argument("--tolerance", type=float, default=0.05, help="of the energy norm (%(default)s)")
    given = parser.parse_args()
    points = [(width, ratio, "graded") for width in WIDTHS for ratio in RATIOS] + [(*pair, "flat") for pair in FLAT]
    rows = (measured(*point, given.tolerance) for point in points if point[1] in given.only)
    tabulate(rows, given.output / "table.csv")


if __name__ == "__main__":
    main()
