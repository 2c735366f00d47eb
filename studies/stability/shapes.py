"""Scenes of the stress matrix that the package does not have, and ways to spoil those that it has."""

from dataclasses import replace

import numpy as np

from fx_contact import BodyForce, ContactPair, Dirichlet, Material, Pressure, Scene, SymmetryPlane, Traction
from fx_contact.problem import hexahedron
from studies.boxes import BACK, DOWN, FRONT, LEFT, RIGHT, UP, Boxes

PLAIN = Material(young=1.0, poisson=0.3)


def clamped(scene, displacement=0.01):
    """The modelled part alone, its lower and upper faces held in all directions: no axis and no plane is special."""
    held = Dirichlet("bottom", x=0.0, y=0.0, z=0.0), Dirichlet("top", x=0.0, y=0.0, z=-displacement)
    return replace(scene, dirichlet=held, symmetry=1)


def all_held(scene, displacement=0.01):
    """The scene clamped, its contact surfaces held sideways: on one layer of cells all unknowns are prescribed."""
    sideways = [Dirichlet(name, x=0.0, y=0.0) for pair in scene.contact for name in (pair.first, pair.second)]
    scene = clamped(scene, displacement)
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


def corner(push=0.01, materials=(PLAIN, PLAIN, PLAIN), order=1):
    """A cube pressed into the corner of a floor and a wall that stands on it: three bodies, three contact pairs."""
    boxes = Boxes(order)
    boxes.add("floor", (-1.0, 0.0, -1.0), (1.0, 1.0, 0.0), (4, 2, 2))
    boxes.add("wall", (-1.0, 0.0, 0.0), (0.0, 1.0, 1.0), (2, 2, 2))
    boxes.add("cube", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2, 2, 2))
    ground = boxes.facets(UP, 0.0, "floor")
    under_cube = ground[:, 0] % 4 >= 2
    surfaces = {
        "bottom": boxes.facets(DOWN, -1.0),
        "floor left": boxes.facets(LEFT, -1.0, "floor"),
        "wall left": boxes.facets(LEFT, -1.0, "wall"),
        "wall top": boxes.facets(UP, 1.0, "wall"),
        "cube top": boxes.facets(UP, 1.0, "cube"),
        "cube right": boxes.facets(RIGHT, 1.0, "cube"),
        "y = 0": boxes.facets(FRONT, 0.0),
        "y = 1": boxes.facets(BACK, 1.0),
        "ground of wall": ground[~under_cube],
        "ground of cube": ground[under_cube],
        "wall foot": boxes.facets(DOWN, 0.0, "wall"),
        "cube foot": boxes.facets(DOWN, 0.0, "cube"),
        "wall face": boxes.facets(RIGHT, 0.0, "wall"),
        "cube side": boxes.facets(LEFT, 0.0, "cube"),
    }
    held = [Dirichlet("bottom", z=0.0), Dirichlet("floor left", x=0.0), Dirichlet("wall left", x=0.0)]
    held += [Dirichlet("wall top", z=-push), Dirichlet("cube top", z=-push), Dirichlet("cube right", x=-push)]
    held += [Dirichlet("y = 0", y=0.0), Dirichlet("y = 1", y=0.0)]
    pairs = [ContactPair(f"ground of {body}", f"{body} foot", direction=(0.0, 0.0, 1.0)) for body in ("wall", "cube")]
    pairs.append(ContactPair("wall face", "cube side", direction=(1.0, 0.0, 0.0)))
    return Scene("corner", boxes.mesh(surfaces), dict(zip(("floor", "wall", "cube"), materials)), held, pairs)


def bump(cells=3, pole=0.0, displacement=0.02, radius=4.0):
    """A block with a paraboloid below, pressed on another block; where its pole is nothing but the cells decide.

    Args:
        cells: root cells along x and y.
        pole: x and y of the pole [m].
        displacement: of the top [m].
        radius: of curvature [m].
    """
    return on_block("bump", lambda x, y: ((x - pole) ** 2 + (y - pole) ** 2) / (2 * radius), cells, 2, displacement)


