"""Scenes of the stress matrix that the package does not have, and changes of those that it has."""

from dataclasses import replace

import numpy as np

from fx_contact import BodyForce, ContactPair, Dirichlet, Material, Pressure, Scene, SymmetryPlane, Traction
from fx_contact.geometry import hexahedron
from fx_contact.geometry.shapes import root_mesh_from_shapes
from fx_contact.geometry.solids import block

PLAIN = Material(young=1.0, poisson=0.3)
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


def held(surface, z=0.0):
    """A surface that moves along z alone."""
    return Dirichlet(surface, 0.0, 0.0, z)


def sides(*bodies):
    """Symmetry planes at the left and front sides of bodies."""
    return tuple(SymmetryPlane(f"{body} {side}") for body in bodies for side in ("left", "front"))


def corner_at(*position):
    """A place for vertices, by their coordinates."""
    return lambda x: np.abs(x - np.array(position)[:, None]).max(axis=0) < 1e-9


def between(low, high, axis=0):
    """A place for the sides of shapes, by one coordinate."""
    return lambda x: (x[axis] > low - 1e-9) & (x[axis] < high + 1e-9)


def clamped(scene):
    """The modelled part alone, its lower and upper faces held in all directions: no axis and no plane is special."""
    return replace(scene, dirichlet=(held("bottom"), held("top", -0.01)), symmetry=1)


def all_held(scene):
    """The scene clamped, its contact surfaces held sideways: on one layer of cells all unknowns are prescribed."""
    sideways = [Dirichlet(name, x=0.0, y=0.0) for pair in scene.contact for name in (pair.first, pair.second)]
    scene = clamped(scene)
    return replace(scene, dirichlet=(*scene.dirichlet, *sideways))


def sheared_nodes(scene, amount, axes):
    """Inner nodes of all root cells moved along axes towards one side, until the cells degenerate at amount = 1.

    The bodies keep their shape: only the maps of the cells change, x -> x + amount x (1 - x) in each cell.
    """
    mesh = scene.mesh
    place = hexahedron.grid_points(mesh.order) / mesh.order
    moved = place.copy()
    moved[:, axes] += amount * place[:, axes] * (1 - place[:, axes])
    trilinear = np.prod(np.where(hexahedron.CORNERS[None] == 1, moved[:, None], 1 - moved[:, None]), axis=2)
    points = mesh.points.copy()
    points[mesh.cells] = trilinear @ mesh.points[mesh.corners]
    return replace(scene, mesh=replace(mesh, points=points))


def without(scene, *places):
    """The scene without its conditions on some places."""
    return replace(scene, dirichlet=tuple(d for d in scene.dirichlet if d.where not in places))


def in_two(scene):
    """The scene, each of its contact pairs cut into two halves, whose facets share vertices where they meet."""
    surfaces, pairs = dict(scene.mesh.surfaces), []
    for pair in scene.contact:
        for surface in (pair.first, pair.second):
            facets = scene.mesh.surfaces[surface]
            centre = scene.mesh.facet_points(facets, order=1).mean(axis=1)
            along = np.cross(centre, pair.direction) @ [1.0, 2.0, 3.0]  # the same on both surfaces
            first = along < np.median(along) + 1e-6
            surfaces |= {f"{surface} a": facets[first], f"{surface} b": facets[~first]}
        pairs += [replace(pair, first=f"{pair.first} {side}", second=f"{pair.second} {side}") for side in "ab"]
    return replace(scene, mesh=replace(scene.mesh, surfaces=surfaces), contact=tuple(pairs))


def corner(push=0.01, materials=(PLAIN, PLAIN, PLAIN)):
    """A cube pressed into the corner of a floor and a wall that stands on it: three bodies, three contact pairs."""
    floor = block((-1, 0, -1), (1, 1, 0), (4, 2, 2), 1)
    floor = floor.named("left half", "top", where=between(-1, 0)).named("right half", "top", where=between(0, 1))
    bodies = {"floor": floor, "wall": block((-1, 0, 0), (0, 1, 1), (2, 2, 2), 1)}
    bodies["cube"] = block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)
    conditions = [Dirichlet("floor bottom", z=0.0), Dirichlet("floor left", x=0.0), Dirichlet("wall left", x=0.0)]
    conditions += [Dirichlet("wall top", z=-push), Dirichlet("cube top", z=-push), Dirichlet("cube right", x=-push)]
    conditions += [Dirichlet(f"{body} {side}", y=0.0) for body in bodies for side in ("front", "back")]
    pairs = [ContactPair("floor left half", "wall bottom", UP), ContactPair("floor right half", "cube bottom", UP)]
    pairs.append(ContactPair("wall right", "cube left", (1.0, 0.0, 0.0)))
    return Scene("corner", root_mesh_from_shapes(bodies), dict(zip(bodies, materials)), conditions, pairs)


