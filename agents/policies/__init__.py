"""Policies of the environment: random, hard-coded, the planner, its ablations, trained checkpoints."""
