"""Long work: folders that are claimed and resumed, workers, interrupts, compilation, versions.

Takes tasks and folders; gives results in order. It knows no grasp.
"""