def on_block(name, height, cells, order, displacement, materials=(PLAIN, PLAIN), pairs=1, other=None):
    """A body whose lower face has a height above a block, with its top moved down.

    Args:
        name: of the body.
        height: function of x and y [m].
        cells: root cells along x and y, a multiple of `pairs`.
        order: of the root mesh.
        displacement: of the top [m].
        materials: of the block and of the body.
        pairs: contact pairs, side by side along x.
        other: root cells of the body, meshed apart; None: as of the block.
    """
    base = block((-1, -1, -1), (1, 1, 0), (cells, cells, 2), order)
    other = cells if other is None else other
    body = block((-1, -1, 0), (1, 1, 1), (other, other, 2), order)
    for k in range(pairs):
        part = between(2 * k / pairs - 1, 2 * (k + 1) / pairs - 1)
        base, body = base.named(f"part {k}", "top", where=part), body.named(f"part {k}", "bottom", where=part)
    body = body.placed(lambda x: (x[0], x[1], x[2] + (1 - x[2]) * height(x[0], x[1])))
    return Scene(
        name,
        root_mesh_from_shapes({"base": base, name: body}),
        dict(zip(("base", name), materials)),
        (held("base bottom"), held(f"{name} top", -displacement)),
        tuple(ContactPair(f"base part {k}", f"{name} part {k}", UP) for k in range(pairs)),
    )


def bump(cells=3, pole=0.0, displacement=0.02, radius=4.0, **more):
    """A paraboloid of a radius of curvature [m] pressed on a block; where its pole x = y is, the cells decide."""
    return on_block(
        "bump", lambda x, y: ((x - pole) ** 2 + (y - pole) ** 2) / (2 * radius), cells, 2, displacement, **more
    )


def waves(phase, cells=2):
    """Two waves of 1 cm along x, of some phase relative to their length, pressed on a block.

    Two root cells have their vertices, and the middles of their edges, all on crests, all in valleys or, for a
    phase of 0 or 1/2, at the mean height: then all nodes touch at once, and the waves seem to be flat.
    """
    return on_block("waves", lambda x, _: 0.01 * np.sin(2 * np.pi * (x + phase)), cells, 6, 0.001)


def films(wave=0.0, order=6, pressure=0.0, weight=0.0, cells=2):
    """Two thin films pressed into each other by 1e-4 m: the upper with four waves on its face, the lower loaded too.

    Args:
        wave: height of the waves, all of whose nodes touch at once on two cells [m].
        order: of the root mesh.
        pressure: on the end of the lower film, beside the upper one [Pa].
        weight: of the lower film [N/m^3].
        cells: root cells along a film's width.
    """
    thick = 0.05
    lower = block((0, 0, -thick), (3, 1, 0), (3 * cells, cells, 1), order)
    lower = lower.named("below", "top", where=between(0, 1)).named("end", "top", where=between(2, 3))
    upper = block((0, 0, 0), (1, 1, thick), (cells, cells, 1), order)
    upper = upper.placed(lambda x: (x[0], x[1], x[2] - (1 - x[2] / thick) * wave * np.cos(8 * np.pi * x[0])))
    sunk = weight * thick**2 / 2  # the lower film by its weight
    return Scene(
        "films",
        root_mesh_from_shapes({"lower": lower, "upper": upper}),
        dict.fromkeys(("lower", "upper"), Material(1.0, 0.0)),
        (held("lower bottom"), held("upper top", -1e-4 - sunk)),
        (ContactPair("lower below", "upper bottom", UP),),
        (Pressure("lower end", pressure),) if pressure else (),
        body_forces=(BodyForce("lower", (0.0, 0.0, -weight)),) if weight else (),
    )


