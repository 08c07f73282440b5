"""Reinforcement with Stable-Baselines3's algorithms on the native vector environment, from nothing or from a clone."""
