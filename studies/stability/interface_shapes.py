"""Scenes of surfaces meshed apart, of rigid obstacles and of ties; each function makes a Scene."""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from fx_contact import (
    BodyForce,
    ContactPair,
    Dirichlet,
    Material,
    Pressure,
    RigidCylinder,
    RigidMotion,
    RigidPlane,
    Scene,
    SymmetryPlane,
    Tie,
    Traction,
    ball,
    block,
    join,
    ring,
    root_mesh_from_shapes,
    solve,
)
from studies.stability.shapes import DOWN, PLAIN, UP, between, held, sides

#: Width of a block that overhangs another one [m].
_WIDE = 1.3


def cubes(upper, lower, materials=(PLAIN, PLAIN), displacement=0.0, pressure=0.0, twist=0.0, moved=0.0):
    """A unit cube pressed on another one, free sideways.

    Args:
        upper, lower: root cells along x and y.
        materials: of the upper and of the lower one.
        displacement: of the top [m].
        pressure: on the top, if it is not displaced [Pa].
        twist: of the upper mesh, around its middle, inside its sides [degrees].
        moved: displacement along x of the lower mesh's nodes at x = 1/2 [m].
    """

    def twisted(x):
        angle = np.radians(twist) * np.prod(np.sin(np.pi * x[:2]), axis=0)
        dx, dy = x[0] - 0.5, x[1] - 0.5
        return 0.5 + np.cos(angle) * dx - np.sin(angle) * dy, 0.5 + np.sin(angle) * dx + np.cos(angle) * dy, x[2]

    bodies = {
        "upper": block((0, 0, 1), (1, 1, 2), (*upper, 2), 1).placed(twisted),
        "lower": block((0, 0, 0), (1, 1, 1), (*lower, 1), 1).placed(
            lambda x: (x[0] + moved * (np.abs(x[0] - 0.5) < 1e-6), x[1], x[2])
        ),
    }
    top = [Dirichlet("upper top", z=-displacement)] if displacement else []
    return Scene(
        "cubes",
        root_mesh_from_shapes(bodies),
        dict(zip(bodies, materials)),
        (Dirichlet("lower bottom", z=0.0), *top, *sides(*bodies)),
        (ContactPair("upper bottom", "lower top"),),
        () if displacement else (Pressure("upper top", pressure),),
    )


def overhanging(covered, upper=(4, 2), lower=(3, 3), materials=(PLAIN, PLAIN), matched=False):
    """A block below a pressure of 0.01 Pa that lies half over the edge of another one.

    Args:
        covered: length of the upper block that lies on the lower one, of 1 m [m].
        upper, lower: root cells along x and y.
        materials: of the upper and of the lower one.
        matched: meshed alike instead, on the covered part.
    """
    surfaces = {
        f"{body} {side}": f"{body} {side}" for body in ("upper", "lower") for side in ("left", "right", "front")
    }
    surfaces |= {name: name for name in ("lower bottom", "upper top", "upper bottom", "lower top")}
    if matched:
        bodies = {"upper": ((0, 0, 1), (1, _WIDE, 2)), "lower": ((-0.5, 0, 0), (0.5, _WIDE, 1))}
        bodies = {name: block(*corners, (4, 2, 2), 1) for name, corners in bodies.items()}
        bodies["upper"] = bodies["upper"].named("on", "bottom", where=between(0, 0.5))
        bodies["lower"] = bodies["lower"].named("on", "top", where=between(0, 0.5))
        bodies = {
            name: shape.placed(
                lambda x: (np.interp(x[0], [-0.5, 0, 0.5, 1], [covered - 1, 0, covered, 1]), x[1], x[2])
            )
            for name, shape in bodies.items()
        }
        surfaces |= {"upper bottom": "upper on", "lower top": "lower on"}
    else:
        bodies = {
            "upper": block((0, 0, 1), (1, _WIDE, 2), (*upper, 2), 1),
            "lower": block((covered - 1, 0, 0), (covered, _WIDE, 1), (*lower, 2), 1),
        }
    walls = [Dirichlet(f"upper {side}", x=0.0) for side in ("left", "right")]
    return Scene(
        "overhanging",
        root_mesh_from_shapes(bodies, surfaces),
        dict(zip(bodies, materials)),
        (held("lower bottom"), *walls, Dirichlet("upper front", y=0.0)),
        (ContactPair("upper bottom", "lower top"),),
        (Pressure("upper top", 0.01),),
    )


