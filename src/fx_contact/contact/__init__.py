"""Contact as rows of constraints: kinds of rows, jump, projection, one linear system."""
