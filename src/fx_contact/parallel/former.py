"""Former public names, kept for one version."""

import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def former_names(module: str, now: Mapping[str, str], same: Mapping[str, Any] | None = None) -> Callable[[str], Any]:
    """`__getattr__` of a module for its former names, with a DeprecationWarning that says the new ones.  Local.

    Args:
        module: its `__name__`.
        now: what has replaced each name: "module.name", from where it is taken, or text if it is in `same`.
        same: what replaces names whose new ones are called in another way.
    """

    def of(name: str) -> Any:
        """What a name stands for.  Raises AttributeError if it is no former one."""
        if name not in now:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        warnings.warn(f"{module}.{name} is now {now[name]}", DeprecationWarning, stacklevel=2)
        if same and name in same:
            return same[name]
        place, _, new = now[name].rpartition(".")
        return getattr(import_module(place), new)

    return of
