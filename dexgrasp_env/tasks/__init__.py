"""Tasks: lift, clutter and place as Gymnasium environments, single and vector, on CPU or GPU.

Takes settings and seeds; gives observations, rewards (`terms`, weights in `settings`) and infos. A task is a file, as
`gentle`, and its ids stand in `dexgrasp_env`. It knows no agent.
"""