def on_a_base(light=1e-4, heavy=0.0, pressure=0.0, cells=2, thick=0.05, wide=10.0):
    """A plate pressed on half of a base as thin, whose other half carries a heavier plate or a pressure.

    Args:
        light: displacement of the plate [m].
        heavy: displacement of the other plate; 0: there is none [m].
        pressure: on the farther half of the other half [Pa].
        cells: root cells along a plate's width.
        thick, wide: height and width of a plate [m].
    """
    base = block((0, 0, -thick), (2 * wide, wide, 0), (2 * cells, cells, 1), 1)
    base = base.named("end", "top", where=between(1.5 * wide, 2 * wide))
    plates, conditions, pairs = {}, [held("base bottom")], []
    for left, (body, depth) in ((0.0, ("light", light)), (wide, ("heavy", heavy))):
        if depth:
            plates[body] = block((left, 0, 0), (left + wide, wide, thick), (cells, cells, 1), 1)
            base = base.named(f"below {body}", "top", where=between(left, left + wide))
            conditions.append(held(f"{body} top", -depth))
            pairs.append(ContactPair(f"base below {body}", f"{body} bottom", UP))
    mesh = root_mesh_from_shapes({"base": base, **plates})
    loads = [Pressure("base end", pressure)] if pressure else []
    return Scene("on a base", mesh, dict.fromkeys(mesh.bodies, Material(1.0, 0.0)), conditions, pairs, loads)


def beam(closing, poisson=0.0, tension=0.0, near=None, beside=0.0, afar=0.0, touch=0.0, thick=1.0):
    """A cantilever of 10 m that a pressure bends towards a block under its tip.

    Args:
        closing: gap before the tip, relative to its deflection by the theory of slender beams, p L^4 / (8 E I) [-].
        poisson: of both [-].
        tension: along the beam, on its end [Pa].
        near: gap beside the wall, relative to that before the tip; None: the block is under the tip alone [-].
        beside: pressure on a block that is wider, far from the tip [Pa].
        afar: how far the block comes from, turning about the wall [m].
        touch: displacement of a cube that touches another one beside the beam, in the same contact pair [m].
        thick: height of the beam; the pressure is such that it bends as far as one of height 1 does [m].
    """
    long, pressure, start = 10.0, 1e-5, 9.0 if near is None else 0.0
    gap = closing * 1.5 * pressure * long**4

    def lowered(x):
        share = 1.0 if near is None else near + (1 - near) * x[0] / long
        return x[0], x[1], x[2] - (gap * share + afar * x[0] / long)

    low, high = ((start, 0, -4), (15, 4, 0)) if beside else ((start, 0, -1), (long, 1, 0))
    under = block(low, high, np.subtract(high, low).astype(int), 1)
    under = under.named("head", "top", where=lambda x: between(start, long)(x) & between(0, 1, axis=1)(x))
    bodies = {
        "beam": block((0, 0, 0), (long, 1, thick), (10, 1, 1), 1).named("tip", "bottom", where=between(start, long))
    }
    conditions = [held("wall"), held("foot", (lambda x: afar * x[0] / long) if afar else 0.0)]
    surfaces = {"wall": "beam left", "load": "beam top", "end": "beam right", "foot": "block bottom"}
    surfaces |= {"tip": ["beam tip"], "head": ["block head"]}
    loads = [Pressure("load", pressure * thick**3)]
    if tension:
        loads.append(Traction("end", (tension, 0.0, 0.0)))
    if beside:
        under = under.named("patch", "top", where=lambda x: between(13, 15)(x) & between(2, 4, axis=1)(x))
        surfaces["patch"] = "block patch"
        loads.append(Pressure("patch", beside))
    bodies["block"] = under.placed(lowered)
    if touch:
        bodies |= {
            "lower": block((0, 3, -1), (1, 4, 0), (1, 1, 1), 1),
            "upper": block((0, 3, 0), (1, 4, 1), (1, 1, 1), 1),
        }
        surfaces["tip"].append("upper bottom")
        surfaces["head"].append("lower top")
        surfaces |= {"root": "lower bottom", "top": "upper top"}
        conditions += [held("root"), held("top", -touch)]
    materials = dict.fromkeys(bodies, Material(1.0, poisson))
    pairs = (ContactPair("tip", "head", DOWN),)
    return Scene("beam", root_mesh_from_shapes(bodies, surfaces), materials, conditions, pairs, loads)


def four_supports():
    """Half the width of a beam 9 m long and half a metre high, on four supports of 1 m, under a pressure."""
    long, supports = block((0, 0, 0), (9, 1, 0.5), (18, 2, 1), 1), {}
    conditions, pairs = [Dirichlet("beam left", x=0.0), SymmetryPlane("beam front")], []
    for x in (0.0, 2.5, 5.5, 8.0):
        name = f"support at {x:g}"
        long = long.named(f"above {name}", "bottom", where=between(x, x + 1))
        supports[name] = block((x, 0, -1), (x + 1, 1, 0), (2, 2, 2), 1)
        conditions.append(held(f"{name} bottom"))
        pairs.append(ContactPair(f"beam above {name}", f"{name} top", DOWN))
    mesh = root_mesh_from_shapes({"beam": long, **supports})
    materials = {"beam": PLAIN} | dict.fromkeys(supports, Material(10.0, 0.3))
    return Scene("four supports", mesh, materials, conditions, pairs, (Pressure("beam top", 1e-4),))


