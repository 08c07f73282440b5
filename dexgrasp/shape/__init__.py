"""The shape of an object from its cloud: hull, convex parts, the side that was not seen, the planner's target."""
