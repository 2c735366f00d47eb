"""Linear solves, iterations and time of load steps with friction over those without, by scene and size.

    ./with-dolfinx python3 -m studies.cost.friction_scenes    # twenty minutes

Bodies are pressed from rest, then moved along each other on the same mesh, whose leaves are refined where the press
without friction closes them until it has so many contact nodes.  Columns of the press and of the move: linear solves,
iterations of PCG, and these and CPU seconds of the linear systems over those of the press without friction.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from fx_contact import (
    Beginning,
    ContactPair,
    Dirichlet,
    ErrorControl,
    Material,
    Scene,
    SymmetryPlane,
    block,
    increments,
    root_mesh_from_shapes,
)
from fx_contact.contact.constraint_rows import Role
from studies.cost.friction import MODEL
from studies.effectivity.friction import ball_on_block, press_fit, stamp_on_block
from studies.tables import options, tabulate

#: Contact nodes, to a factor of 3; from `FEWER` on only `FEW` of the coefficients and Poisson's ratios.
SIZES, FEWER = (10, 100, 1000), 1000
LARGE = 10_000
CASES = (0.3, 0.3), (0.6, 0.3), (1.0, 0.3), (0.3, 0.0), (1.0, 0.0)
FEW = (0.3, 0.3), (1.0, 0.0)
STAGES = "system", "setup", "solve"


def plates(shift):
    """Half of two wide, thin plates of unlike moduli and thicknesses, pressed and sheared; pairs of nodes."""
    bodies = {
        "lower": block((0, 0, -0.5), (2, 4, 0), (4, 8, 1), 1),
        "upper": block((0, 0, 0), (2, 4, 0.25), (4, 8, 1), 1),
    }
    held = [Dirichlet("lower bottom", 0.0, 0.0, 0.0), Dirichlet("upper top", 0.0, shift, -2e-3)]
    held += [SymmetryPlane(f"{body} left") for body in bodies]
    materials = {"lower": Material(1.0, 0.3), "upper": Material(3.0, 0.3)}
    pair = ContactPair("lower top", "upper bottom")
    return Scene("plates", root_mesh_from_shapes(bodies), materials, held, pair, symmetry=2)


#: Scenes of a displacement, and that of the move over the coefficient of friction, at which a part slips [m].
SCENES = {"ball": (ball_on_block, 3e-3), "stamp": (stamp_on_block, 1.2e-2), "shaft": (press_fit, 3e-3)}
SCENES["plates"] = plates, 4.5e-3


def varied(scene, mu, poisson):
    """A scene with another coefficient of friction and another Poisson's ratio."""
    materials = {name: replace(material, poisson=poisson) for name, material in scene.materials.items()}
    return replace(scene, materials=materials, contact=[replace(pair, friction=mu) for pair in scene.contact])


def solved(make, shifts, mu, poisson, degree, forest):
    """Records of the load steps on a forest, from rest, and the last step."""
    how = {
        "degree": degree,
        "max_steps": 1,
        "control": ErrorControl("energy"),
        "beginning": Beginning.at_rest(forest),
    }
    path = list(increments(lambda shift: varied(make(shift), mu, poisson), shifts, 0.9, **how, **MODEL))
    return [point.record.record for point in path], path[-1].step


def near(step):
    """Leaves of a step's forest with facets of the contact within a facet of closed nodes."""
    rows, (leaf, face) = step.solution.rows.part(Role.NORMAL), step.forest.contact_faces()
    marked, space = np.zeros(len(step.forest), dtype=bool), rows.prolongation.space
    corners = space.positions()[space.on_faces(leaf, face)]
    centre, half = corners.mean(axis=1), np.ptp(corners, axis=1).max(axis=1) / 2
    away, _ = cKDTree(rows.position[step.solution.active]).query(centre)
    marked[leaf[away < 2 * half]] = True
    return marked


def meshes(make, degree, sizes):
    """Forests with about so many contact nodes, with these."""
    forest, sizes = Beginning.uniform(make(0.0), 0).forest, list(sizes)
    while sizes:
        (record,), step = solved(make, [0.0], 0.0, 0.3, degree, forest)
        if 3 * record.active_pairs > sizes[0]:
            yield sizes.pop(0), step.forest
        forest, _ = step.forest.refined_with(near(step).astype(np.int8))


def seconds(record):
    """CPU seconds of the linear systems of a step."""
    return sum(record.cpu_seconds[stage] for stage in STAGES)


def measured(names, sizes):
    """Rows of the table."""
    for name in names:
        make, shift = SCENES[name]
        for degree in (1, 2):
            for size, forest in meshes(make, degree, sizes):
                for poisson in (0.3, 0.0):
                    (smooth,), _ = solved(make, [0.0], 0.0, poisson, degree, forest)
                    cases = FEW if size >= FEWER else CASES
                    for mu in (mu for mu, nu in cases if nu == poisson):
                        records, _ = solved(make, [0.0, mu * shift], mu, poisson, degree, forest)
                        yield row({"scene": name, "degree": degree, "mu": mu, "nu": poisson}, smooth, records)


def row(about, smooth, records):
    """A row of the table, of the step without friction and both with it."""
    its = [record.krylov_iterations for record in (smooth, *records)]
    cpu = [seconds(record) for record in (smooth, *records)]
    about |= {"nodes": records[0].active_pairs, "slip": records[1].slipping_pairs, "dofs": smooth.dofs}
    about |= {"frictionless solves": len(its[0]), "frictionless iterations": sum(its[0]), "frictionless s": cpu[0]}
    for name, each, spent in zip(("press", "move"), its[1:], cpu[1:]):
        about |= {f"{name} solves": len(each), f"{name} iterations": sum(each)}
        about |= {f"{name} ratio": sum(each) / sum(its[0]), f"{name} CPU ratio": spent / cpu[0]}
    return about


def main():
    """Measure; print the table and keep it."""
    parser = options(__doc__, "cost")
    parser.add_argument("--scene", nargs="+", choices=SCENES, default=[*SCENES], help="which (all)")
    parser.add_argument("--large", action="store_true", help=f"also {LARGE:,} contact nodes")
    given = parser.parse_args()
    sizes = (*SIZES, LARGE) if given.large else SIZES
    tabulate(measured(given.scene, sizes), given.output / "friction_scenes.csv")


if __name__ == "__main__":
    main()
