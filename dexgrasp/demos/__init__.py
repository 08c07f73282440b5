"""Demonstrations: rollouts of agents, converted, replayed, and kept as data sets that other libraries read."""
