"""Names of the units of a scene, for axes, legends and reports: no number is converted.  All is local."""

from typing import TypeAlias

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import shown

#: Names of the units of length and stress; None: not known.
Units: TypeAlias = tuple[str, str] | None

#: Units of force, stress times the square of length, that have a name of their own.
_FORCES = {
    ("m", "Pa"): "N",
    ("m", "kPa"): "kN",
    ("m", "MPa"): "MN",
    ("m", "GPa"): "GN",
    ("mm", "MPa"): "N",
    ("mm", "N/mm²"): "N",
    ("mm", "N/mm^2"): "N",
    ("mm", "GPa"): "kN",
    ("in", "psi"): "lbf",
}


def check_names_of_units(units: object) -> None:
    """Raises SceneError unless a value is None or two names."""
    if units is not None and not (
        isinstance(units, tuple) and len(units) == 2 and all(isinstance(name, str) and name.strip() for name in units)
    ):
        raise SceneError(
            f'units must be the names of those of length and stress, as ("mm", "MPa"), got {shown(units)}'
        )


def unit_of(quantity: str, units: Units) -> str:
    """Unit of a "length", "stress" or "force"; empty if it is not known, or for another quantity."""
    if units is None:
        return ""
    length, stress = units
    force = _FORCES.get((length, stress), f"{stress} {length}²")
    return {"length": length, "stress": stress, "force": force}.get(quantity, "")


def labelled(text: str, quantity: str, units: Units) -> str:
    """A text with the unit of its quantity in brackets, if that is known."""
    unit = unit_of(quantity, units)
    return f"{text} [{unit}]" if unit else text
