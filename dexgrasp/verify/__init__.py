"""The judge: every claim of a grasp file computed again, by means of its own."""
