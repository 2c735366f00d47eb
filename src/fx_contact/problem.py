"""Former package of scenes and meshes, whose public names are those of `fx_contact`; removed in the next version."""

import warnings
from typing import Any

import fx_contact


def __getattr__(name: str) -> Any:
    """A public name of the package, with a warning."""
    if name.startswith("__") or name not in fx_contact.__all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    warnings.warn(f"fx_contact.problem.{name} is now fx_contact.{name}", DeprecationWarning, stacklevel=2)
    return getattr(fx_contact, name)
