"""From a grasp configuration to actions."""
