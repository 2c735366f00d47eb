"""Contact problem: materials, conditions, loads and contacts on a root mesh; frozen and validated.  All is local."""

from collections.abc import Mapping
from dataclasses import dataclass
from textwrap import indent

from fx_contact.geometry.root_mesh import RootMesh, summary
from fx_contact.items.boundary_conditions import BodyForce, Dirichlet, Pressure, SymmetryPlane, Traction
from fx_contact.items.contact import Contact
from fx_contact.items.elastic_support import Elastic
from fx_contact.items.materials import Material, Orthotropic
from fx_contact.items.rigid_loads import RigidLoad
from fx_contact.items.stress_free_strains import InitialStrain, ThermalStrain
from fx_contact.items.ties import Tie
from fx_contact.items.units import check_names_of_units
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import as_tuple, check_count, check_label, check_vector, nearest, shown
from fx_contact.scene.scene_items import SceneItems
from fx_contact.scene.scene_validation import (
    check_loads,
    check_mirrored,
    check_obstacles,
    check_springs,
    check_strains,
    check_ties,
    check_units,
)


@dataclass(frozen=True, eq=False, repr=False)
class Scene(SceneItems):
    """A contact problem.

    Attributes:
        name: for records and file names.
        materials: by the names of the mesh's `regions`: bodies, and parts of bodies.
        dirichlet: prescribed displacements and symmetry planes.
        contact: a facet is in at most one of them.
        tractions: those on one surface add up; equal ones are an error, as of the other loads.
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
            that is not finite, or equal to another one; a load or springs on prescribed displacements alone; a symmetry
            plane that is not plane, cuts a body, or has facets of a contact; a number of parts that planes of symmetry
            do not make; two contacts of one name; an obstacle with most of a body inside it, behind the surface, or
            farther away than all bodies are large; a force that pulls an obstacle away, or across a symmetry plane;
            tied surfaces that lie apart; a preloaded section that is not plane across its axis; materials and constant
            strains that mirrors change.
    """

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
        are_materials = all(isinstance(material, Material | Orthotropic) for material in materials.values())
        if {*materials} != {*mesh.regions} or not are_materials:
            meant = "".join(nearest(name, mesh.regions) for name in materials if name not in mesh.regions)
            raise SceneError(
                f"materials must be a dict with a Material for each of {mesh.regions}, got {shown(self.materials)}"
                f"{meant}"
            )
        for on_surface in (*self.tractions, *self.springs):
            mesh.surface(on_surface.surface)
        for in_part in (*self.body_forces, *self.strains):
            mesh.cells_of(in_part.place)
        check_units(self)
        check_springs(self)
        check_loads(self)
        check_strains(self)
        check_obstacles(self)
        check_ties(self)
        check_mirrored(self)
        _ = self.contact_surfaces, self.pairing, self.rigid_motions  # their errors belong here
        names = [interface.name for interface in self.interfaces]
        for name in names:
            if names.count(name) > 1:
                raise SceneError(
                    f"two contacts have the name {name!r}: name a surface anew, as by `named` of its shape"
                )

    def __repr__(self) -> str:
        parts = "" if self.symmetry == 1 else f", modelled as one of {self.symmetry} symmetric parts"
        if self.symmetry == 1 and any(isinstance(condition, SymmetryPlane) for condition in self.dirichlet):
            parts = ", symmetry=1: forces are those of the modelled part"
        materials = ((region, self.materials[region]) for region in self.mesh.regions)
        lists = {
            "materials": [f"{region!r} {material.text}" for region, material in materials],
            "contact": [self._described(i) for i, one in enumerate(self.interfaces) if not one.EQUALITY],
            "ties": [self._described(i) for i, one in enumerate(self.interfaces) if isinstance(one, Tie)],
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


def check_scene(scene: object) -> None:
    """Raises SceneError unless a value is a Scene."""
    if not isinstance(scene, Scene):
        raise SceneError(f"the scene must be a Scene, got {shown(scene)}")
