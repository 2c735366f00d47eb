"""What every other room stands on: errors raised together, rows between ranks, checks of input, costs, memory."""
