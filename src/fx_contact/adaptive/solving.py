"""The last step of a run."""

from collections.abc import Callable
from inspect import signature
from typing import Any

from fx_contact.adaptive.adaptive_loop import adapt
from fx_contact.adaptive.step import Step
from fx_contact.parallel.meeting import P, R, collective


def arguments_of(other: Callable[P, Any]) -> Callable[[Callable[..., R]], Callable[P, R]]:
    """Decorator of a function with the arguments of another one.  Local."""

    def decorate(function: Callable[..., R]) -> Callable[P, R]:
        """The function, whose signature shows them."""
        shown = signature(other).replace(return_annotation=signature(function).return_annotation)
        vars(function)["__signature__"] = shown
        return function

    return decorate


@collective("comm")
@arguments_of(adapt)
def solve(*arguments: Any, **options: Any) -> Step:
    """Solve a scene to a prescribed accuracy; only the last step is kept.

    Collective on comm.  Arguments and errors are those of `adapt`, which takes more memory.

    Returns:
        the last step; `record.reached` is true where the tolerance and all goals are reached.
    """
    return adapt(*arguments, **options).last_step()