def waves(phase=0.0, cells=2, displacement=0.001, amplitude=0.01, order=6):
    """A block with two waves below, pressed on another block.

    Two root cells along x have their vertices, and the middles of their edges, all on crests, all in valleys or, for a
    phase of 0 or 1/2, at the mean height: then all nodes touch at once, and the waves seem to be flat.

    Args:
        phase: of the waves, along x, relative to their length.
        cells: root cells along x and y.
        displacement: of the top [m].
        amplitude: of the waves [m].
        order: of the root mesh.
    """
    return on_block("waves", lambda x, _: amplitude * np.sin(2 * np.pi * (x + phase)), cells, order, displacement)


def films(wave=0.0, order=6, pressure=0.0, weight=0.0, cells=2):
    """Two thin films pressed into each other by 1e-4 m: the upper with four waves on its face, the lower loaded too.

    Args:
        wave: height of the waves, all of whose nodes touch at once on two cells [m].
        order: of the root mesh.
        pressure: on the end of the lower film, beside the upper one [Pa].
        weight: of the lower film [N/m^3].
        cells: root cells along a film's width.
    """
    boxes, thick = Boxes(order), 0.05
    sunk = weight * thick**2 / 2  # the lower film by its weight
    boxes.add("lower", (0.0, 0.0, -thick), (3.0, 1.0, 0.0), (3 * cells, cells, 1))
    boxes.add("upper", (0.0, 0.0, 0.0), (1.0, 1.0, thick), (cells, cells, 1))

    def place(name, x):
        down = (1 - x[:, 2] / thick) * wave * np.cos(8 * np.pi * x[:, 0]) * (name == "upper")
        return x - np.outer(down, [0, 0, 1])

    face = boxes.facets(UP, 0.0, "lower")
    column = face[:, 0] % (3 * cells)
    surfaces = {"bottom": boxes.facets(DOWN, -thick), "top": boxes.facets(UP, thick)}
    surfaces |= {"below": face[column < cells], "above": boxes.facets(DOWN, 0.0, "upper")}
    surfaces |= {"end": face[column >= 2 * cells]}
    return Scene(
        "films",
        boxes.mesh(surfaces, place=place),
        dict.fromkeys(("lower", "upper"), Material(1.0, 0.0)),
        (Dirichlet("bottom", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, -1e-4 - sunk)),
        (ContactPair("below", "above", direction=(0, 0, 1)),),
        (Pressure("end", pressure),) if pressure else (),
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
    boxes, bodies = Boxes(1), ["base"]
    boxes.add("base", (0.0, 0.0, -thick), (2 * wide, wide, 0.0), (2 * cells, cells, 1))
    base, pairs, loads = boxes.facets(UP, 0.0, "base"), [], []
    column, surfaces, held = base[:, 0] // cells % 2, {"bottom": boxes.facets(DOWN, -thick)}, {"bottom": 0.0}
    for half, (body, depth) in enumerate((("light", light), ("heavy", heavy))):
        if depth:
            bodies.append(body)
            boxes.add(body, (half * wide, 0.0, 0.0), ((half + 1) * wide, wide, thick), (cells, cells, 1))
            surfaces |= {f"below {body}": base[column == half], f"{body} face": boxes.facets(DOWN, 0.0, body)}
            surfaces[f"{body} top"] = boxes.facets(UP, thick, body)
            held[f"{body} top"] = -depth
            pairs.append(ContactPair(f"below {body}", f"{body} face", direction=(0, 0, 1)))
    if pressure:
        surfaces["end"] = base[base[:, 0] % (2 * cells) >= 3 * cells // 2]
        loads.append(Pressure("end", pressure))
    return Scene(
        "on a base",
        boxes.mesh(surfaces),
        dict.fromkeys(bodies, Material(1.0, 0.0)),
        tuple(Dirichlet(surface, 0.0, 0.0, z) for surface, z in held.items()),
        tuple(pairs),
        tuple(loads),
    )


def beam(closing, cells=10, poisson=0.0, tension=0.0, near=None, beside=0.0, afar=0.0, touch=0.0, thick=1.0):
    """A cantilever that a pressure bends towards a block under its tip.

    Args:
        closing: gap before the tip, relative to its deflection by the theory of slender beams, p L^4 / (8 E I) [-].
        cells: root cells along the beam.
        poisson: of both [-].
        tension: along the beam, on its end [Pa].
        near: gap beside the wall, relative to that before the tip; None: the block is under the tip alone [-].
        beside: pressure on a block that is wider, far from the tip [Pa].
        afar: how far the block comes from, turning about the wall [m].
        touch: displacement of a cube that touches another one beside the beam, in the same contact pair [m].
        thick: height of the beam; the pressure is such that it bends as far as one of height 1 does [m].
    """
    boxes, bodies, long, pressure, n = Boxes(1), ["beam", "block"], 10.0, 1e-5, cells // 10
    gap = closing * 1.5 * pressure * long**4
    low = np.array([long - 1.0 if near is None else 0.0, 0.0, -4.0 if beside else -1.0])
    high = np.array([long + 5.0, 4.0, 0.0]) if beside else np.array([long, 1.0, 0.0])
    boxes.add("beam", (0.0, 0.0, 0.0), (long, 1.0, thick), (cells, n, n))
    boxes.add("block", low, high, tuple(n * (high - low).astype(int)))
    below, above = boxes.facets(DOWN, 0.0, "beam"), boxes.facets(UP, 0.0, "block")
    column, row = np.divmod(above[:, 0] - cells * n * n, (high - low)[0].astype(int) * n)[::-1]
    row %= (high - low)[1].astype(int) * n
    surfaces = {"wall": boxes.facets(LEFT, 0.0, "beam"), "load": boxes.facets(UP, thick, "beam")}
    surfaces |= {"end": boxes.facets(RIGHT, long, "beam"), "foot": boxes.facets(DOWN, low[2], "block")}
    surfaces |= {"tip": below[below[:, 0] % cells >= cells - n] if near is None else below}
    surfaces |= {"head": above[(column < n) & (row < n)] if beside else above}
    held = [
        Dirichlet("wall", 0.0, 0.0, 0.0),
        Dirichlet("foot", 0.0, 0.0, (lambda x: afar * x[0] / long) if afar else 0.0),
    ]
    if beside:
        surfaces |= {"patch": above[(column >= 4 * n) & (row >= 2 * n)]}
    if touch:
        bodies += ["lower", "upper"]
        for name, z in zip(bodies[2:], (-1.0, 0.0)):
            boxes.add(name, (0.0, 3.0, z), (1.0, 4.0, z + 1.0), (n, n, n))
        for name, more in (("tip", boxes.facets(DOWN, 0.0, "upper")), ("head", boxes.facets(UP, 0.0, "lower"))):
            surfaces[name] = np.concatenate([surfaces[name], more])
        surfaces |= {"root": boxes.facets(DOWN, -1.0, "lower"), "top": boxes.facets(UP, 1.0, "upper")}
        held += [Dirichlet("root", 0.0, 0.0, 0.0), Dirichlet("top", 0.0, 0.0, -touch)]

    def place(name, x):
        along = x[:, 0] / long
        share = 1.0 if near is None else near + (1 - near) * along
        return x - np.outer((gap * share + afar * along) * (name == "block"), [0, 0, 1])

    loads = [Pressure("load", pressure * thick**3)]
    loads += [Traction("end", (tension, 0.0, 0.0))] if tension else []
    loads += [Pressure("patch", beside)] if beside else []
    return Scene(
        "beam",
        boxes.mesh(surfaces, place=place),
        dict.fromkeys(bodies, Material(1.0, poisson)),
        tuple(held),
        (ContactPair("tip", "head", direction=(0, 0, -1)),),
        tuple(loads),
    )


def four_supports(cells=18):
    """Half the width of a beam 9 m long and half a metre high, on four supports of 1 m, under a pressure.

    Args:
        cells: root cells along the beam, a multiple of 18.
    """
    boxes, long, thick = Boxes(1), 9.0, 0.5
    boxes.add("beam", (0.0, 0.0, 0.0), (long, 1.0, thick), (cells, 2, 1))
    below, wide = boxes.facets(DOWN, 0.0, "beam"), cells // 9
    surfaces = {"load": boxes.facets(UP, thick, "beam"), "end": boxes.facets(LEFT, 0.0)}
    surfaces |= {"side": boxes.facets(FRONT, 0.0)}
    held, pairs = [Dirichlet("end", x=0.0), SymmetryPlane("side")], []
    for place in (0.0, 2.5, 5.5, 8.0):
        name, first = f"support at {place:g}", round(place * cells / long)
        boxes.add(name, (place, 0.0, -1.0), (place + 1.0, 1.0, 0.0), (wide, 2, 2))
        under = below[(below[:, 0] % cells >= first) & (below[:, 0] % cells < first + wide)]
        surfaces |= {f"above {name}": under, f"head of {name}": boxes.facets(UP, 0.0, name)}
        surfaces |= {f"foot of {name}": boxes.facets(DOWN, -1.0, name)}
        held.append(Dirichlet(f"foot of {name}", 0.0, 0.0, 0.0))
        pairs.append(ContactPair(f"above {name}", f"head of {name}", direction=(0, 0, -1)))
    mesh = boxes.mesh(surfaces)
    materials = {body: Material(1.0 if body == "beam" else 10.0, 0.3) for body in mesh.bodies}
    return Scene("four supports", mesh, materials, tuple(held), tuple(pairs), (Pressure("load", 1e-4),))


def sinking(deeper):
    """A round body that lightly touches a block, which sinks under a pressure of 0.1 Pa beside it, a quarter of both.

    Args:
        deeper: displacement of the body beyond the 0.02228 m by which the block sinks below it without contact [m].
    """
    boxes, side = Boxes(2), 0.5
    boxes.add("block", (0.0, 0.0, -2.0), (2.0, 2.0, 0.0), (4, 4, 4))
    boxes.add("body", (0.0, 0.0, 0.0), (side, side, side), (1, 1, 1))

    def place(name, x):
        up = (name == "body") * (1 - x[:, 2] / side) * (x[:, :2] ** 2).sum(axis=1) / 2  # of radius 1 m
        return x + np.outer(up, [0, 0, 1])

    face = boxes.facets(UP, 0.0, "block")
    surfaces = {"bottom": boxes.facets(DOWN, -2.0), "top": boxes.facets(UP, side, "body")}
    surfaces |= {"below": boxes.facets(UP, 0.0, "block", within=side), "above": boxes.facets(DOWN, 0.0, "body")}
    surfaces |= {
        "load": face[face[:, 0] % 4 >= 2],
        "x = 0": boxes.facets(LEFT, 0.0),
        "y = 0": boxes.facets(FRONT, 0.0),
    }
    held = Dirichlet("bottom", 0.0, 0.0, 0.0), Dirichlet("top", z=-0.02228 - deeper)
    return Scene(
        "sinking",
        boxes.mesh(surfaces, place=place),
        dict.fromkeys(("block", "body"), PLAIN),
        (*held, SymmetryPlane("x = 0"), SymmetryPlane("y = 0")),
        (ContactPair("below", "above", direction=(0, 0, 1)),),
        (Pressure("load", 0.1),),
    )


def oblique(degrees, direction=None):
    """Two blocks that meet in a plane, its normal so many degrees from z; ends are held, the upper one is lowered."""
    boxes, slope = Boxes(1), np.tan(np.radians(degrees))
    boxes.add("base", (0.0, 0.0, -1.0), (1.0, 1.0, 0.0), (2, 2, 2))
    boxes.add("block", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2, 2, 2))

    def place(_, x):
        return x + np.outer((x[:, 0] - 0.5) * slope * (1 - np.abs(x[:, 2])), [0, 0, 1])

    surfaces = {"bottom": boxes.facets(DOWN, -1.0), "top": boxes.facets(UP, 1.0, "block")}
    surfaces |= {"ground": boxes.facets(UP, 0.0, "base"), "foot": boxes.facets(DOWN, 0.0, "block")}
    held = Dirichlet("bottom", x=0.0, y=0.0, z=0.0), Dirichlet("top", x=0.0, y=0.0, z=-0.01)
    pair = ContactPair("ground", "foot", direction=direction)
    return Scene("oblique", boxes.mesh(surfaces, place=place), {"base": PLAIN, "block": PLAIN}, held, (pair,))


def on_block(name, height, cells, order, displacement, materials=(PLAIN, PLAIN), parts=("",)):
    """A block whose lower face has a height above another block, with its top moved down.

    Args:
        name: of the upper body.
        height: function of x and y [m].
        cells: root cells along x and y, twice as many as contact pairs or more.
        order: of the root mesh.
        displacement: of the top [m].
        materials: of the lower and the upper body.
        parts: ends of the names of the contact surfaces of each contact pair, side by side along x.
    """
    boxes = Boxes(order)
    boxes.add("base", (-1.0, -1.0, -1.0), (1.0, 1.0, 0.0), (cells, cells, 2))
    boxes.add(name, (-1.0, -1.0, 0.0), (1.0, 1.0, 1.0), (cells, cells, 2))

    def place(body, x):
        return x + np.outer((1 - x[:, 2]) * height(x[:, 0], x[:, 1]) * (body == name), [0, 0, 1])

    surfaces = {"bottom": boxes.facets(DOWN, -1.0), "top": boxes.facets(UP, 1.0, name)}
    for surface, facets in (("ground", boxes.facets(UP, 0.0, "base")), ("foot", boxes.facets(DOWN, 0.0, name))):
        part = facets[:, 0] % cells * len(parts) // cells
        surfaces |= {f"{surface}{end}": facets[part == k] for k, end in enumerate(parts)}
    held = Dirichlet("bottom", x=0.0, y=0.0, z=0.0), Dirichlet("top", x=0.0, y=0.0, z=-displacement)
    contact = tuple(ContactPair(f"ground{end}", f"foot{end}", direction=(0.0, 0.0, 1.0)) for end in parts)
    mesh = boxes.mesh(surfaces, place=place)
    return Scene(name, mesh, dict(zip(("base", name), materials)), held, contact)


def ring(bodies=6, shrink=0.01):
    """Blocks in a closed ring, each in contact with the next one, their outer faces moved inwards.

    Args:
        bodies: number of blocks.
        shrink: radial displacement of the outer faces [m].
    """
    boxes, surfaces, conditions = Boxes(2), {}, []
    for k in range(bodies):
        boxes.add(f"block {k}", (k, 0.0, 0.0), (k + 1.0, 1.0, 1.0), (2, 2, 1))
    for k in range(bodies):
        name = f"block {k}"
        surfaces |= {f"left {k}": boxes.facets(LEFT, k, name), f"right {k}": boxes.facets(RIGHT, k + 1.0, name)}
        surfaces |= {f"outer {k}": boxes.facets(BACK, 1.0, name), f"z = 0 {k}": boxes.facets(DOWN, 0.0, name)}
        inwards = [lambda x, axis=axis: -shrink * x[axis] / np.hypot(x[0], x[1]) for axis in (0, 1)]
        conditions += [Dirichlet(f"outer {k}", *inwards, 0.0), SymmetryPlane(f"z = 0 {k}")]

    def place(name, x):
        angle, radius = -2 * np.pi / bodies * x[:, 0], 1 + x[:, 1]
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), x[:, 2]], axis=1)

    pairs = tuple(ContactPair(f"right {k}", f"left {(k + 1) % bodies}") for k in range(bodies))
    materials = {f"block {k}": PLAIN for k in range(bodies)}
    return Scene("ring", boxes.mesh(surfaces, place=place), materials, tuple(conditions), pairs)


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


def about(axis, degrees):
    """Rotation matrix about an axis (Rodrigues)."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
