"""Load paths."""