def receding(ratio, base=(8, 2), layer=(8, 2)):
    """Half of a weightless layer on a block, pressed in its middle; it lifts off beside the load.

    Args:
        ratio: of the layer's Young's modulus to the block's.
        base, layer: root cells along x and y.
    """
    bodies = {
        "layer": block((0, 0, 0), (4, 1, 0.5), (*layer, 1), 1).named("load", "top", where=between(0, 0.5)),
        "base": block((0, 0, -2), (4, 1, 0), (*base, 3), 1),
    }
    planes = [SymmetryPlane(f"{body} {side}") for body in bodies for side in ("left", "front", "back")]
    return Scene(
        "receding",
        root_mesh_from_shapes(bodies),
        {"layer": Material(ratio, 0.3), "base": PLAIN},
        (held("base bottom"), *planes),
        (ContactPair("layer bottom", "base top", DOWN),),
        (Pressure("layer load", 1e-3 * min(ratio, 1.0)),),
    )


def groove(cube, walls, ratio=1.0, weight=1e-3):
    """A cube in a rectangular groove, with its weight along the diagonal; contact alone holds it.

    Args:
        cube, walls: root cells along the edges.
        ratio: of the walls' Young's modulus to the cube's.
        weight: of the cube [N].
    """
    bodies = {
        "floor": block((0, 0, -1), (1.5, 1, 0), (walls, walls, 2), 1),
        "wall": block((-1, 0, 0), (0, 1, 1.5), (2, walls, walls), 1),
        "cube": block((0, 0, 0), (1, 1, 1), (cube, cube, cube), 1),
    }
    conditions = [held("floor bottom"), Dirichlet("wall left", 0.0, 0.0, 0.0)]
    conditions += [SymmetryPlane(f"{body} {side}") for body in bodies for side in ("front", "back")]
    return Scene(
        "groove",
        root_mesh_from_shapes(bodies),
        {"floor": Material(ratio, 0.3), "wall": Material(ratio, 0.3), "cube": PLAIN},
        conditions,
        (ContactPair("cube bottom", "floor top", DOWN), ContactPair("cube left", "wall right", (-1.0, 0.0, 0.0))),
        body_forces=(BodyForce("cube", (-weight / np.sqrt(2), 0.0, -weight / np.sqrt(2))),),
    )


def ball_on_plate(displacement, cells=3, plate=4):
    """A quarter of a half-ball of radius 1 on a plate of 2.4 x 2.4 x 1, its flat face pressed down [m]."""
    bodies = {
        "ball": ball(1.0, cells, octants=1).turned("x", 180).turned("z", 90).shifted(z=1.0),
        "plate": block((0, 0, -1), (1.2, 1.2, 0), (plate, plate, 3)),
    }
    planes = SymmetryPlane("ball x = 0"), SymmetryPlane("ball y = 0"), *sides("plate")
    return Scene(
        "ball on plate",
        root_mesh_from_shapes(bodies),
        dict.fromkeys(bodies, PLAIN),
        (Dirichlet("plate bottom", z=0.0), Dirichlet("ball z = 0", z=-displacement), *planes),
        (ContactPair("ball outside", "plate top"),),
        symmetry=4,
    )


def below(obstacle, cells=2, supported=True, more=(), **pair):
    """A quarter of a block of 2 x 2 x 1 below an obstacle; `more` are further contacts."""
    mesh = root_mesh_from_shapes({"block": block((0, 0, -1), (1, 1, 0), (cells, cells, cells), 1)})
    bottom = (Dirichlet("block bottom", z=0.0),) if supported else ()
    contact = (ContactPair("block top", obstacle, **pair), *more)
    return Scene("below", mesh, {"block": PLAIN}, (*bottom, *sides("block")), contact, symmetry=4)


