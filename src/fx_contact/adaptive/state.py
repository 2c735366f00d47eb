"""The state of a run between two meshes, and of a load path between two points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from mpi4py import MPI

from fx_contact.adaptive.settings import Settings
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import StepRecord
from fx_contact.adaptive.step_solver import StepStart
from fx_contact.estimate.estimator import Estimate
from fx_contact.estimate.marking import expected_estimate
from fx_contact.fem.nodal_fields import NodalFields
from fx_contact.fem.prolongation import Prolongation
from fx_contact.fem.space import Space
from fx_contact.forest.forest import Forest
from fx_contact.parallel.arrays import Int8Array
from fx_contact.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class State:
    """State of a run between two meshes.

    Attributes:
        fields: "displacement", solved or a first guess [m]; `step_solver.HISTORY`, that of the point before in a load
            path of increments [m]; "carried", fields of the user.
        motions: `StepRecord.motions`; None: obstacles below forces begin where they touch.
        effectivity: assumed of the estimate on the forest, as of `StepRecord`; None: that of a first mesh.
        estimate: errors in the order of the leaves; None: to be solved.
        refine: (n,), number of refinements of each leaf for contact and goals, beside those for the estimate.
        expected: `StepRecord.expected_estimate`, of this mesh.
        moved: `Contact.moved` of the solution, by the names of contacts [m].
    """

    fields: NodalFields
    motions: Mapping[str, Any] | None = None
    effectivity: float | None = None
    estimate: Estimate | None = None
    refine: Int8Array | None = None
    expected: float | None = None
    moved: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    @property
    def forest(self) -> Forest:
        """Forest of the fields."""
        return self.fields.forest

    @classmethod
    def at_rest(cls, forest: Forest, degree: int) -> Self:
        """The undeformed state on a forest.  Local."""
        zero = np.zeros((len(forest), (degree + 1) ** 3, 3))
        return cls(NodalFields.of(forest, degree, {"displacement": zero}))

    @classmethod
    def of(cls, step: Step) -> Self:
        """The state after a step.  Collective on step.forest.comm."""
        fields = step.fields.with_field("displacement", step.nodal_displacement)
        cell, error = np.argsort(step.leaf_mesh.leaf), step.estimate
        at_edge = None if error.at_edge is None else error.at_edge[cell]
        estimate = replace(error, error=error.error[cell], energy=None, at_edge=at_edge)
        theta, refine = step.record.assumed_effectivity, step.contact_error.refine
        return cls(fields, step.record.motions, theta, estimate, refine, moved=places(step.scene))

    def start(self, settings: Settings) -> StepStart:
        """Start of a solve on the forest.  Collective."""
        space = Space(self.forest, settings.degree)
        prolongation = Prolongation(space)
        displacement = prolongation.injected(self.fields.at_nodes(space, "displacement"))
        theta = self.effectivity or settings.control.effectivity(settings.degree)
        fields = self.fields.without("displacement")
        return StepStart(prolongation, displacement, fields, theta, self.motions, self.expected)

    def is_accurate(self, settings: Settings) -> bool:
        """True if a solved state needs no refinement.  Collective."""
        theta = self.effectivity
        assert self.estimate is not None and self.refine is not None and theta is not None, "solved"
        more = self.forest.comm.allreduce(bool(self.refine.any()), op=MPI.LOR)
        return settings.control.sought(self.estimate, settings.tolerance, theta) is None and not more

    def refined(self, settings: Settings, records: Sequence[StepRecord]) -> Self:
        """A solved state on the forest refined for the tolerance, contact and goals, by all records.  Collective."""
        theta, control = self.effectivity, settings.control
        assert self.estimate is not None and self.refine is not None and theta is not None, "solved"
        later = control.effectivity(settings.degree, theta)
        marked = control.marked(self.estimate, settings.tolerance, theta, self.forest.comm, later, loss_rate(records))
        expected = expected_estimate(self.estimate, marked, self.forest.comm)
        fields = self.fields.refined(np.maximum(marked, self.refine))
        return type(self)(fields, self.motions, later, expected=expected)


def places(scene: Scene) -> dict[str, tuple[float, float, float]]:
    """`Contact.moved` by the names of contacts [m].  Local."""
    return {pair.name: pair.moved for pair in scene.contact}


def loss_rate(records: Sequence[StepRecord]) -> float:
    """Loss of xi^2 by the last refinement over that of a smooth solution, at most 1; 1 on a first mesh [-].  Local."""
    now, before = records[-1], records[-2:][0]
    if now.expected_estimate is None:
        return 1.0
    lost, expected = (before.estimate**2 - xi**2 for xi in (now.estimate, now.expected_estimate))
    return min(lost / expected, 1.0) if lost > 0 < expected else 1.0
