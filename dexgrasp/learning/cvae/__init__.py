"""Training the conditional VAE that proposes where three fingertips go."""
