"""Scenes of bonded parts, stress-free strains, preloads, springs and rigid faces; each function makes a Scene."""

from dataclasses import replace

import numpy as np

from fx_contact import (
    ContactPair,
    Dirichlet,
    Elastic,
    InitialStrain,
    Material,
    Preload,
    RigidCylinder,
    RigidLoad,
    RigidPlane,
    RigidSphere,
    Scene,
    SymmetryPlane,
    ThermalStrain,
    Tie,
    Traction,
    block,
    join,
    ring,
    root_mesh_from_shapes,
)
from studies.stability.shapes import DOWN, PLAIN, UP, corner_at, held, sides


def layers(heights, materials, displacement, cells=(2, 3), base=PLAIN):
    """A column of bonded layers, a square of 1 m, pressed on a cube that is meshed apart.

    Args:
        heights: of the layers, from below [m].
        materials: theirs.
        displacement: of the column's top [m].
        cells: root cells along the width, of the column and of the cube.
        base: material of the cube.
    """
    ends = np.concatenate([[0.0], np.cumsum(heights)])
    names = [f"layer {k}" for k in range(len(heights))]
    places = zip(names, ends[:-1], ends[1:])
    parts = [block((0, 0, low), (1, 1, high), (cells[0],) * 2 + (1,), 1).as_part(name) for name, low, high in places]
    bodies = {"column": join(*parts), "base": block((0, 0, -1), (1, 1, 0), (cells[1],) * 3, 1)}
    return Scene(
        "layers",
        root_mesh_from_shapes(bodies),
        {f"column {name}": material for name, material in zip(names, materials)} | {"base": base},
        (Dirichlet("base bottom", z=0.0), Dirichlet("column top", z=-displacement), *sides(*bodies)),
        (ContactPair("column bottom", "base top", DOWN),),
    )


def coated(thick, materials, cells=2, place=(0.0, 0.0), depth=0.01, parts=True, radius=1.0):
    """A rigid sphere pressed into a block of 2 x 2 x 1 with a bonded coating.

    Args:
        thick: height of the coating [m].
        materials: of the block and of the coating; without parts the first one.
        cells: root cells along half of the width.
        place: of the sphere's pole, x and y [m].
        depth: displacement of the sphere [m].
        parts: whether the coating is a part.
        radius: of the sphere [m].
    """
    core = block((-1, -1, -1), (1, 1, -thick), (2 * cells, 2 * cells, cells), 1)
    coating = block((-1, -1, -thick), (1, 1, 0), (2 * cells, 2 * cells, 1), 1)
    whole, known = join(core, coating), {"block": materials[0]}
    if parts:
        whole = join(core.as_part("core"), coating.as_part("coating"))
        known = {"block core": materials[0], "block coating": materials[1]}
    sphere = RigidSphere((*place, radius), radius)
    return Scene(
        "coated",
        root_mesh_from_shapes({"block": whole}),
        known,
        (held("block bottom"),),
        (ContactPair("block top", sphere, direction=UP, moved=(0.0, 0.0, -depth)),),
    )


def across(materials, displacement):
    """A block of two parts side by side below a rigid plane that touches both."""
    both = [block((x, 0, 0), (x + 1, 1, 1), (2, 2, 2), 1).as_part(f"part {x}") for x in (0, 1)]
    return Scene(
        "across",
        root_mesh_from_shapes({"block": join(*both)}),
        {f"block part {k}": material for k, material in enumerate(materials)},
        (Dirichlet("block bottom", z=0.0), *sides("block")),
        (ContactPair("block top", RigidPlane((0, 0, 1), DOWN), moved=(0.0, 0.0, -displacement)),),
    )


