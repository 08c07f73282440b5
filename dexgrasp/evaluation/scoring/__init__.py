"""Grasp files, ours and others', scored under the protocols that others publish."""
