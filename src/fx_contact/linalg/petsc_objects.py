"""Objects of PETSc that all ranks free together: on several ranks petsc4py does not free what Python drops."""

from fx_contact.parallel.errors import FxContactError


class PetscObjects:
    """Objects of PETSc that are freed at the end of a `with` block, also where an error of this package ends it.

    Collective.  Errors of this package are raised on all ranks.  Any other may have come to this rank alone, which must
    not wait for the rest: then nothing is freed.

    Args:
        things: objects of PETSc, or None; they may be destroyed before.
    """

    def __init__(self, *things):
        self._things = [thing for thing in things if thing is not None]

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if kind is None or issubclass(kind, FxContactError):
            for thing in reversed(self._things):
                thing.destroy()

    def add(self, thing):
        """One more of them: the thing itself.  Local."""
        self._things.append(thing)
        return thing

    def leak(self):
        """Never free them: PETSc has failed, perhaps on one rank alone, whose objects differ from those of the others.

        Local, but on all ranks.  Freeing is collective, here and in PETSc's own clean-up at the end of the program, and
        would hang; so one reference to each is kept for good.
        """
        for thing in self._things:
            if thing:  # not destroyed before
                thing.incRef()
        self._things.clear()