def over_a_joint(materials, matched):
    """A cube pressed by 0.01 m on the middle of a block of two bonded parts, side by side."""
    cells, upper = ((3, 4, 2), (4, 2, 2)) if matched else ((2, 3, 2), (5, 3, 2))
    low = [block((x, 0, -1), (x + 1.5, 2, 0), cells, 1).as_part(f"part {k}") for k, x in enumerate((-1.5, 0.0))]
    base, seat = join(*low), "base top"
    if matched:
        base, seat = (
            base.named("seat", "top", where=lambda x: (abs(x[0]) < 1.01) & (abs(x[1] - 1) < 0.51)),
            "base seat",
        )
    bodies = {"base": base, "cube": block((-1, 0.5, 0), (1, 1.5, 1), upper, 1)}
    return Scene(
        "over a joint",
        root_mesh_from_shapes(bodies),
        {f"base part {k}": material for k, material in enumerate(materials)} | {"cube": PLAIN},
        (held("base bottom"), held("cube top", -0.01)),
        (ContactPair("cube bottom", seat, DOWN),),
    )


def lined(materials, interference, order=4):
    """A quarter of a tube with a lining, radii 1, 1.5 and 2.5, on a larger rigid pin; and the pin's force [N].

    In plane strain u = a r + b / r in each part, s_rr = 2 (lambda + mu) a - 2 mu b / r^2.
    """
    ends = {"lining": (1.0, 1.5), "jacket": (1.5, 2.5)}
    parts = [ring(*radii, 0.25, (2, 3, 1), order, quarters=1).as_part(name) for name, radii in ends.items()]
    planes = tuple(SymmetryPlane(f"tube {side}") for side in ("x = 0", "y = 0", "bottom", "top"))
    pair = ContactPair("tube inside", RigidCylinder((0.0, 0.0, 0.0), UP, 1.0), clearance=-interference)
    known = dict(zip(("tube lining", "tube jacket"), materials))
    scene = Scene("lined", root_mesh_from_shapes({"tube": join(*parts)}), known, planes, (pair,), symmetry=4)
    (first, second), (other, shear) = (material.lame for material in materials)
    equations = [
        [1, 1, 0, 0],
        [1.5, 1 / 1.5, -1.5, -1 / 1.5],
        [2 * (first + second), -2 * second / 1.5**2, -2 * (other + shear), 2 * shear / 1.5**2],
        [0, 0, 2 * (other + shear), -2 * shear / 2.5**2],
    ]
    a, b, _, _ = np.linalg.solve(equations, [interference, 0, 0, 0])
    return scene, -(2 * (first + second) * a - 2 * second * b) * 2 * np.pi * 0.25


def turned_blocks(materials, displacement):
    """Unit cubes of any materials on each other between plates without friction, free sideways; the stress is uniform.

    Each has the supports of a rigid motion in the plane at two corners of its bottom.
    """
    bodies, conditions, vertices = {}, [Dirichlet("block 0 bottom", z=0.0)], {}
    for k in range(len(materials)):
        name = f"block {k}"
        bodies[name] = block((0, 0, k), (1, 1, k + 1), (2, 2, 2), 1)
        vertices |= {f"foot {k}": (name, corner_at(0, 0, k)), f"toe {k}": (name, corner_at(1, 0, k))}
        conditions += [Dirichlet(f"foot {k}", x=0.0, y=0.0), Dirichlet(f"toe {k}", y=0.0)]
    pairs = [ContactPair(f"block {k} top", f"block {k + 1} bottom", UP) for k in range(len(materials) - 1)]
    conditions.append(Dirichlet(f"block {len(materials) - 1} top", z=-displacement))
    mesh = root_mesh_from_shapes(bodies, vertices=vertices)
    return Scene("turned blocks", mesh, dict(zip(bodies, materials)), conditions, pairs)


def free_block(tensor, material=PLAIN):
    """A sheared block with a stress-free strain, held as a rigid body at three vertices; it has no stress."""
    shape = block((0, 0, 0), (2, 1, 1), (2, 1, 1), 1).placed(lambda x: (x[0] + 0.3 * x[2], x[1] + 0.2 * x[0], x[2]))
    corners = {"at": (0.0, 0.0, 0.0), "one": (2.0, 0.4, 0.0), "other": (0.0, 1.0, 0.0)}
    vertices = {name: ("block", corner_at(*corner)) for name, corner in corners.items()}
    one, other = (np.asarray(tensor) @ corners[name] for name in ("one", "other"))
    conditions = (
        Dirichlet("at", 0.0, 0.0, 0.0),
        Dirichlet("one", y=float(one[1]), z=float(one[2])),
        Dirichlet("other", z=float(other[2])),
    )
    mesh = root_mesh_from_shapes({"block": shape}, vertices=vertices)
    return Scene("free block", mesh, {"block": material}, conditions, strains=InitialStrain("block", tensor))


