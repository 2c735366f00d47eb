"""A contact problem: materials, conditions and contact pairs on a root mesh.  Frozen, validated when made; local."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import check_count, check_label, check_name, check_vector, shown
from fx_contact.problem import hexahedron
from fx_contact.problem.boundary_conditions import (
    BodyForce,
    Dirichlet,
    ObliquePlane,
    Pressure,
    SymmetryPlane,
    Traction,
    merged,
)
from fx_contact.problem.contact import Contact
from fx_contact.problem.contact_surfaces import ContactSurfaces
from fx_contact.problem.facet_pairing import Pairing
from fx_contact.problem.materials import Material
from fx_contact.problem.mirrors import mirrors_of
from fx_contact.problem.rigid_motions import RigidMotions
from fx_contact.problem.root_mesh import RootMesh
from fx_contact.problem.scene_validation import check_held, check_units
from fx_contact.problem.summary import scene_summary


@dataclass(frozen=True, eq=False, repr=False)
class Scene:
    """A contact problem.

    Attributes:
        name: for records and file names.
        mesh: RootMesh.
        materials: body name -> Material, one for each body.
        dirichlet: prescribed displacements (`Dirichlet`) and symmetry planes (`SymmetryPlane`).
        contact: contacts (`ContactPair`); each facet is in one of them.
        tractions: surface forces: `Traction` and `Pressure`; those on one surface add up.
        body_forces: `BodyForce`; those on one body add up.
        symmetry: how many copies of the modelled part make the whole (4 for a quarter model); total forces in the
            records are those of the whole; vectors where symmetry planes say how the copies lie (`mirrors`).
        contact_centre: a point on the axis about which `contact_radius` is measured, and about which moments are
            taken [m]; None: the centroid of the contact forces.  Of a part it is moved onto the planes of symmetry.

    Raises:
        SceneError: an unknown body, surface or vertex, a body without material, two values for one component at one
            place, a prescribed displacement that is not finite or across a symmetry plane, a symmetry plane that is not
            plane, a number of copies that the planes of symmetry cannot make, a body that nothing holds.
    """

    name: str
    mesh: RootMesh
    materials: Mapping[str, Material]
    dirichlet: tuple[Dirichlet | SymmetryPlane, ...] = ()
    contact: tuple[Contact, ...] = ()
    tractions: tuple[Traction | Pressure, ...] = ()
    symmetry: int = 1
    contact_centre: tuple[float, float, float] | None = None
    body_forces: tuple[BodyForce, ...] = ()

    def __post_init__(self):
        mesh = self.mesh
        check_label("the name of a scene", self.name)
        if not isinstance(mesh, RootMesh):
            raise SceneError(f"the mesh of a scene must be a RootMesh, got {shown(mesh)}")
        for name, kinds in _PARTS.items():
            items = getattr(self, name)
            if not isinstance(items, (tuple, list)) or not all(isinstance(item, kinds) for item in items):
                wanted = " and ".join(kind.__name__ for kind in kinds)
                raise SceneError(f"{name} must be a tuple of {wanted}, got {shown(items)}")
        check_count("symmetry, the number of copies,", self.symmetry)
        if self.contact_centre is not None:
            check_vector("contact_centre", self.contact_centre)
        materials = self.materials if isinstance(self.materials, Mapping) else {}
        if {*materials} != {*mesh.bodies} or not all(isinstance(m, Material) for m in materials.values()):
            raise SceneError(
                f"materials must be a dict with a Material for each of {mesh.bodies}, got {shown(self.materials)}"
            )
        for traction in self.tractions:
            mesh.surface(traction.surface)
        for force in self.body_forces:
            check_name("body", force.body, mesh.bodies, "the root mesh has")
        check_units(self)
        check_held(self)
        _ = self.mirrors  # whether planes can make so many copies

    def __repr__(self):
        return scene_summary(self)

    @cached_property
    def conditions(self):
        """Tuple of Dirichlet and ObliquePlane: `dirichlet`, symmetry planes among them as what they hold."""
        return tuple(c.on(self.mesh) if isinstance(c, SymmetryPlane) else c for c in self.dirichlet)

    @cached_property
    def oblique_planes(self):
        """Tuple of ObliquePlane, those among the `conditions`."""
        return tuple(c for c in self.conditions if isinstance(c, ObliquePlane))

    @cached_property
    def mirrors(self):
        """How copies of the modelled part make the whole (`Mirrors`)."""
        return mirrors_of(self)

    @cached_property
    def contact_surfaces(self) -> ContactSurfaces:
        """Root facets on contact surfaces (`ContactSurfaces`)."""
        return ContactSurfaces(self.mesh, self.contact)

    @cached_property
    def pairing(self) -> Pairing:
        """Root facets that face each other (`Pairing`)."""
        return Pairing(self.mesh, self.contact)

    @cached_property
    def rigid_motions(self):
        """Rigid motions of the bodies, and which of them conditions stop (`RigidMotions`)."""
        planes = [(self.place(plane.where), np.array(plane.normal)) for plane in self.oblique_planes]
        return RigidMotions(self.mesh, self.prescribed(self.mesh.points), planes)

    def place(self, name):
        """Corner nodes of a named surface, curve or vertex of the root mesh.

        Args:
            name: of a surface, a curve or a vertex.

        Returns:
            (n,) int64 nodes.

        Raises:
            SceneError: nothing has that name.
        """
        mesh = self.mesh
        check_name(
            "surface, curve or vertex", name, [*mesh.surfaces, *mesh.curves, *mesh.vertices], "the root mesh has"
        )
        if name in mesh.surfaces:
            cell, face = mesh.surfaces[name].T
            return np.unique(mesh.corners[cell[:, None], hexahedron.FACE_CORNERS[face]])
        if name in mesh.curves:
            cell, edge = mesh.curves[name].T
            return np.unique(mesh.corners[cell[:, None], hexahedron.EDGE_CORNERS[edge]])
        return mesh.vertices[name]

    def samples(self, name):
        """Points at which a function on a named place or body is checked: a lattice of order 5 on its root cells.

        Args:
            name: of a surface, a curve, a vertex or a body.

        Returns:
            (n, 3) float64 [m].
        """
        mesh = self.mesh
        if name in mesh.surfaces:
            return mesh.facet_points(mesh.surfaces[name], _SAMPLES).reshape(-1, 3)
        cells, along = np.flatnonzero(mesh.body == mesh.bodies.index(name)) if name in mesh.bodies else None, None
        if name in mesh.curves:
            cells, along = mesh.curves[name].T
        if cells is None:
            return mesh.points[self.place(name)]
        axes = np.tile(np.linspace(0, 1, _SAMPLES + 1), (len(cells), 3, 1))
        points = mesh.evaluate(cells, axes)
        if along is not None:
            points = np.take_along_axis(points, hexahedron.edge_nodes(_SAMPLES)[along][:, :, None], axis=1)
        return points.reshape(-1, 3)

    def contact_directions(self, facets):
        """Direction in which facets of first surfaces face others: as given, or the mean normal.

        Args:
            facets: (n, 2) int rows (root cell, local face).

        Returns:
            (n, 3) float64, unit vectors out of the first body [-].
        """
        result = self.mesh.outward_normals(facets)
        of = self.contact_surfaces.contact[facets[:, 0], facets[:, 1]]
        for index, contact in enumerate(self.contact):
            if contact.unit_direction is not None:
                result[of == index] = contact.unit_direction
        return result

    def prescribed(self, points):
        """Prescribed displacements at the nodes of the root mesh.

        Args:
            points: (npoints, 3) float64, the nodes' positions [m].

        Returns:
            (npoints, 3) float64 [m], NaN where free.

        Raises:
            SceneError: an unknown place, two values for one component at one node, or one across a symmetry plane.
        """
        conditions = [condition for condition in self.conditions if isinstance(condition, Dirichlet)]
        places = [self.place(condition.where) for condition in conditions]
        said = [condition.at(points[nodes]) for condition, nodes in zip(conditions, places)]
        largest = max((np.nanmax(np.abs(values), initial=0.0) for values in said), default=0.0)
        result = np.full((len(points), 3), np.nan)
        for condition, nodes, values in zip(conditions, places, said):
            result[nodes] = merged(result[nodes], condition, values, _SAME * largest, points[nodes].__getitem__)
        for plane in self.oblique_planes:
            nodes = self.place(plane.where)
            plane.check(result[nodes], largest, points[nodes].__getitem__)
        return result


#: What the parts of a scene may be.
_PARTS = {
    "dirichlet": (Dirichlet, SymmetryPlane),
    "contact": (Contact,),
    "tractions": (Traction, Pressure),
    "body_forces": (BodyForce,),
}
#: Order of the lattice at which functions of position are checked.
_SAMPLES = 5
#: Largest difference of two conditions on one component, relative to the largest prescribed displacement.
_SAME = 1e-12


def check_scene(scene):
    """Raises SceneError unless a value is a Scene.  Local."""
    if not isinstance(scene, Scene):
        raise SceneError(f"the scene must be a Scene, got {shown(scene)}")
