"""The grasp dataset: rest poses, sampled grasps, shards."""
