"""Tasks: lift, clutter and place as Gymnasium environments, single and vector, on CPU or GPU.

Takes settings and seeds; gives observations, rewards and infos. It knows no agent.
"""
