"""The judge's checks, one subject a file; each computes what a grasp file claims by other means than the planner."""
