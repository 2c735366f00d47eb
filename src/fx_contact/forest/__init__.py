"""The distributed leaves: refinement, space-filling curve, partition."""

from fx_contact.forest.forest import Forest
from fx_contact.forest.partition import KINDS, repartition

__all__ = ["Forest", "KINDS", "repartition"]
