"""Evaluation: protocols, trials, statistics, reports, scores of grasp files.

Takes agents by name, objects and seeds; gives rows of trials and intervals. It never changes what an agent sees.
"""
