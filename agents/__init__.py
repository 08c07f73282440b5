"""Agents: random, hardcoded, the planner, its ablations, learned policies, checkpoints of other libraries.

Take observations and public infos; give actions and a report. They never see the simulation.
"""

if __name__ == "agents":
    raise ImportError("the agents are a part of dexgrasp: import dexgrasp.agents")
