"""Behaviour cloning: policies that predict chunks of set-points or a grasp, by networks small enough for numpy."""
