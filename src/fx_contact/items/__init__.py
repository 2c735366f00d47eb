"""Items of a scene: materials, conditions, loads, contacts, ties, obstacles."""
