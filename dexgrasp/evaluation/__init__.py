"""Evaluation: protocols, trials, statistics, reports, scores of grasp files.

Takes agents by name, objects, seeds and protocols (`assets/protocols.yaml`); gives rows of trials and intervals. It
never changes what an agent sees.
"""
