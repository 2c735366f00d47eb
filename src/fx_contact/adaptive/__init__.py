"""The adaptive loop: one step, the loop over the steps, and what of it is kept on disk."""
