"""Data sets: grasps by the thousand, and demonstrations of agents.

Takes settings and seeds; gives folders that other libraries read. It trains nothing.
"""
