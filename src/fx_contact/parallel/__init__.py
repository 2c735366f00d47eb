"""What every other room stands on: errors raised together, rows between ranks, checks of input, costs, memory."""

from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.mpi import Directory, together
from fx_contact.parallel.timing import Stages

__all__ = ["Directory", "Exchange", "Stages", "together"]
