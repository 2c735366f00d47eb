"""The distributed leaves: refinement, space-filling curve, partition."""
