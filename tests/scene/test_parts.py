"""Parts of a body: named in shapes, in Gmsh and in dolfinx, with a material each."""

import numpy as np
import pytest
from conftest import WORLD, everywhere
from dolfinx_meshes import of_dolfinx, tagged
from mpi4py import MPI

from fx_contact import (
    BodyForce,
    ContactPair,
    Dirichlet,
    GeometryError,
    Material,
    RigidSphere,
    RootMesh,
    Scene,
    SceneError,
    SymmetryPlane,
    Tie,
    adapt,
    solve,
)
from fx_contact.contact.constraint_rows import Role
from fx_contact.fem.leaf_mesh import leaf_positions
from fx_contact.geometry.gmsh_mesh import root_mesh_from_gmsh
from fx_contact.geometry.shapes import join, root_mesh_from_shapes
from fx_contact.geometry.solids import block
from fx_contact.scene.fingerprint import scene_parts

SOFT, HARD = Material(1.0, 0.3), Material(4.0, 0.2)


def coated(height=1.0, **more):
    """A block with a coating of one layer of cells, as a body beside others."""
    base, coating = (block((0, 0, a), (1, 1, b), (2, 2, 1), 1) for a, b in ((0, height), (height, height + 0.5)))
    return root_mesh_from_shapes({"plate": join(base, coating.as_part("coating")), **more})


def test_of_shapes():
    """The rest of a body has its name; parts of one name are united, those named last keep their cells."""
    mesh = coated(other=block((0, 0, 2), (1, 1, 3), (1, 1, 1), 1))
    assert mesh.bodies == ("plate", "other") and mesh.regions == ("plate", "other", "plate coating")
    assert mesh.region.tolist() == [0] * 4 + [2] * 4 + [1] and mesh.body_of_region.tolist() == [0, 1, 0]
    assert mesh.cells_of("plate").tolist() == list(range(8)) and mesh.cells_of("plate coating").tolist() == [
        4,
        5,
        6,
        7,
    ]
    ends = block((0, 0, 0), (3, 1, 1), (3, 1, 1), 1)
    for where in (lambda x: x[0] < 1.5, lambda x: x[0] > 1.5):
        ends = ends.as_part("end", where).mirrored("y").shifted(z=1)
    assert ends.parts["end"].tolist() == [2]
    both = join(ends, ends.shifted(x=3))
    whole = both.as_part("all").as_part("middle", lambda x: (2.5 > x[0]) & (x[0] > 0.5))
    assert both.parts["end"].tolist() == [2, 5] and whole.parts["middle"].tolist() == [1]
    mesh = root_mesh_from_shapes({"bar": whole})
    assert mesh.regions == ("bar all", "bar middle") and mesh.region.tolist() == [0, 1, 0, 0, 0, 0]
    assert "parts (cells): 'bar all' (5), 'bar middle' (1)" in repr(mesh)


def two_volumes(names):
    """Two cubes with a face in common in Gmsh, in physical groups by name."""
    gmsh = pytest.importorskip("gmsh")
    gmsh.clear()
    occ = gmsh.model.occ
    occ.fragment([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(0, 0, 1, 1, 1, 1))])
    occ.synchronize()
    for name, volumes in names.items():
        gmsh.model.addPhysicalGroup(3, volumes, name=name)
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.5)
    gmsh.model.mesh.setTransfiniteAutomatic(recombine=True)
    gmsh.model.mesh.generate(3)


@pytest.mark.parametrize("names", [{"body": [1, 2], "lower": [1], "upper": [2]}, {"upper": [2], "body": [1, 2]}])
def test_of_gmsh(names):
    """Volumes in a larger group are parts of its body."""
    mesh = root_mesh_from_gmsh(MPI.COMM_WORLD, lambda: two_volumes(names))
    assert mesh.bodies == ("body",) and set(mesh.parts) == {*names} - {"body"}
    height = mesh.points[mesh.cells].mean(axis=1)[:, 2]
    for name, cells in mesh.parts.items():
        assert np.array_equal(np.flatnonzero((height > 1) == (name == "upper")), cells) and len(cells)


def test_groups_that_share_nodes():
    """Two bodies of Gmsh may not share nodes; the message says what may."""
    with pytest.raises(SceneError, match="share the node at .* make them parts of one body"):
        root_mesh_from_gmsh(MPI.COMM_WORLD, lambda: two_volumes({"lower": [1], "upper": [2]}))


