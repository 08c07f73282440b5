"""Training of the conditional VAE that proposes the positions of three fingertips."""
