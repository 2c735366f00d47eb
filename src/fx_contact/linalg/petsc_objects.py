"""When objects of PETSc end: on several ranks Python does not free them, for all ranks must do so together."""

from fx_contact.parallel.errors import FxContactError


class PetscObjects:
    """Objects of PETSc that are freed where a `with` block ends, also where an error of this package ends it.

    Collective.  Such errors are raised on all ranks.  Any other, like a Ctrl-C, may have come to this rank alone, which
    must not wait for the rest: then nothing is freed.

    Args:
        things: objects of PETSc.  One that has been freed before may be among them.
    """

    def __init__(self, *things):
        self._things = list(things)

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

    def leave(self):
        """Free none of them: PETSc has failed, perhaps on one rank, which has not the same ones as others any more.

        Local, but on all ranks.  Where one rank alone has freed all that PETSc had on a communicator, that rank waits
        for the others when it next makes something there.  What Python drops PETSc frees when it ends, on all ranks
        alike: here it would wait for ever, so that one reference to each stays.
        """
        for thing in self._things:
            if thing:  # not freed before
                thing.incRef()
        self._things.clear()
