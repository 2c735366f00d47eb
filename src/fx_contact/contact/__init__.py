"""Contact as rows of constraints: node pairs, enforcement, active set, and the solver of the two together."""