def beneath(obstacle, cells=3, material=PLAIN, **pair):
    """A block of 2 x 2 x 1, held at its bottom, beneath an obstacle at any place of its top."""
    mesh = root_mesh_from_shapes({"block": block((-1, -1, -1), (1, 1, 0), (cells, cells, 2), 1)})
    contact = (ContactPair("block top", obstacle, **pair),)
    return Scene("beneath", mesh, {"block": material}, (held("block bottom"),), contact)


def squeezed(clearance):
    """A unit cube that six planes alone hold, each with a clearance [m]."""
    mesh = root_mesh_from_shapes({"cube": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)})
    normals = {"left": (1, 0, 0), "right": (-1, 0, 0), "front": (0, 1, 0), "back": (0, -1, 0), "bottom": (0, 0, 1)}
    normals["top"] = (0, 0, -1)
    planes = {side: RigidPlane(tuple(0.5 - 0.5 * np.array(normal)), normal) for side, normal in normals.items()}
    contact = tuple(ContactPair(f"cube {side}", plane, clearance=clearance) for side, plane in planes.items())
    return Scene("squeezed", mesh, {"cube": PLAIN}, contact=contact)


def bump_on_plane(displacement=0.02, cells=3, pole=0.2, radius=4.0):
    """The body of `shapes.bump` on a rigid plane."""
    body = block((-1, -1, 0), (1, 1, 1), (cells, cells, 2), 2)

    def placed(x):
        return x[0], x[1], x[2] + (1 - x[2]) * ((x[0] - pole) ** 2 + (x[1] - pole) ** 2) / (2 * radius)

    mesh = root_mesh_from_shapes({"bump": body.placed(placed)})
    contact = (ContactPair("bump bottom", RigidPlane((0.0, 0.0, 0.0), UP), DOWN),)
    return Scene("bump on a plane", mesh, {"bump": PLAIN}, (held("bump top", -displacement),), contact)


def shrunk(interference):
    """A quarter of a slice of a ring, of radii 1 and 2, in plane strain on a rigid pin that is larger [m]."""
    mesh = root_mesh_from_shapes({"ring": ring(1.0, 2.0, 0.25, (3, 3, 1), 4, quarters=1)})
    planes = tuple(SymmetryPlane(f"ring {side}") for side in ("x = 0", "y = 0", "bottom", "top"))
    pin = RigidCylinder((0.0, 0.0, 0.0), UP, 1.0)
    contact = (ContactPair("ring inside", pin, clearance=-interference),)
    return Scene("shrunk", mesh, {"ring": PLAIN}, planes, contact, symmetry=4)


def prescribed(make, tolerance=0.1):
    """The scene with obstacles and rigid faces moved as their forces have moved them, by a run of degree 2."""
    scene = make()
    motions = solve(scene, tolerance, MPI.COMM_SELF, degree=2).record.motions
    contact = [
        replace(pair, force=None, direction=tuple(pair.unit_direction.tolist())) if pair.name in motions else pair
        for pair in scene.approached(motions).contact
    ]
    conditions = list(scene.dirichlet)
    for load in scene.rigid_loads:
        motion = motions[load.surface]
        conditions.append(RigidMotion(load.surface, tuple(motion[:3]), tuple(motion[3:]), load.point))
    return replace(scene, contact=contact, dirichlet=conditions, rigid_loads=())


