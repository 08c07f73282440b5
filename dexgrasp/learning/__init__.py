"""Training of policies and of the grasp network: conditional VAE, imitation, reinforcement, one training loop.

Takes data sets and environments; gives checkpoints, and weights that run in numpy. It never scores an agent.
"""
