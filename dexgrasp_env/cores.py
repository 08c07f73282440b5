"""Processor cores that this process may use: its affinity, and the CPU quota of its container."""

import math
import os
from contextlib import suppress
from pathlib import Path


def usable_cores(groups: Path = Path("/sys/fs/cgroup")) -> int:
    """Return how many cores this process may use, at least one; a quota counts in whole cores, rounded up.

    Args:
        groups: folder of the control groups, version 1 or 2.
    """
    own = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, math.ceil(min(own, _quota(groups))))


def _quota(groups: Path) -> float:
    """Return the cores of the quota, infinite where there is none."""
    for read in (_version_2, _version_1):
        with suppress(OSError, ValueError, ZeroDivisionError):
            quota, period = read(groups)
            return quota / period if quota > 0 else math.inf
    return math.inf


def _version_2(groups: Path) -> tuple[float, float]:
    quota, period = (groups / "cpu.max").read_text().split()
    return (-1.0 if quota == "max" else float(quota)), float(period)


def _version_1(groups: Path) -> tuple[float, float]:
    folder = groups / "cpu"
    return float((folder / "cpu.cfs_quota_us").read_text()), float((folder / "cpu.cfs_period_us").read_text())
