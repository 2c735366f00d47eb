"""Fields at the nodes of a forest that are carried on: through refinement, coarsening and repartition."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from fx_contact.fem.space import Space
from fx_contact.forest.coarsening import coarsened
from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import repartition
from fx_contact.geometry import hexahedron
from fx_contact.parallel.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class NodalFields:
    """Continuous fields of degree p at the nodes of this rank's leaves, by name.

    Attributes:
        array: (n, (p+1)^3, k), the components of all fields, side by side.
        sizes: number of components of each field, in their order.
    """

    forest: Forest
    array: FloatArray
    sizes: Mapping[str, int]

    @classmethod
    def of(cls, forest: Forest, degree: int, fields: Mapping[str, FloatArray]) -> Self:
        """Fields (n, (p+1)^3, size) of a degree.  Local."""
        none: FloatArray = np.zeros((len(forest), (degree + 1) ** 3, 0))
        sizes = {name: one.shape[2] for name, one in fields.items()}
        return cls(forest, np.concatenate([none, *fields.values()], axis=2), sizes)

    @property
    def degree(self) -> int:
        """p of the fields."""
        return hexahedron.order_of(self.array.shape[1])

    def __contains__(self, name: str) -> bool:
        return name in self.sizes

    def __getitem__(self, name: str) -> FloatArray:
        """A field (n, (p+1)^3, size).  Local.  Raises KeyError: there is none of this name."""
        return self._by_name()[name]

    def with_field(self, name: str, values: FloatArray) -> Self:
        """These fields and another one (n, (p+1)^3, size), which replaces one of the same name.  Local."""
        return self.of(self.forest, self.degree, {**self._by_name(), name: values})

    def without(self, name: str) -> Self:
        """The fields of other names.  Local."""
        return self.of(self.forest, self.degree, {key: one for key, one in self._by_name().items() if key != name})

    def at_nodes(self, space: Space, name: str) -> FloatArray:
        """A field at the nodes of the Space of its degree and forest: (m, size).  Local."""
        leaf, node = space.example.T
        return self[name][leaf, node]

    def of_degree(self, degree: int) -> Self:
        """The fields interpolated at the nodes of a degree.  Local."""
        if degree == self.degree:
            return self
        functions = hexahedron.lagrange(self.degree, np.linspace(0, 1, degree + 1))
        return self._carried(self.forest, hexahedron.tensor_evaluate((functions,) * 3, self.array))

    def refined(self, times: IntArray) -> Self:
        """Interpolated fields on leaves refined a number of times (n,), as `Forest.refined_with`.  Collective."""
        return self._carried(*self.forest.refined_with(times, self.array))

    def repartitioned(self, kind: str) -> Self:
        """The fields on the ranks of a partition, as `partition.repartition`.  Collective."""
        return self._carried(*repartition(self.forest, self.array, kind))

    def coarsened(self, level: IntArray, kind: str) -> Self:
        """The nodal values on the forest of `coarsening.coarsened`, whose nodes are nodes of this one.  Collective."""
        merged = coarsened(self.forest, level, kind)
        before, after = Space(self.forest, self.degree), Space(merged, self.degree)
        leaf, node = before.example.T
        found, _ = before.directory.lookup(after.keys, self.array[leaf, node], np.ones(len(before), dtype=bool))
        return self._carried(merged, found[after.cells])

    def _carried(self, forest: Forest, array: FloatArray | None) -> Self:
        """The same fields by their components on another forest."""
        assert array is not None, "given values are returned"
        return replace(self, forest=forest, array=array)

    def _by_name(self) -> dict[str, FloatArray]:
        ends = np.cumsum([0, *self.sizes.values()])
        return {name: self.array[..., low:high] for name, low, high in zip(self.sizes, ends, ends[1:])}
