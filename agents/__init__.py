"""Agents: random, hardcoded, the planner, its ablations, learned policies, checkpoints of other libraries."""

if __name__ == "agents":
    raise ImportError("the agents are a part of dexgrasp: import dexgrasp.agents")
