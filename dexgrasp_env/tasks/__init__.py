"""Tasks: lift, clutter and place as Gymnasium environments, single and vector, on CPU or GPU.

Takes settings and seeds; gives observations, rewards (`reward_terms`, weights in `settings`) and infos. A task is a
file, as `gentle`: its settings, the hooks of `Episodes` that it overrides, its page; its vector class is in `vector`,
its ids are in `dexgrasp_env`. It knows no agent.
"""
