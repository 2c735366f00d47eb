"""Items of a scene on its root mesh, and what follows from them: surfaces, mirrors, rigid motions.  All is local."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np

from fx_contact.geometry.rigid_motions import RigidMotions
from fx_contact.geometry.root_mesh import RootMesh
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
from fx_contact.items.stress_free_strains import InitialStrain, ThermalStrain
from fx_contact.items.ties import Preload, Tie
from fx_contact.items.units import Units
from fx_contact.parallel.arrays import FloatArray, Int64Array, IntArray
from fx_contact.scene.held_loads import held_share, held_stiffness
from fx_contact.scene.mirrors import Mirrors, PlaneSurface, mirrors_of, symmetry_planes
from fx_contact.scene.rigid_faces import RigidFace, rigid_face
from fx_contact.surfaces.contact_surfaces import ContactSurfaces, preceding
from fx_contact.surfaces.facet_pairing import Pairing
from fx_contact.surfaces.nonmatching import NonmatchingSurfaces, oriented

#: Largest difference of two conditions on one component, relative to the largest prescribed displacement.
_SAME = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class SceneItems:
    """A root mesh and the items on it, which `Scene` describes and checks."""

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
        of_springs = (held_stiffness(self.mesh, self.conditions, support) for support in self.springs)
        return *(held_share(self.mesh, self.conditions, load) for load in self.tractions), *of_springs

    @cached_property
    def mirrors(self) -> Mirrors:
        """Symmetry group of the scene."""
        return mirrors_of(self.mesh, self.dirichlet, self.symmetry)

    @property
    def symmetry_planes(self) -> list[PlaneSurface]:
        """Surfaces on symmetry planes."""
        return symmetry_planes(self.mesh, self.dirichlet, self.symmetry)

    @property
    def interfaces(self) -> tuple[Contact, ...]:
        """`contact`, with the same indices, then `ties`, then `rigid_faces`: all have surfaces and rows."""
        return (*self.contact, *self.ties, *self.rigid_faces)

    @cached_property
    def rigid_faces(self) -> tuple[RigidFace, ...]:
        """Surfaces of `rigid_loads`, with the motions that conditions allow."""
        joined = [name for contact in (*self.contact, *self.ties) for name in contact.surfaces]
        prescribed, faces = self.prescribed(self.mesh.points), []
        for load in self.rigid_loads:
            others = joined + [other.surface for other in self.rigid_loads if other is not load]
            faces.append(rigid_face(self.mesh, load, others, prescribed, self.symmetry_planes))
        return tuple(faces)

    @cached_property
    def nonmatching(self) -> dict[int, NonmatchingSurfaces]:
        """Surfaces whose meshes do not match, by index among `interfaces`; first the one with the rows."""
        moduli = np.array([self.materials[region].plane_strain_modulus for region in self.mesh.regions])
        pairs = {index: one for index, one in enumerate(self.interfaces) if isinstance(one, ContactPair | Tie)}
        result = {index: oriented(self.mesh, pairs[index], moduli) for index in self.pairing.nonmatching}
        for index, surfaces in result.items():
            surfaces.before = tuple(result[other] for other in preceding(self.interfaces, index) if other in result)
        return result

    @property
    def oriented(self) -> tuple[Contact, ...]:
        """`interfaces` with the surface first that has the rows, the program's choice where meshes do not match."""
        chosen = {index: surfaces.contact for index, surfaces in self.nonmatching.items()}
        return tuple(chosen.get(index, one) for index, one in enumerate(self.interfaces))

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
        planes = [(self.mesh.nodes_of(plane.where), np.array(plane.normal)) for plane in self.oblique_planes]
        springs = [support.resistance(self.mesh) for support in self.springs]
        return RigidMotions(self.mesh, self.prescribed(self.mesh.points), planes, springs)

    @property
    def data(self) -> tuple[Any, ...]:
        """Values of all conditions and loads: numbers, triples, or functions of position.  Local."""
        conditions = (value for c in self.conditions if isinstance(c, Dirichlet) for value in (c.x, c.y, c.z))
        loads = (load.value for load in (*self.tractions, *self.body_forces, *self.strains))
        forces = (value for one in self.interfaces if one.motion is not None for value in one.motion.loads)
        closings = (tie.closing for tie in self.ties if isinstance(tie, Preload))
        return tuple(value for value in (*conditions, *loads, *forces, *closings) if value is not None)

    def approached(self, distances: Mapping[str, float]) -> Self:
        """The scene with obstacles moved along the forces on them [m], by the names of their pairs.  Local."""
        other = copy(self)  # with what is known of surfaces and bodies, which do not move
        moved = (pair.approached(distances[pair.name]) if pair.name in distances else pair for pair in self.contact)
        object.__setattr__(other, "contact", tuple(moved))
        return other

    def contact_directions(self, index: int, facets: IntArray) -> FloatArray:
        """Unit vectors (n, 3) [-] from facets (n, 2) of an interface: the given direction or the mean normals."""
        normals, direction = self.mesh.outward_normals(facets), self.oriented[index].unit_direction
        return normals if direction is None else np.broadcast_to(direction, normals.shape)

    def prescribed(self, points: FloatArray) -> FloatArray:
        """Prescribed displacements (npoints, 3) [m] of the root mesh's nodes at `points` (npoints, 3), NaN where free.

        Raises SceneError for an unknown place, two values of a component at a node, or one across a symmetry plane.
        """
        conditions = [condition for condition in self.conditions if isinstance(condition, Dirichlet)]
        places = [self.mesh.nodes_of(condition.where) for condition in conditions]
        given = [condition.at(points[nodes]) for condition, nodes in zip(conditions, places)]
        largest = max((np.nanmax(np.abs(values), initial=0.0) for values in given), default=0.0)
        result = np.full((len(points), 3), np.nan)
        for condition, nodes, values in zip(conditions, places, given):
            result[nodes] = merged(result[nodes], condition, values, _SAME * largest, points[nodes].__getitem__)
        for plane in self.oblique_planes:
            nodes = self.mesh.nodes_of(plane.where)
            plane.check(result[nodes], largest, points[nodes].__getitem__)
        return result
