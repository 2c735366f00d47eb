"""The adaptive loop: steps, records and checkpoints."""

from fx_contact.parallel.former import former_names

_NAMES = "Beginning", "Checkpoint", "Step", "StepRecord", "adapt", "solve"
__getattr__ = former_names(__name__, {name: f"fx_contact.{name}" for name in _NAMES})
