"""Reinforcement learning with Stable-Baselines3's algorithms on the native vector environment."""
