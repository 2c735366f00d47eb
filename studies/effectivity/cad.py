"""First meshes of thousands of cells, as CAD makes them: tetrahedra of Gmsh, each subdivided into four hexahedra.

A pin in a lug and two unlike blocks.  A run ends on the first mesh; before, all of its cells were refined to measure
the effectivity.

    python3 -m studies.effectivity.cad [--only WORD]    # five minutes, 6 GB

It leaves cad.csv in results/effectivity.
"""

from functools import partial

import gmsh
import numpy as np
from mpi4py import MPI

from fx_contact import ContactPair, Dirichlet, Material, Scene, adapt, root_mesh_from_gmsh
from fx_contact.adaptive.beginning import Beginning
from studies.cost.distorted import subdivided
from studies.tables import options, tabulate

STEEL, ALUMINIUM = Material(210e9, 0.3), Material(70e9, 0.33)
#: Fixed in all directions.
HELD = dict.fromkeys("xyz", 0.0)


def facets(volume, condition):
    """Surfaces of a volume whose bounding boxes (6,) satisfy a condition."""
    sides = [side for _, side in gmsh.model.getBoundary([(3, volume)], oriented=False)]
    return [side for side in sides if condition(np.array(gmsh.model.getBoundingBox(2, side)))]


def meshed(bodies, places, alike, size):
    """The model meshed by hexahedra of half a size [m], two surfaces alike; names for bodies and places."""
    gmsh.model.mesh.setPeriodic(2, *alike, np.eye(4).ravel().tolist())
    for dimension, groups in ((3, bodies), (2, places)):
        for name, tags in groups.items():
            gmsh.model.addPhysicalGroup(dimension, tags, name=name)
    subdivided(MeshSizeMin=size, MeshSizeMax=size)


def lug(size):
    """A pin in the round end of a lug 40 mm wide."""
    occ = gmsh.model.occ
    shaft, eye = occ.addBox(0, -0.02, 0, 0.06, 0.04, 0.01), occ.addCylinder(0, 0, 0, 0, 0, 0.01, 0.02)
    whole, _ = occ.fuse([(3, shaft)], [(3, eye)])
    ((_, body),), _ = occ.cut(whole, [(3, occ.addCylinder(0, 0, 0, 0, 0, 0.01, 0.01))])
    pin = occ.addCylinder(0, 0, 0, 0, 0, 0.01, 0.01)
    occ.synchronize()
    (hole,) = facets(body, lambda box: np.abs(box[:2] + 0.01).max() < 1e-5 and box[3] < 0.011)
    (side,) = facets(pin, lambda box: box[5] - box[2] > 5e-3)
    places = {"hole": [hole], "pin side": [side], "lug end": facets(body, lambda box: box[0] > 0.059)}
    places["pin ends"] = facets(pin, lambda box: box[5] - box[2] < 1e-3)
    meshed({"lug": [body], "pin": [pin]}, places, ([side], [hole]), size)


def blocks(size):
    """Two cubes of 10 mm, one on the other."""
    lower, upper = (gmsh.model.occ.addBox(0, 0, z, 0.01, 0.01, 0.01) for z in (0, 0.01))
    gmsh.model.occ.synchronize()
    ends = [
        facets(body, lambda box, z=z: np.abs(box[[2, 5]] - z).max() < 1e-5) for body, z in ((lower, 0), (upper, 0.02))
    ]
    inner = [facets(body, lambda box: np.abs(box[[2, 5]] - 0.01).max() < 1e-5) for body in (lower, upper)]
    places = dict(zip(("bottom", "top", "lower face", "upper face"), (*ends, *inner)))
    meshed({"lower": [lower], "upper": [upper]}, places, inner[::-1], size)


def scenes():
    """Name -> scene and tolerance."""
    meshes = {
        make: root_mesh_from_gmsh(MPI.COMM_WORLD, partial(make, size))
        for make, size in ((lug, 8e-3), (blocks, 2.25e-3))
    }
    pinned = Scene(
        "pin in a lug",
        meshes[lug],
        {"lug": ALUMINIUM, "pin": STEEL},
        (Dirichlet("pin ends", **HELD), Dirichlet("lug end", **HELD | {"x": 1e-4})),
        (ContactPair("pin side", "hole"),),
    )
    pressed = Scene(
        "two blocks",
        meshes[blocks],
        {"lower": ALUMINIUM, "upper": STEEL},
        (Dirichlet("bottom", **HELD), Dirichlet("top", **HELD | {"z": -1e-4})),
        (ContactPair("lower face", "upper face"),),
    )
    return {"pin in a lug": (pinned, 0.2), "two blocks": (pressed, 0.2)}


def row_of(steps, run):
    """Columns of the records of a run, whose costs are those of all steps."""
    last, seconds = steps[-1], sum(record.cpu_seconds["total"] for record in steps)
    row = {"run": run, "meshes": len(steps), "unknowns": last.dofs, "cpu_seconds": seconds}
    return row | {"memory": last.peak_memory_bytes, "estimate": last.estimate, "force": last.force}


def solved(scene, tolerance, most):
    """Rows of a run, and of its mesh with all cells refined, up to so many cells."""
    steps = []
    for step in adapt(scene, tolerance):
        steps.append(step.record)
    yield row_of(steps, "run")
    if 8 * step.record.cells <= most:
        beginning = Beginning.after(step, np.ones(len(step.forest), dtype=bool))
        del step
        (finer,) = adapt(scene, tolerance, max_steps=1, beginning=beginning)
        yield row_of([*steps, finer.record], "all cells refined")


def main():
    """Solve and write the table."""
    parser = options(__doc__, "effectivity")
    parser.add_argument("--only", default="", help="scenes with this word in their name")
    parser.add_argument("--most", type=int, default=20_000, help="cells of a mesh refined as a whole (%(default)s)")
    given = parser.parse_args()
    chosen = {name: what for name, what in scenes().items() if given.only in name}
    rows = (
        {"scene": name, "tolerance": tolerance} | row
        for name, (scene, tolerance) in chosen.items()
        for row in solved(scene, tolerance, given.most)
    )
    tabulate(rows, given.output / "cad.csv")


if __name__ == "__main__":
    main()
