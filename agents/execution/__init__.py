"""From a grasp configuration to actions: approach, close, squeeze, lift, hold."""
