"""What every other room stands on: errors raised together, rows between ranks, checks of input, costs, memory."""

from fx_contact.parallel.mpi import Directory, Exchange, together
from fx_contact.parallel.timing import Stages

__all__ = ["Directory", "Exchange", "Stages", "together"]