@pytest.mark.ranks(1, 2, 3)
def test_of_dolfinx():
    """Several tags may be of one body, some of them of a part."""
    root = coated(other=block((0, 0, 2), (1, 1, 3), (1, 1, 1), 1))
    mesh, cell_tags, facet_tags, _, surfaces = of_dolfinx(root)
    numbers = mesh.topology.original_cell_index
    cell_tags = tagged(mesh, 3, np.arange(len(numbers)), 7 + root.region[numbers])
    bodies, parts = {7: "plate", 8: "other", 9: "plate"}, {9: "plate coating"}
    again = RootMesh.from_dolfinx(mesh, cell_tags, facet_tags, bodies, surfaces, parts=parts)
    assert again.bodies == root.bodies and again.regions == root.regions
    assert np.array_equal(again.region, root.region)
    with pytest.raises(SceneError, match="parts must have tags of bodies"):
        RootMesh.from_dolfinx(mesh, cell_tags, facet_tags, bodies, surfaces, parts={1: "coating"})
    with pytest.raises(SceneError, match="parts must be a dict of tag -> name"):
        RootMesh.from_dolfinx(mesh, cell_tags, facet_tags, bodies, surfaces, parts=["coating"])


def split(contact=(), ties=(), force=()):
    """A block of a soft and a hard half side by side on a foundation, which holds it by contact or a tie."""
    halves = (block((x, 0, 1), (x + 1, 1, 2), (2, 2, 2), 1).as_part(n) for x, n in enumerate(("soft", "hard")))
    mesh = root_mesh_from_shapes({"top": join(*halves), "base": block((0, 0, 0), (2, 1, 1), (4, 2, 2), 1)})
    planes = tuple(SymmetryPlane(f"{body} {side}") for body in mesh.bodies for side in ("left", "front"))
    held = (Dirichlet("base bottom", z=0.0), Dirichlet("top top", z=-1e-3))
    materials = {"top soft": SOFT, "top hard": HARD, "base": Material(2.0, 0.25)}
    return Scene("halves", mesh, materials, planes + held, contact, body_forces=force, ties=ties)


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("degree", (1, 2))
@pytest.mark.parametrize("rows", ["contact", "tie", "obstacle"])
def test_contact_of_two_parts(rows, degree):
    """A contact surface of two parts: balance, the moduli of both at their nodes, a mean where they meet."""
    pair = ("top bottom", "base top")
    if rows == "obstacle":
        mesh = split().mesh
        pairs = (ContactPair("top top", RigidSphere((1, 0, 12), 10.0), moved=(0, 0, -2e-3)),)
        scene = Scene("halves", mesh, split().materials, split().dirichlet[:5], pairs, ties=(Tie(*pair),))
    else:
        scene = split(**({"contact": (ContactPair(*pair),)} if rows == "contact" else {"ties": (Tie(*pair),)}))
    for step in adapt(scene, tolerance=0.1, degree=degree):
        pass
    found = step.solution.rows.part(Role.EQUATION if rows == "tie" else Role.NORMAL)
    at, modulus = found.position[:, 0], found.modulus[:, 0]
    known = [material.plane_strain_modulus for material in (SOFT, HARD)]
    middle = 2 / (1 / known[0] + 1 / known[1])
    lower, upper = (
        WORLD.allreduce(f, op=op) for f, op in ((modulus.min(initial=9), MPI.MIN), (modulus.max(initial=0), MPI.MAX))
    )
    assert (lower, upper) == pytest.approx(known, rel=1e-12)
    ok = np.where(np.isclose(at, 1), modulus < 1.5 * middle, np.isclose(modulus, np.where(at < 1, *known)))
    everywhere(ok.all(), "another modulus")
    load = abs(step.record.force) or 1e-3
    for resultant in step.resultants:
        if resultant.kind == "balance":
            assert np.abs(resultant.force).max() < 1e-5 * load


