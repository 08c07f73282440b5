"""The grasp dataset and the generative model."""
