"""Foundations: errors raised on all ranks, exchange of rows between ranks, checks of input, timings, memory."""

from fx_contact.parallel.exchange import Exchange
from fx_contact.parallel.mpi import Directory, together
from fx_contact.parallel.timing import Stages

__all__ = ["Directory", "Exchange", "Stages", "together"]
