"""The scene: items on a root mesh, checked."""
