"""Long work: folders that are claimed and resumed, workers, interrupts, compilation, weights on disk, versions.

Takes tasks and folders; gives results in order. It knows no grasp.
"""
