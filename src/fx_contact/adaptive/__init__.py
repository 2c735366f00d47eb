"""The adaptive loop: steps, records and checkpoints."""