def heated_bar(strain, gap, material=PLAIN):
    """A bar of 2 x 1 x 1 m that expands towards a rigid plane, free sideways.

    Args:
        strain: alpha dT [-].
        gap: before the plane [m].
    """
    mesh = root_mesh_from_shapes({"bar": block((0, 0, 0), (2, 1, 1), (2, 1, 1), 1)})
    planes = tuple(SymmetryPlane(f"bar {side}") for side in ("left", "front", "bottom"))
    pair = ContactPair("bar right", RigidPlane((2.0 + gap, 0, 0), (-1.0, 0.0, 0.0)))
    return Scene("heated bar", mesh, {"bar": material}, planes, (pair,), strains=ThermalStrain("bar", strain, 1.0))


def bimetal(moduli, strains, length=20.0):
    """A strip of two bonded layers of height 1 whose misfit along it bends it; and twice its energy.

    Without a Poisson's ratio plane sections of beams are exact: the energy is least over stretch and curvature.
    """
    parts = [block((0, 0, z), (length, 1, z + 1), (10, 1, 1), 1).as_part(f"layer {z}") for z in (0, 1)]
    mesh = root_mesh_from_shapes({"strip": join(*parts)}, vertices={"foot": ("strip", corner_at(0, 0, 0))})
    scene = Scene(
        "bimetal",
        mesh,
        {f"strip layer {z}": Material(young, 0.0) for z, young in enumerate(moduli)},
        (Dirichlet("strip left", x=0.0), Dirichlet("foot", z=0.0), SymmetryPlane("strip front")),
        strains=[InitialStrain(f"strip layer {z}", ((e, 0, 0), (0, 0, 0), (0, 0, 0))) for z, e in enumerate(strains)],
        rigid_loads=RigidLoad("strip right"),
    )
    matrix, vector, least = np.zeros((2, 2)), np.zeros(2), 0.0
    for z, (young, strain) in enumerate(zip(moduli, strains)):
        first, second = z + 1 / 2, ((z + 1) ** 3 - z**3) / 3
        matrix += young * np.array([[1, first], [first, second]])
        vector += young * strain * np.array([1, first])
        least += young * strain**2
    return scene, length * (least - vector @ np.linalg.solve(matrix, vector))


def fitted(radii, strains, materials, order=4):
    """An eighth of two rings whose stress-free strains press them on each other, free along their axis."""
    ends = {"inner": radii[:2], "outer": radii[1:]}
    bodies = {name: ring(*both, 0.25, (2, 3, 1), order, quarters=1) for name, both in ends.items()}
    planes = tuple(SymmetryPlane(f"{name} {side}") for name in ends for side in ("x = 0", "y = 0", "bottom"))
    return Scene(
        "fitted",
        root_mesh_from_shapes(bodies),
        dict(zip(ends, materials)),
        planes,
        (ContactPair("inner outside", "outer inside"),),
        strains=[ThermalStrain(name, strain, 1.0) for name, strain in zip(ends, strains)],
        symmetry=8,
    )


