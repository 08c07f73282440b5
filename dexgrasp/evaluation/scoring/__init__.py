"""Scores of grasp files, our own and others', under published protocols for floating hands."""