def plate_over_a_stop(thick, share, wide, ratio, poisson, cells=4):
    """A quarter of a plate of 8 m that is held at two ends, bent on a stop by a pressure.

    Args:
        thick: height of the plate [m].
        share: gap over the deflection of a beam without the stop [-].
        wide: root cells of the stop, of 4 along the plate's half.
        ratio: of the stop's Young's modulus to the plate's.
        poisson: of both.
        cells: root cells along half of the plate.
    """
    half, pressure = 4.0, 1e-3 * thick**3
    gap = share * pressure * (2 * half) ** 4 / (32 * thick**3)  # clamped ends: p L^4 / (384 E I)
    plate = block((0, 0, 0), (half, 2, thick), (cells, cells // 2, 1), 1)
    plate = plate.named("below", "bottom", where=between(0, wide))
    stop = block((0, 0, -1), (wide, 2, 0), (wide * cells // 4, cells // 2, 1), 1).shifted(z=-gap)
    return Scene(
        "plate over a stop",
        root_mesh_from_shapes({"plate": plate, "stop": stop}),
        {"plate": Material(1.0, poisson), "stop": Material(ratio, poisson)},
        (held("plate right"), held("stop bottom"), *sides("plate", "stop")),
        (ContactPair("plate below", "stop top", DOWN),),
        (Pressure("plate top", pressure),),
    )


def sinking(deeper):
    """A round body that lightly touches a block, which sinks under a pressure of 0.1 Pa beside it, a quarter of both.

    Args:
        deeper: displacement of the body beyond the 0.02228 m by which the block sinks below it without contact [m].
    """
    side = 0.5
    base = block((0, 0, -2), (2, 2, 0), (4, 4, 4), 2).named("load", "top", where=between(1, 2))
    base = base.named("below", "top", where=lambda x: between(0, side)(x) & between(0, side, axis=1)(x))
    body = block((0, 0, 0), (side, side, side), (1, 1, 1), 2)
    body = body.placed(lambda x: (x[0], x[1], x[2] + (1 - x[2] / side) * (x[0] ** 2 + x[1] ** 2) / 2))  # radius 1 m
    return Scene(
        "sinking",
        root_mesh_from_shapes({"block": base, "body": body}),
        dict.fromkeys(("block", "body"), PLAIN),
        (held("block bottom"), Dirichlet("body top", z=-0.02228 - deeper), *sides("block", "body")),
        (ContactPair("block below", "body bottom", UP),),
        (Pressure("block load", 0.1),),
    )


def oblique(degrees, direction=None):
    """Two blocks that meet in a plane, its normal so many degrees from z; ends are held, the upper one is lowered."""
    slope = np.tan(np.radians(degrees))
    bodies = {"base": block((0, 0, -1), (1, 1, 0), (2, 2, 2), 1), "block": block((0, 0, 0), (1, 1, 1), (2, 2, 2), 1)}
    bodies = {
        name: shape.placed(lambda x: (x[0], x[1], x[2] + (x[0] - 0.5) * slope * (1 - np.abs(x[2]))))
        for name, shape in bodies.items()
    }
    conditions, pair = (held("base bottom"), held("block top", -0.01)), ContactPair(
        "base top", "block bottom", direction
    )
    return Scene("oblique", root_mesh_from_shapes(bodies), dict.fromkeys(bodies, PLAIN), conditions, (pair,))


def ring(bodies):
    """Blocks in a closed ring, each in contact with the next one, their outer faces moved inwards by 1 cm."""

    def bent(x):
        angle, radius = -2 * np.pi / bodies * x[0], 1 + x[1]
        return radius * np.cos(angle), radius * np.sin(angle), x[2]

    names, conditions = [f"block {k}" for k in range(bodies)], []
    inwards = [lambda x, axis=axis: -0.01 * x[axis] / np.hypot(x[0], x[1]) for axis in (0, 1)]
    for name in names:
        conditions += [Dirichlet(f"{name} back", *inwards, 0.0), SymmetryPlane(f"{name} bottom")]
    shapes = {name: block((k, 0, 0), (k + 1, 1, 1), (2, 2, 1), 2).placed(bent) for k, name in enumerate(names)}
    pairs = tuple(ContactPair(f"{one} right", f"{next} left") for one, next in zip(names, names[1:] + names[:1]))
    return Scene("ring", root_mesh_from_shapes(shapes), dict.fromkeys(names, PLAIN), conditions, pairs)
