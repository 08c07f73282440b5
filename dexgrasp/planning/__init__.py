"""Planning: from a target to a certified grasp, by proposals, starting postures, the bilevel optimisation, forces.

Takes a `GraspTarget` and settings; gives a `PlanResult` with its certificate or the reason. It never simulates.
"""
