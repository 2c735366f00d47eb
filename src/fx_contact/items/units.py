"""Names of the units of a scene, for axes, legends and reports: no number is converted.  All is local."""

from math import isclose
from typing import TypeAlias

from fx_contact.parallel.errors import SceneError
from fx_contact.parallel.validation import shown

#: Names of the units of length and stress; None: not known.
Units: TypeAlias = tuple[str, str] | None

#: Units of length with their value [m], of stress [Pa], and of force, stress times the square of length, by value [N].
_LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "um": 1e-6, "µm": 1e-6, "nm": 1e-9, "in": 0.0254, "ft": 0.3048}
_FORCES = {1.0: "N", 1e3: "kN", 1e6: "MN", 1e9: "GN", 4.448: "lbf"}
_STRESSES = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "psi": 6895.0, "ksi": 6.895e6}
_STRESSES |= dict.fromkeys(("N/mm²", "N/mm^2"), _STRESSES["MPa"])


def pascals(units: Units) -> float:
    """The unit of stress [Pa]; 0 if it is not known."""
    return 0.0 if units is None else _STRESSES.get(units[1], 0.0)


def check_names_of_units(units: object) -> None:
    """Raises SceneError unless a value is None or two names, that of a length first."""
    if units is not None and not (
        isinstance(units, tuple) and len(units) == 2 and all(isinstance(name, str) and name.strip() for name in units)
    ):
        raise SceneError(
            f'units must be the names of those of length and stress, as ("mm", "MPa"), got {shown(units)}'
        )
    if units is not None and (units[0] in _STRESSES or units[1] in _LENGTHS):
        raise SceneError(f"units are those of length and stress, in this order, got {shown(units)}")
    for name, known in zip(units or (), (_LENGTHS, _STRESSES)):
        for other in known:
            if name not in known and name.lower() == other.lower():
                raise SceneError(f"a unit is named {name!r}; did you mean {other!r}?")


def unit_of(quantity: str, units: Units) -> str:
    """Unit of a "length", "area", "stress" or "force"; empty if it is not known, or for another quantity."""
    if units is None:
        return ""
    length, stress = units
    value = _STRESSES.get(stress, 0.0) * _LENGTHS.get(length, 0.0) ** 2
    force = next(
        (name for known, name in _FORCES.items() if isclose(known, value, rel_tol=1e-3)), f"{stress} {length}²"
    )
    return {"length": length, "area": f"{length}²", "stress": stress, "force": force}.get(quantity, "")


def of_lengths(units: Units) -> str:
    """Name of the unit of length, for messages."""
    return unit_of("length", units) or "in units of the mesh"


def labelled(text: str, quantity: str, units: Units) -> str:
    """A text with the unit of its quantity in brackets, if that is known."""
    unit = unit_of(quantity, units)
    return f"{text} [{unit}]" if unit else text
