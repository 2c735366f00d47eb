"""Two half-spheres pressed together: Hertz's problem on finite bodies."""

from collections.abc import Mapping, Sequence

import numpy as np
from mpi4py import MPI

from fx_contact.geometry.gmsh_mesh import root_mesh_from_gmsh
from fx_contact.geometry.hexahedron import CORNERS, FACE_CORNERS
from fx_contact.geometry.root_mesh import RootMesh
from fx_contact.items.boundary_conditions import Dirichlet
from fx_contact.items.contact import ContactPair
from fx_contact.items.materials import Material
from fx_contact.parallel.agreement import check_alike
from fx_contact.parallel.arrays import IntArray
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.mpi import together
from fx_contact.parallel.validation import check_comm
from fx_contact.scene.scene import Scene
from fx_contact.scenes.arguments import check_arguments
from fx_contact.scenes.round_bodies import check_roundness
from fx_contact.scenes.symmetry import sideways


@collective("comm")
def hertz(
    radius: float = 1.0,
    displacement: float = 0.01,
    material: Material = Material(young=1.0, poisson=0.3),
    order: int = 3,
    coarse: int = 4,
    symmetry: str = "quarter",
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> Scene:
    """Two equal half-spheres pressed together, pole to pole, by the displacement of their flat faces, half on each.

    Collective on comm.  The flat faces are free laterally; the gap is measured along z.

    Args:
        radius: of both spheres [m].
        displacement: approach of the flat faces [m].
        material: of both.
        order: of the root mesh, 1 to 6.
        coarse: root cells along the side of a block of the half-ball.
        symmetry: "quarter" models x, y >= 0, "full" the whole half-spheres.

    Raises:
        SceneError, GeometryError: an argument out of range or different between ranks, or a root mesh too coarse for so
            small a displacement.
    """
    check_comm(comm)
    with together(comm):
        check_arguments(order, coarse, {"radius": radius}, {"displacement": displacement}, symmetry)
    asked = {"radius": radius, "displacement": displacement, "order": order, "coarse": coarse, "symmetry": symmetry}
    check_alike(comm, asked)
    mesh = root_mesh_from_gmsh(comm, lambda: _half_balls(float(radius), order, coarse, symmetry))
    with together(comm):
        return _scene(mesh, radius, displacement, material, symmetry)


def _scene(mesh: RootMesh, radius: float, displacement: float, material: Material, symmetry: str) -> Scene:
    if displacement > 0:  # Hertz: a^2 = R* delta; half of the approach for each sphere
        contact_radius = np.sqrt(radius / 2 * displacement)
        check_roundness(mesh, "upper pole", (0.0, 0.0, radius), radius, contact_radius, displacement / 2)
    half = displacement / 2
    flat_faces = Dirichlet("top", z=-half), Dirichlet("bottom", z=half)
    return Scene(
        name="hertz",
        mesh=mesh,
        materials={"lower": material, "upper": material},
        dirichlet=(*flat_faces, *sideways(symmetry, ("lower", "upper"), "radius")),
        contact=(ContactPair("lower pole", "upper pole", direction=(0.0, 0.0, 1.0)),),
        symmetry=4 if symmetry == "quarter" else 1,
        contact_centre=(0.0, 0.0, 0.0),
    )


#: A position in space [m].
_Point = Sequence[float]
#: Distances of the inner cube's corners on an axis, a diagonal and a space diagonal, relative to the radius.
_ON_AXIS, _ON_DIAGONAL, _ON_SPACE_DIAGONAL = 0.5, 0.55, 0.6
#: Radius of the model in Gmsh, which places inner nodes of curved faces with an absolute tolerance: 5e-4 off symmetry
#: for a radius of 1, 1e-12 for this one.
_MODEL_RADIUS = 1e-5


def _half_balls(true_radius: float, order: int, coarse: int, symmetry: str) -> None:
    """Gmsh model of two half-balls that touch at the origin, with flat faces at z = -radius and +radius."""
    import gmsh

    radius = _MODEL_RADIUS
    gmsh.clear()
    gmsh.model.add("hertz")
    surfaces: dict[str, list[int]] = {}
    for body, flat, sign in (("lower", "bottom", -1), ("upper", "top", 1)):
        blocks = _Blocks(coarse)
        for turn in range(1 if symmetry == "quarter" else 4):
            _ball_octant(blocks, radius, turn, sign)
        gmsh.model.geo.synchronize()
        gmsh.model.addPhysicalGroup(3, blocks.volumes, name=body)
        for name, tags in blocks.named.items():
            surfaces.setdefault({"pole": f"{body} pole", "flat": flat}.get(name, name), []).extend(tags)
        if symmetry == "full":
            along_z = [(0.0, 0.0, sign * radius * w) for w in (1.0, 1.0 - _ON_AXIS, 0.0)]
            along_x = [(radius * x, 0.0, sign * radius) for x in (0.0, _ON_AXIS, 1.0)]
            for name, places in (("axis", along_z), ("radius", along_x)):
                lines = [blocks.line(a, b) for a, b in zip(places, places[1:])]
                gmsh.model.addPhysicalGroup(1, lines, name=f"{body} {name}")
    for name, tags in surfaces.items():
        if symmetry == "quarter" or "=" not in name:
            gmsh.model.addPhysicalGroup(2, tags, name=name)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(order)
    scale = true_radius / radius
    gmsh.model.mesh.affineTransform([scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, 0])


def _ball_octant(blocks: "_Blocks", radius: float, turn: int, sign: int) -> None:
    """Four blocks of a ball: an inner cube and one block towards each axis, turned about z; the pole at the origin."""
    cosine, sine = round(np.cos(turn * np.pi / 2)), round(np.sin(turn * np.pi / 2))

    def corner(bits: IntArray, distance: float) -> _Point:
        """Point in the direction `bits` from the centre of the ball, at a distance relative to its radius."""
        x, y, w = distance * radius * bits / np.linalg.norm(bits) if bits.any() else bits * 1.0
        return (cosine * x - sine * y, sine * x + cosine * y, sign * (radius - w))

    cube = [corner(bits, {0: 0, 1: _ON_AXIS, 2: _ON_DIAGONAL, 3: _ON_SPACE_DIAGONAL}[bits.sum()]) for bits in CORNERS]
    ball = [corner(bits, 1.0) for bits in CORNERS]
    centre = (0.0, 0.0, sign * radius)
    walls = {"x = 0": 0, "y = 0": 1, "flat": 2}
    blocks.add(cube, {name: [v for v in range(8) if not CORNERS[v, axis]] for name, axis in walls.items()})
    for axis in range(3):
        inner = [v for v in range(8) if CORNERS[v, axis]]
        sides = {name: wall for name, wall in walls.items() if wall != axis}
        named = {name: [i for i in range(8) if not CORNERS[inner[i % 4], wall]] for name, wall in sides.items()}
        if axis == 2:
            named["pole"] = [4, 5, 6, 7]
        blocks.add([cube[v] for v in inner] + [ball[v] for v in inner], named, sphere=centre)


class _Blocks:
    """Transfinite hexahedral blocks of Gmsh's built-in kernel that share points, edges and faces; by Gmsh's tags."""

    def __init__(self, cells: int) -> None:
        import gmsh

        self._geo, self._cells = gmsh.model.geo, cells
        self._points: dict[tuple[float, ...], int] = {}
        self._lines: dict[frozenset[int], int] = {}
        self._faces: dict[frozenset[int], int] = {}
        self.volumes: list[int] = []
        self.named: dict[str, list[int]] = {}

    def point(self, position: _Point) -> int:
        """Gmsh tag of the point at a position."""
        key = tuple(round(float(x) / _MODEL_RADIUS, 9) + 0.0 for x in position)
        if key not in self._points:
            self._points[key] = self._geo.addPoint(*position)
        return self._points[key]

    def line(self, start: _Point, end: _Point) -> int:
        """Gmsh tag of the edge of a block between two positions."""
        return self._lines[frozenset((self.point(start), self.point(end)))]

    def add(self, corners: Sequence[_Point], named: Mapping[str, list[int]], sphere: _Point | None = None) -> None:
        """Add a block, by eight corners in tensor order, with names of faces, by their four local corners.

        The last four corners lie on a sphere, if its centre is given.
        """
        tags = [self.point(corner) for corner in corners]
        centre, outer = (None, []) if sphere is None else (self.point(sphere), tags[4:])
        faces = {}
        for local in FACE_CORNERS:
            loop = [tags[v] for v in local[[0, 1, 3, 2]]]
            faces[frozenset(local.tolist())] = self._face(loop, outer, centre)
        volume = self._geo.addVolume([self._geo.addSurfaceLoop(list(faces.values()))])
        order = [tags[v] for v in (0, 1, 3, 2, 4, 5, 7, 6)]
        self._geo.mesh.setTransfiniteVolume(volume, order)
        self._geo.mesh.setRecombine(3, volume)
        self.volumes.append(volume)
        for name, local in named.items():
            self.named.setdefault(name, []).append(faces[frozenset(local)])

    def _face(self, loop: list[int], outer: list[int], centre: int | None) -> int:
        key = frozenset(loop)
        if key not in self._faces:
            ends = zip(loop, loop[1:] + loop[:1])
            lines = [self._line(a, b, centre if {a, b} <= set(outer) else None) for a, b in ends]
            wire = self._geo.addCurveLoop(lines, reorient=True)
            surface = self._geo.addSurfaceFilling([wire], sphereCenterTag=centre if key == set(outer) else -1)
            self._geo.mesh.setTransfiniteSurface(surface, cornerTags=loop)
            self._geo.mesh.setRecombine(2, surface)
            self._faces[key] = surface
        return self._faces[key]

    def _line(self, start: int, end: int, centre: int | None) -> int:
        key = frozenset((start, end))
        if key not in self._lines:
            line = self._geo.addLine(start, end) if centre is None else self._geo.addCircleArc(start, centre, end)
            self._geo.mesh.setTransfiniteCurve(line, self._cells + 1)
            self._lines[key] = line
        return self._lines[key]