def bar(cells, load, materials=(PLAIN, PLAIN), gap=None):
    """A bar of 4 x 1 x 1, clamped at one end: two halves that are tied, or one.

    Args:
        cells: root cells along the width, of each half or of all.
        load: force on the other end [N].
        materials: of the halves.
        gap: from a rigid plane below the last quarter; None: there is none [m].
    """
    parts = [
        block((x, 0, 0), (x + 4 / len(cells), 1, 1), (4 * n // len(cells), n, n), 1) for x, n in zip((0, 2), cells)
    ]
    parts[-1] = parts[-1].named("foot", "bottom", where=between(3, 4))
    bodies = dict(zip(("base", "tip"), parts))
    last = "tip" if len(parts) > 1 else "base"
    plane = RigidPlane((0.0, 0.0, -(gap or 0.0)), UP)
    return Scene(
        "bar",
        root_mesh_from_shapes(bodies),
        dict(zip(bodies, materials)),
        (Dirichlet("base left", 0.0, 0.0, 0.0),),
        () if gap is None else (ContactPair(f"{last} foot", plane),),
        (Traction(f"{last} right", load),),
        ties=(Tie("base right", "tip left"),) if len(parts) > 1 else (),
    )


def bracket(tied):
    """A leg on a foot, tied at 3:4 cells, or of one mesh, pulled sideways."""
    n, m = (3, 4) if tied else (2, 2)
    foot, leg = block((0, 0, 0), (3, 1, 1), (3 * n, n, n), 1), block((0, 0, 1), (1, 1, 3), (m, m, 2 * m), 1)
    surfaces = {"held": "foot right", "loaded": "leg top", "sole": "leg bottom", "seat": "foot top"}
    bodies = {"foot": foot, "leg": leg}
    if not tied:
        whole = join(foot, leg).named("held", "right", where=lambda x: x[0] > 2.9)
        bodies = {"foot": whole.named("loaded", "top", where=lambda x: x[2] > 2.9)}
        surfaces = {"held": "foot held", "loaded": "foot loaded"}
    return Scene(
        "bracket",
        root_mesh_from_shapes(bodies, surfaces),
        dict.fromkeys(bodies, PLAIN),
        (Dirichlet("held", 0.0, 0.0, 0.0),),
        tractions=(Traction("loaded", (1e-4, 0.0, 0.0)),),
        ties=(Tie("sole", "seat"),) if tied else (),
    )


def stamp(cells, depth=0.01, place=(0.5, 0.5), height=1.0, materials=(PLAIN, PLAIN)):
    """A cube pressed on a base of 2 x 2 x 2 that consists of two layers, tied.

    Args:
        cells: root cells along the edges of the lower and the upper layer and of the cube; None: the base is of one
            mesh, alike that of the cube.
        depth: displacement of the cube's top [m].
        place: of the cube's low corner [m].
        height: of the lower layer [m].
        materials: of the base and of the cube.
    """
    x, y = place

    def fitted(at):
        return (
            np.interp(at[0], [0, 2, 4, 6], [0, x, x + 1, 2]),
            np.interp(at[1], [0, 2, 4, 6], [0, y, y + 1, 2]),
            at[2],
        )

    if cells is None:
        cubic, ties = 2, ()
        base = block((0, 0, 0), (6, 6, 2), (6, 6, 3), 1)
        base = base.named("seat", "top", where=lambda at: between(2, 4)(at) & between(2, 4, axis=1)(at))
        bodies, seat = {"lower": base.placed(fitted)}, "lower seat"
    else:
        low, high, cubic = cells
        bodies = {
            "lower": block((0, 0, 0), (2, 2, height), (low, low, 2), 1),
            "higher": block((0, 0, height), (2, 2, 2), (high, high, 2), 1),
        }
        ties, seat = (Tie("lower top", "higher bottom"),), "higher top"
    known = dict.fromkeys(bodies, materials[0]) | {"cube": materials[1]}
    bodies["cube"] = block((x, y, 2), (x + 1, y + 1, 3), (cubic, cubic, 2), 1)
    return Scene(
        "stamp",
        root_mesh_from_shapes(bodies),
        known,
        (held("lower bottom"), held("cube top", -depth)),
        (ContactPair("cube bottom", seat, DOWN),),
        ties=ties,
    )


def layers(moduli, pressure):
    """Four unit cubes one on another, meshed apart: two that are tied on two that are tied."""
    names = "first", "second", "third", "fourth"
    counts = 2, 3, 2, 3
    bodies = {name: block((0, 0, k), (1, 1, k + 1), (n, n, 2), 1) for k, (name, n) in enumerate(zip(names, counts))}
    return Scene(
        "layers",
        root_mesh_from_shapes(bodies),
        {name: Material(young, 0.0) for name, young in zip(names, moduli)},
        (Dirichlet("first bottom", z=0.0), *sides(*names)),
        (ContactPair("second top", "third bottom", UP),),
        (Pressure("fourth top", pressure),),
        ties=(Tie("first top", "second bottom"), Tie("third top", "fourth bottom")),
    )