def bolted(bolts, sleeve, tensions, closing=None, pull=0.0):
    """Bolts of 1 x 1 x 2 m beside a sleeve of 2 x 1 x 2 m below a stiff cap that cannot tilt, pulled upwards.

    Args:
        bolts: Young's moduli of one or two [Pa].
        sleeve: Young's modulus [Pa].
        tensions: of the bolts [N].
        closing: of the bolts instead [m].
        pull: on the cap [N].
    """
    stiff = Material(1e6 * max(*bolts, sleeve), 0.0)
    bodies = {"sleeve": block((1, 0, 0), (3, 1, 2), (4, 2, 2), 1), "cap": block((1, 0, 2), (3, 1, 3), (4, 2, 1), 1)}
    materials = {"sleeve": Material(sleeve, 0.0), "cap": stiff}
    feet, ties = [Dirichlet("sleeve bottom", z=0.0)], []
    for k, (young, tension) in enumerate(zip(bolts, tensions)):
        x, near = (0, "right") if k == 0 else (3, "left")
        for name, z in ((f"shank {k}", 0), (f"bolt {k}", 1), (f"head {k}", 2)):
            bodies[name] = block((x, 0, z), (x + 1, 1, z + 1), (2, 2, 1), 1)
            materials[name] = stiff if z == 2 else Material(young, 0.0)
        known = {"tension": tension} if closing is None else {"closing": closing}
        ties.append(Preload(f"bolt {k} bottom", f"shank {k} top", axis=DOWN, **known))
        ties += [
            Tie(f"head {k} bottom", f"bolt {k} top"),
            Tie(f"head {k} {near}", f"cap {'left' if k == 0 else 'right'}"),
        ]
        feet.append(Dirichlet(f"shank {k} bottom", z=0.0))
    upright = [Dirichlet(f"{body} {side}", x=0.0) for body in bodies for side in ("left", "right")]
    upright += [Dirichlet(f"{body} {side}", y=0.0) for body in bodies for side in ("front", "back")]
    return Scene(
        "bolted",
        root_mesh_from_shapes(bodies),
        materials,
        (*upright, *feet),
        ContactPair("sleeve top", "cap bottom", direction=UP),
        (Traction("cap top", (0.0, 0.0, pull / 2)),) if pull else (),
        ties=ties,
    )


def on_springs(moduli, below, displacement, between_them=None, gap=0.0):
    """Two unit cubes, meshed alike, without a Poisson's ratio, the lower one on springs, the upper one pressed on it.

    Args:
        moduli: of the lower and of the upper one [Pa].
        below: stiffness of the springs below the lower one [N/m^3].
        between_them: stiffness of springs on the lower cube's top, beside contact; None: there are none [N/m^3].
    """
    bodies = {"lower": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1), "upper": block((0, 0, 1), (1, 1, 2), (2, 2, 2), 1)}
    springs = [Elastic("lower bottom", below)]
    if between_them is not None:
        springs.append(Elastic("lower top", z=between_them))
    return Scene(
        "on springs",
        root_mesh_from_shapes(bodies),
        {name: Material(young, 0.0) for name, young in zip(bodies, moduli)},
        (*sides(*bodies), Dirichlet("upper top", z=-displacement)),
        ContactPair("lower top", "upper bottom", direction=UP, clearance=gap),
        springs=springs,
    )


def bedded(scene, stiffness, surface):
    """The scene on springs along all axes, per area [N/m^3], instead of what holds a surface."""
    kept = tuple(condition for condition in scene.dirichlet if condition.where != surface)
    return replace(scene, dirichlet=kept, springs=Elastic(surface, x=stiffness, y=stiffness, z=stiffness))


def rod(length, load, material=PLAIN, cells=(1, 1, 20)):
    """A bar of the unit square along z, clamped below, its other end below a rigid load."""
    mesh = root_mesh_from_shapes({"bar": block((0, 0, 0), (1, 1, length), cells, 1)})
    clamp = Dirichlet("bar bottom", 0.0, 0.0, 0.0)
    return Scene("rod", mesh, {"bar": material}, clamp, rigid_loads=load)


def rocking(force, moment, cells=2):
    """A unit cube without a Poisson's ratio, pressed on a rigid plane by a rigid load beside its middle.

    Args:
        force: downwards [N].
        moment: about the y axis [N m].
        cells: root cells along an edge.
    """
    mesh = root_mesh_from_shapes({"block": block((-0.5, -0.5, 0), (0.5, 0.5, 1), (cells, cells, cells), 1)})
    load = RigidLoad("block top", (0.0, 0.0, -force), (0.0, moment, 0.0))
    planes = (Dirichlet("block front", y=0.0), Dirichlet("block top", x=0.0))
    pair = ContactPair("block bottom", RigidPlane((0.0, 0.0, 0.0), UP))
    return Scene("rocking", mesh, {"block": Material(1.0, 0.0)}, planes, pair, rigid_loads=load)
