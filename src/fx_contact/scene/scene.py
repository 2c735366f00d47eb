"""Contact problem: materials, conditions, loads and contacts on a root mesh; frozen and validated.  All is local."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from textwrap import indent
from typing import Any

import numpy as np

from fx_contact.geometry import hexahedron
from fx_contact.geometry.root_mesh import RootMesh, summary
from fx_contact.items.boundary_conditions import (
    BodyForce,
    Dirichlet,
    ObliquePlane,
    Pressure,
    SymmetryPlane,
    Traction,
    merged,
)
from fx_contact.items.contact import Contact, ContactPair
from fx_contact.items.elastic_support import Elastic
from fx_contact.items.materials import Material, Orthotropic
from fx_contact.items.rigid_loads import RigidLoad
from fx_contact.items.rigid_motions import RigidMotions
from fx_contact.items.stress_free_strains import InitialStrain, ThermalStrain
from fx_contact.items.ties import Preload, Tie
from fx_contact.items.units import Units, check_names_of_units
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import (
    as_tuple,
    check_count,
    check_label,
    check_name,
    check_vector,
    nearest,
    shown,
)
from fx_contact.scene.mirrors import Mirrors, mirrors_of
from fx_contact.scene.rigid_faces import RigidFace, rigid_face
from fx_contact.scene.scene_validation import (
    check_constrained,
    check_loads,
    check_mirrored,
    check_obstacles,
    check_springs,
    check_strains,
    check_ties,
    check_units,
    held_share,
    held_stiffness,
)
from fx_contact.surfaces.contact_surfaces import ContactSurfaces
from fx_contact.surfaces.facet_pairing import Pairing
from fx_contact.surfaces.nonmatching import NonmatchingSurfaces, oriented


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """A contact problem.

    Attributes:
        name: for records and file names.
        materials: by the names of the mesh's `regions`: bodies, and parts of bodies.
        dirichlet: prescribed displacements and symmetry planes.
        contact: a facet is in at most one of them.
        tractions: those on one surface add up.
        symmetry: number of symmetric parts that planes without normal displacement make by reflection, one of which
            is modelled (4 for a quarter model).  Total forces in the
            records are those of all parts, vectors only if symmetry planes define the other parts (`mirrors`).
        contact_centre: point on the axis of `contact_radius`, reference point of moments [m], moved onto the symmetry
            planes; None: the centroid of the contact forces.
        body_forces: those on one body, or part of it, add up.
        ties: glued surfaces; a facet is in at most one contact or tie.
        strains: stress-free strains; those on one body, or part of it, add up.
        springs: elastic supports; those on one surface add up.
        rigid_loads: forces and moments on surfaces that stay rigid; a facet is in one of them, or in a contact or tie.
        units: names of the units of length and stress, ("mm", "MPa"), for axes, legends and reports alone; None: none
            are shown.

    One item may be given for a tuple.

    Raises:
        SceneError: an unknown body or place; a body or part without material; an unconstrained body; a prescribed
            displacement that is not finite, across a symmetry plane, or different from another one at a node; a load
            that is not finite; a load or springs on prescribed displacements alone; a symmetry plane that is not plane,
            cuts a body, or has facets of a contact; a number of parts that planes of symmetry do not make; two contacts
            of one name; an obstacle with most of a body inside it, behind the surface, or farther away than all bodies
            are large; a force that pulls an obstacle away, or across a symmetry plane; tied surfaces that lie apart; a
            preloaded section that is not plane across its axis; materials and constant strains that mirrors change.
    """

    name: str
    mesh: RootMesh
    materials: Mapping[str, Material | Orthotropic]
    dirichlet: tuple[Dirichlet | SymmetryPlane, ...] = ()
    contact: tuple[Contact, ...] = ()
    tractions: tuple[Traction | Pressure, ...] = ()
    symmetry: int = 1
    contact_centre: tuple[float, float, float] | None = None
    body_forces: tuple[BodyForce, ...] = ()
    ties: tuple[Tie, ...] = ()
    strains: tuple[ThermalStrain | InitialStrain, ...] = ()
    springs: tuple[Elastic, ...] = ()
    units: Units = None
    rigid_loads: tuple[RigidLoad, ...] = ()

    def __post_init__(self) -> None:
        mesh = self.mesh
        check_label("the name of a scene", self.name)
        check_names_of_units(self.units)
        if not isinstance(mesh, RootMesh):
            raise SceneError(f"the mesh of a scene must be a RootMesh, got {shown(mesh)}")
        for name, kinds in _ITEMS.items():
            object.__setattr__(self, name, as_tuple(name, getattr(self, name), *kinds))
        check_count("symmetry, the number of copies,", self.symmetry)
        if self.contact_centre is not None:
            check_vector("contact_centre", self.contact_centre)
        materials = self.materials if isinstance(self.materials, Mapping) else {}
        if {*materials} != {*mesh.regions} or not all(
            isinstance(m, (Material, Orthotropic)) for m in materials.values()
        ):
            meant = "".join(nearest(name, mesh.regions) for name in materials if name not in mesh.regions)
            raise SceneError(
                f"materials must be a dict with a Material for each of {mesh.regions}, got {shown(self.materials)}"
                f"{meant}"
            )
        for on_surface in (*self.tractions, *self.springs):
            mesh.surface(on_surface.surface)
        for force in self.body_forces:
            mesh.cells_of(force.body)
        for strain in self.strains:
            mesh.cells_of(strain.part)
        check_units(self)
        check_springs(self)
        check_loads(self)
        check_strains(self)
        check_obstacles(self)
        check_ties(self)
        check_constrained(self)
        check_mirrored(self)
        names = [interface.name for interface in self.interfaces]
        for name in names:
            if names.count(name) > 1:
                raise SceneError(f"two contacts have the name {name!r}: rename a surface")

    def __repr__(self) -> str:
        parts = "" if self.symmetry == 1 else f", modelled as one of {self.symmetry} symmetric parts"
        if self.symmetry == 1 and any(isinstance(condition, SymmetryPlane) for condition in self.dirichlet):
            parts = ", symmetry=1: forces are those of the modelled part"
        materials = ((region, self.materials[region]) for region in self.mesh.regions)
        lists = {
            "materials": [f"{region!r} {material.text}" for region, material in materials],
            "contact": [self._described(index) for index in range(len(self.contact))],
            "ties": [self._described(len(self.contact) + index) for index in range(len(self.ties))],
            "rigid loads": [repr(load.surface) for load in self.rigid_loads],
            "displacements": [f"{c.where!r} ({c.components})" for c in self.conditions],
            "elastic supports": [repr(support.surface) for support in self.springs],
            "surface forces": [repr(force.surface) for force in self.tractions],
            "body forces": [repr(force.body) for force in self.body_forces],
            "stress-free strains": [repr(strain.part) for strain in self.strains],
        }
        return summary(f"scene {self.name!r}{parts}\n{indent(repr(self.mesh), '  ')}", lists)

    def _described(self, index: int) -> str:
        """A contact for `repr`, with the surface that has the rows where meshes do not match."""
        label, reason = self.interfaces[index].label, self.pairing.nonmatching.get(index)
        if reason is None:
            return label
        return f"{label} (meshes do not match: {reason}; rows on {self.oriented[index].surfaces[0]!r})"

    @cached_property
    def conditions(self) -> tuple[Dirichlet | ObliquePlane, ...]:
        """`dirichlet`, with each symmetry plane as a condition on the displacement."""
        return tuple(c.on(self.mesh) if isinstance(c, SymmetryPlane) else c for c in self.dirichlet)

    @cached_property
    def oblique_planes(self) -> tuple[ObliquePlane, ...]:
        """Oblique planes among the `conditions`."""
        return tuple(c for c in self.conditions if isinstance(c, ObliquePlane))

    @cached_property
    def layers(self) -> Int64Array:
        """(ncells,), number of each root cell's layer, one material with one stress-free strain, in its body."""
        mesh, known = self.mesh, [dict[Any, int]() for _ in self.mesh.bodies]
        strained = [np.isin(np.arange(len(mesh.cells)), mesh.cells_of(strain.part)) for strain in self.strains]
        acts = np.array(strained, dtype=bool).reshape(-1, len(mesh.cells))
        layers = np.empty(len(mesh.regions), dtype=np.int64)
        for index, (body, name) in enumerate(zip(mesh.body_of_region, mesh.regions)):
            one = self.materials[name], acts[:, mesh.region == index][:, :1].tobytes()
            layers[index] = known[body].setdefault(one, len(known[body]))
        return layers[mesh.region]

    @cached_property
    def held_shares(self) -> tuple[float, ...]:
        """Share of each surface force, then of springs, on displacements that conditions on its surface prescribe."""
        of_springs = (held_stiffness(self, support) for support in self.springs)
        return *(held_share(self, load) for load in self.tractions), *of_springs

    @cached_property
    def zero_loads(self) -> tuple[tuple[str, str], ...]:
        """Descriptions and places of the loads and stress-free strains that are zero at all sampling points."""
        places = [load.surface for load in self.tractions]
        places += [force.body for force in self.body_forces] + [strain.part for strain in self.strains]
        loads = zip((*self.tractions, *self.body_forces, *self.strains), places)
        return tuple(
            (load.what, place)
            for load, place in loads
            if not np.any(load.value(self.samples(place).T) if callable(load.value) else load.value)
        )

    @cached_property
    def mirrors(self) -> Mirrors:
        """Symmetry group of the scene."""
        return mirrors_of(self)

    @property
    def interfaces(self) -> tuple[Contact, ...]:
        """`contact`, then `ties`, then `rigid_faces`: all have surfaces, rows and an index among all."""
        return (*self.contact, *self.ties, *self.rigid_faces)

    @property
    def joins(self) -> int:
        """Number of contacts and ties, the first of the `interfaces`."""
        return len(self.contact) + len(self.ties)

    @cached_property
    def rigid_faces(self) -> tuple[RigidFace, ...]:
        """Surfaces of `rigid_loads`, with the motions that conditions allow."""
        return tuple(rigid_face(self, load) for load in self.rigid_loads)

    @cached_property
    def nonmatching(self) -> dict[int, NonmatchingSurfaces]:
        """Surfaces whose meshes do not match, by index among `interfaces`; first the one with the rows."""
        moduli = np.array([self.materials[region].plane_strain_modulus for region in self.mesh.regions])
        pairs = {index: self.interfaces[index] for index in self.pairing.nonmatching}
        return {
            i: oriented(self.mesh, pair, moduli) for i, pair in pairs.items() if isinstance(pair, (ContactPair, Tie))
        }

    @property
    def oriented(self) -> tuple[Contact, ...]:
        """`interfaces` with the surface first that has the rows, the program's choice where meshes do not match."""
        turned = {i for i, one in self.nonmatching.items() if one.contact.surfaces != self.interfaces[i].surfaces}
        return tuple(
            pair.reversed() if index in turned and isinstance(pair, (ContactPair, Tie)) else pair
            for index, pair in enumerate(self.interfaces)
        )

    @cached_property
    def contact_surfaces(self) -> ContactSurfaces:
        """Root facets on contact and tied surfaces."""
        return ContactSurfaces(self.mesh, self.oriented, self.nonmatching)

    @cached_property
    def pairing(self) -> Pairing:
        """Root facets that face each other."""
        return Pairing(self.mesh, self.interfaces)

    @cached_property
    def rigid_motions(self) -> RigidMotions:
        """Rigid motions of the bodies, and the conditions on them."""
        planes = [(self.place(plane.where), np.array(plane.normal)) for plane in self.oblique_planes]
        springs = [support.resistance(self.mesh) for support in self.springs]
        return RigidMotions(self.mesh, self.prescribed(self.mesh.points), planes, springs)

    def place(self, name: str) -> Int64Array:
        """Corner nodes (n,) of a surface, curve or vertex of the root mesh.  Raises SceneError for an unknown name."""
        mesh = self.mesh
        known = [*mesh.surfaces, *mesh.curves, *mesh.vertices]
        check_name("surface, curve or vertex", name, known, "the root mesh has")
        for groups, corners in ((mesh.surfaces, hexahedron.FACE_CORNERS), (mesh.curves, hexahedron.EDGE_CORNERS)):
            if name in groups:
                cell, entity = groups[name].T
                return np.unique(mesh.corners[cell[:, None], corners[entity]])
        return mesh.vertices[name]

    @property
    def data(self) -> tuple[Any, ...]:
        """Values of all conditions and loads: numbers, triples, or functions of position.  Local."""
        conditions = (value for c in self.conditions if isinstance(c, Dirichlet) for value in (c.x, c.y, c.z))
        loads = (load.value for load in (*self.tractions, *self.body_forces, *self.strains))
        motions = (interface.motion for interface in self.interfaces)
        forces = (value for motion in motions if motion is not None for value in motion.loads)
        closings = (tie.closing for tie in self.ties if isinstance(tie, Preload))
        return tuple(value for value in (*conditions, *loads, *forces, *closings) if value is not None)

    def approached(self, distances: Mapping[str, float]) -> "Scene":
        """The scene with obstacles moved along the forces on them [m], by the names of their pairs.  Local."""
        other = copy(self)  # with what is known of surfaces and bodies, which do not move
        moved = (pair.approached(distances[pair.name]) if pair.name in distances else pair for pair in self.contact)
        object.__setattr__(other, "contact", tuple(moved))
        return other

    def samples(self, name: str) -> FloatArray:
        """Sampling points (n, 3) [m] of a surface, curve, vertex or body, for functions of position."""
        mesh = self.mesh
        if name in mesh.surfaces:
            return mesh.facet_points(mesh.surfaces[name], _SAMPLES).reshape(-1, 3)
        if name in mesh.curves:
            cells, edges = mesh.curves[name].T
            nodes = hexahedron.edge_nodes(_SAMPLES)[edges]
        elif name in (*mesh.bodies, *mesh.parts):
            cells = mesh.cells_of(name)
            nodes = np.arange((_SAMPLES + 1) ** 3)[None]
        else:
            return mesh.points[self.place(name)]
        points = mesh.evaluate(cells, np.tile(np.linspace(0, 1, _SAMPLES + 1), (len(cells), 3, 1)))
        return np.take_along_axis(points, nodes[:, :, None], axis=1).reshape(-1, 3)

    def contact_directions(self, facets: IntArray) -> FloatArray:
        """Unit vectors (n, 3) [-] from facets (n, 2) of first surfaces: the given direction or the mean normal."""
        result = self.mesh.outward_normals(facets)
        of = self.contact_surfaces.contact[facets[:, 0], facets[:, 1]]
        for index, contact in enumerate(self.oriented):
            if contact.unit_direction is not None:
                result[of == index] = contact.unit_direction
        return result

    def prescribed(self, points: FloatArray) -> FloatArray:
        """Prescribed displacements (npoints, 3) [m] of the root mesh's nodes at `points` (npoints, 3), NaN where free.

        Raises SceneError for an unknown place, two values of a component at a node, or one across a symmetry plane.
        """
        conditions = [condition for condition in self.conditions if isinstance(condition, Dirichlet)]
        places = [self.place(condition.where) for condition in conditions]
        given = [condition.at(points[nodes]) for condition, nodes in zip(conditions, places)]
        largest = max((np.nanmax(np.abs(values), initial=0.0) for values in given), default=0.0)
        result = np.full((len(points), 3), np.nan)
        for condition, nodes, values in zip(conditions, places, given):
            result[nodes] = merged(result[nodes], condition, values, _SAME * largest, points[nodes].__getitem__)
        for plane in self.oblique_planes:
            nodes = self.place(plane.where)
            plane.check(result[nodes], largest, points[nodes].__getitem__)
        return result


#: Classes of the items of a scene.
_ITEMS = {
    "dirichlet": (Dirichlet, SymmetryPlane),
    "contact": (Contact,),
    "tractions": (Traction, Pressure),
    "body_forces": (BodyForce,),
    "ties": (Tie,),
    "strains": (ThermalStrain, InitialStrain),
    "rigid_loads": (RigidLoad,),
    "springs": (Elastic,),
}
#: Order of the lattice of sampling points in a root cell.
_SAMPLES = 5
#: Largest difference of two conditions on one component, relative to the largest prescribed displacement.
_SAME = 1e-12


def check_scene(scene: object) -> None:
    """Raises SceneError unless a value is a Scene."""
    if not isinstance(scene, Scene):
        raise SceneError(f"the scene must be a Scene, got {shown(scene)}")
