"""The adaptive loop: steps, records and checkpoints."""

from fx_contact.adaptive.adaptive_loop import adapt
from fx_contact.adaptive.beginning import Beginning
from fx_contact.adaptive.checkpoint import Checkpoint
from fx_contact.adaptive.solving import solve
from fx_contact.adaptive.step import Step
from fx_contact.adaptive.step_record import StepRecord

__all__ = ["Beginning", "Checkpoint", "Step", "StepRecord", "adapt", "solve"]
