"""Foundations: errors raised on all ranks, exchange of rows between ranks, checks of input, timings, memory."""
