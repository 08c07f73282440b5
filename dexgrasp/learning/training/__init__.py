"""The training loop: resumable rounds, checkpoints, curves."""
