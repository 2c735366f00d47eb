"""The state after one adaptive step, with its dolfinx objects, contact and resultants."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, MeshTags, meshtags

from fx_contact.adaptive.contact_table import ContactTable
from fx_contact.adaptive.pyvista_grid import leaf_grid
from fx_contact.adaptive.step_record import StepRecord, report_text
from fx_contact.estimate.contact_goals import ContactError
from fx_contact.estimate.shear_free import find_shear_free
from fx_contact.estimate.solved_state import SolvedState
from fx_contact.estimate.stress_projection import projected_stress
from fx_contact.fem.leaf_mesh import LeafMesh
from fx_contact.fem.nodal_fields import NodalFields
from fx_contact.items.materials import TENSOR
from fx_contact.parallel.arrays import FloatArray, Int32Array
from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.meeting import collective
from fx_contact.parallel.timing import Stages
from fx_contact.parallel.validation import shown
from fx_contact.verdict.resultants import Resultant


@dataclass(frozen=True, eq=False, repr=False)
class Step(SolvedState):
    """The state after one adaptive step.

    Of dolfinx: `mesh`, `displacement`, `stress`, `facet_tags`, `cell_tags`, `ds`; of contact: `contact`.  They are made
    when first asked for, some of them collectively.

    Attributes:
        start: (owned, 3), first guess of the solve, carried from the step before [m].
        stages: of this step, from the refinement that led to it.
        fields: further fields at the nodes of the leaves, carried through refinement.
    """

    record: StepRecord
    start: FloatArray
    contact_error: ContactError
    stages: Stages
    fields: NodalFields

    def __repr__(self) -> str:
        return report_text(self.record)

    def __getattr__(self, name: str) -> Any:
        if name in StepRecord.__dataclass_fields__:
            raise AttributeError(f"a Step has no attribute {name!r}; did you mean `step.record.{name}`?", name=name)
        raise AttributeError(f"a Step has no attribute {name!r}", name=name, obj=self)

    def __del__(self) -> None:
        # Communicators of dolfinx that are freed while an error is under way hang in mpi4py (see `parallel.mpi`);
        # inside `__del__` the error is set aside.
        self.__dict__.clear()

    @property
    def carried(self) -> FloatArray:
        """The further fields of a Beginning on this mesh: (n, (p+1)^3, k).  Local."""
        return self.fields["carried"] if "carried" in self.fields else self.fields.array[..., :0]

    @property
    def leaf_mesh(self) -> LeafMesh:
        """The dolfinx mesh of the leaves, and their order in it.  Local."""
        return self.elasticity.leaf_mesh

    @property
    def resultants(self) -> tuple[Resultant, ...]:
        """Resultants of contact pairs, loads, conditions, and the balance of each body.  Local."""
        return self.record.resultants or ()

    @property
    @collective("self.forest.comm")
    def nodal_displacement(self) -> FloatArray:
        """Displacement at the nodes of this rank's leaves: (n, (p+1)^3, 3) [m].  Collective."""
        prolongation = self.elasticity.prolongation
        return prolongation.prolong(self.solution.displacement)[prolongation.space.cells]

    @property
    def mesh(self) -> Mesh:
        """The mesh; its cells are leaves, none of them a ghost.  Local.

        dolfinx takes hanging facets for exterior ones, as each has one cell: neither `ufl.ds` nor
        `exterior_facet_indices` gives the boundary of the bodies.  `ds` and `facet_tags` do.
        """
        return self.leaf_mesh.mesh

    @property
    def displacement(self) -> fem.Function:
        """The displacement, continuous across hanging facets [m].  Local."""
        return self.field.function

    @cached_property
    @collective("self.forest.comm")
    def stress(self) -> fem.Function:
        """L2 projection of the stress, a 3 x 3 tensor, continuous inside each material of a body [Pa].

        Collective.  Raises SolveError if the projection does not converge.
        """
        elasticity, six = self.elasticity, self._projected_stress
        result = fem.Function(elasticity.stresses.space(3, 3), name="stress")
        values = six.x.array.reshape(-1, 6)[six.function_space.dofmap.list]
        result.x.array.reshape(-1, 9)[result.function_space.dofmap.list] = values[:, :, np.ravel(TENSOR)]
        return result

    @property
    @collective("self.forest.comm")
    def nodal_stress(self) -> FloatArray:
        """`stress` at the nodes of this rank's leaves, in the order of `VOIGT`: (n, (p+1)^3, 6) [Pa].

        Collective.  Raises SolveError as `stress`.
        """
        return self.elasticity.at_leaves(self._projected_stress)

    @cached_property
    def _projected_stress(self) -> fem.Function:
        """Six components a node.  Collective."""
        shear_free = find_shear_free(self.scene, self.forest, self.elasticity.prolongation)
        return projected_stress(self.elasticity, self.field, shear_free, self.stages)

    @collective("self.forest.comm")
    def to_pyvista(self) -> Any:
        """Undeformed pyvista UnstructuredGrid of this rank's leaves, Lagrange hexahedra of the displacement's degree.

        Collective.  `grid.warp_by_vector("displacement")` deforms it; `pyvista.merge(comm.gather(step.to_pyvista()))`
        on rank 0 has the leaves of all ranks.

        Returns:
            Grid with point data `displacement` (n, 3) [m], `stress` (n, 9) [Pa] and `von Mises stress` [Pa]; cell
            data `body`, as numbered in the root mesh, `level`, `rank` and `indicator` [J^(1/2)].
        """
        return leaf_grid(self, self.displacement, self.stress)

    @cached_property
    def contact(self) -> ContactTable:
        """Contact at this rank's contact nodes, none if the scene has no contact pairs.  Local."""
        pairs, solution, comm = self.rows, self.solution, self.forest.comm
        names = tuple(pair.name for pair in self.scene.contact)
        if pairs is None:
            vectors, numbers, active = np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=bool)
            pair, key = np.zeros(0, dtype=np.int32), np.zeros(0, dtype=np.int64)
            return ContactTable(vectors, vectors, numbers, numbers, numbers, active, pair, names, key, comm)
        return ContactTable(
            points=pairs.position,
            normal=pairs.normal,
            pressure=solution.pressure,
            force=solution.force,
            gap=-solution.penetration,
            active=solution.active,
            pair=pairs.contact,
            names=names,
            key=pairs.node_keys,
            comm=comm,
            traction=solution.traction,
            slip=None if solution.traction is None else solution.slip_vector,
            slipping=None if solution.traction is None else solution.slides,
        )

    @property
    def surface_tags(self) -> dict[str, int]:
        """Values of the surfaces in `facet_tags`, from 1.  Local."""
        return {name: tag for tag, name in enumerate(self.scene.mesh.surfaces, 1)}

    @property
    def body_tags(self) -> dict[str, int]:
        """Values of the bodies in `cell_tags`, from 1.  Local."""
        return {name: tag for tag, name in enumerate(self.scene.mesh.bodies, 1)}

    @cached_property
    @collective("self.forest.comm")
    def facet_tags(self) -> MeshTags:
        """Tags of the facets on named surfaces; a facet on several surfaces has the last one.  Collective."""
        topology = self.mesh.topology
        topology.create_entities(2)
        topology.create_connectivity(2, 3)
        facets = topology.connectivity(3, 2).array.reshape(-1, 6)
        values = np.zeros(topology.index_map(2).size_local + topology.index_map(2).num_ghosts, dtype=np.int32)
        for tag, rows in self._surfaces:
            cell, face = rows.reshape(-1, 2).T
            values[facets[cell, face]] = tag
        tagged = np.flatnonzero(values).astype(np.int32)
        tags = meshtags(self.mesh, 2, tagged, values[tagged])
        tags.name = "surfaces"
        return tags

    @cached_property
    @collective("self.forest.comm")
    def cell_tags(self) -> MeshTags:
        """Tags of all cells by body.  Collective."""
        body = self.scene.mesh.body[self.forest.cell[self.leaf_mesh.leaf]]
        tags = meshtags(self.mesh, 3, np.arange(len(body), dtype=np.int32), (body + 1).astype(np.int32))
        tags.name = "bodies"
        return tags

    def ds(self, name: str) -> ufl.Measure:
        """The integral over a surface of the root mesh, for UFL: `ufl.inner(t, v) * step.ds("top")`.

        Collective at the first call.  The Gauss rule is exact for a constant pressure; `step.ds("top")(degree=8)` has
        another.  Raises SceneError if there is no such surface.
        """
        self.scene.mesh.surface(name)
        return self._boundary_measure(self.surface_tags[name])

    @cached_property
    def _surfaces(self) -> list[tuple[int, Int32Array]]:
        """Tag of each surface, and its local cells and local facets in turn."""
        surfaces, facets = self.scene.mesh.surfaces, self.leaf_mesh.facets
        return [(tag, facets(self.forest, rows).ravel()) for tag, rows in enumerate(surfaces.values(), 1)]

    @cached_property
    @collective("self.forest.comm", "Step.ds")
    def _boundary_measure(self) -> ufl.Measure:
        """One for all surfaces: those of one form must have the same facets."""
        self.mesh.topology.create_connectivity(2, 3)
        degree = 2 * (self.leaf_mesh.order + self.record.degree) - 1
        return ufl.Measure("ds", self.mesh, subdomain_data=self._surfaces, metadata={"quadrature_degree": degree})


def check_step(step: object, contact: bool = False) -> None:
    """Raises SceneError unless a value is a Step, with contact pairs if `contact`.  Local."""
    if not isinstance(step, Step):
        raise SceneError(f"a Step is needed, as adapt yields them, got {shown(step)}")
    if contact and step.rows is None:
        raise SceneError(f"the scene {step.scene.name!r} has no contact pairs, so there is no contact to show")