@pytest.mark.ranks(1, 2, 3)
@pytest.mark.parametrize("degree", (1, 2))
def test_weight_of_a_part(degree):
    """A body force on a part alone, and on the body: the resultants, and the exact stress of a bar that hangs."""
    parts = (block((0, 0, z), (1, 1, z + 1), (1, 1, 2), 1).as_part(name) for z, name in enumerate(("low", "high")))
    mesh = root_mesh_from_shapes({"bar": join(*parts)})
    planes = tuple(SymmetryPlane(f"bar {side}") for side in ("left", "front", "top"))
    stiff = Material(1.0, 0.0), Material(5.0, 0.0)
    forces = BodyForce("bar low", (0, 0, -1e-3)), BodyForce("bar", (0, 0, -2e-3))
    scene = Scene("bar", mesh, dict(zip(("bar low", "bar high"), stiff)), planes, body_forces=forces)
    step = solve(scene, tolerance=1e-3 if degree == 2 else 0.2, degree=degree)
    found = {r.name: r.force[2] for r in step.resultants if r.kind == "body force"}
    assert found == pytest.approx({"bar low": -1e-3, "bar": -4e-3}, rel=1e-12)
    if degree == 2:  # u is quadratic in each part
        assert step.record.estimate < 1e-6
        z = leaf_positions(step.forest, slice(None), 2)[:, :, 2]
        known = np.where(z.mean(axis=1)[:, None] < 1, 3e-3 * z, 3e-3 + 2e-3 * (z - 1))
        everywhere(np.abs(step.nodal_stress[:, :, 2] - known).max(initial=0) < 1e-9, "another stress")


def test_moduli_of_surfaces():
    """Rows of meshes apart are on the softer of two parts that face each other."""
    coating, base = block((0, 0, 1), (1, 1, 1.1), (2, 2, 1), 1), block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)
    lower, upper = join(base, coating.as_part("coating")), block((0, 0, 1.1), (1, 1, 2), (3, 3, 2), 1)
    mesh = root_mesh_from_shapes({"lower": lower, "upper": upper})
    planes = tuple(SymmetryPlane(f"{body} {side}") for body in mesh.bodies for side in ("left", "front"))
    held = (Dirichlet("lower bottom", z=0.0), Dirichlet("upper top", z=-1e-3))
    for young, first in ((0.01, "lower top"), (100.0, "upper bottom")):
        materials = {"lower": Material(1.0, 0.3), "upper": Material(1.0, 0.3), "lower coating": Material(young, 0.3)}
        scene = Scene("apart", mesh, materials, planes + held, (ContactPair("lower top", "upper bottom"),))
        assert scene.oriented[0].surfaces[0] == first


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"a": [0, 0]}, "at least one of 9 root cells, none twice"),
        ({"a": []}, "at least one of 9 root cells"),
        ({"a": [9]}, "at least one of 9 root cells"),
        ({"a": [[0]]}, "at least one of 9 root cells"),
        ({"a": [0, 1], "b": [1]}, "root cell 1 is in part 'b' and in another one"),
        ({"a": [0, 8]}, "has cells of bodies 'plate' and 'other'"),
        ({"other": [8]}, "a part and a body have the name 'other'"),
        ({"": [0]}, "must be a name, got ''"),
    ],
)
def test_refused(parts, words):
    """Parts that are none."""
    mesh = coated(other=block((0, 0, 2), (1, 1, 3), (1, 1, 1), 1))
    with pytest.raises(SceneError, match=words):
        RootMesh(mesh.points, mesh.cells, mesh.bodies, mesh.body, mesh.surfaces, parts=parts)


def test_other_errors():
    """Shapes and scenes."""
    shape = block((0, 0, 0), (1, 1, 1), (1, 1, 1), 1)
    with pytest.raises(GeometryError, match="part 'a' has no cell"):
        shape.as_part("a", lambda x: x[0] > 2)
    with pytest.raises(SceneError, match="a part must be a name"):
        shape.as_part(1)
    with pytest.raises(GeometryError, match="parts dicts"):
        RootMesh(shape.points, shape.cells, ("a",), [0], parts={"b": "c"})
    mesh = coated()
    planes = tuple(Dirichlet(side, 0.0, 0.0, 0.0) for side in ("plate bottom",))
    both = {"plate": SOFT, "plate coating": HARD}
    with pytest.raises(SceneError, match="'plate coating' is 1e[+]16 times as stiff as 'plate'"):
        Scene("a", mesh, {"plate": Material(1e-3, 0.3), "plate coating": Material(1e13, 0.3)}, planes)
    assert scene_parts(Scene("a", mesh, both, planes))["materials"] == {
        "plate": ["Material", 1.0, 0.3],
        "plate coating": ["Material", 4.0, 0.2],
    }
