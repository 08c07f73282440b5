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


def _quota(groups: Path, own: Path = Path("/proc/self/cgroup")) -> float:
    """Return the cores of the least quota that this process is under, infinite where there is none.

    Args:
        groups: as for `usable_cores`.
        own: file that names the groups of this process: in a container the root's, elsewhere one within others.
    """
    places = [groups, groups / "cpu"]
    with suppress(OSError, ValueError):
        for line in own.read_text().splitlines():
            _, kinds, path = line.split(":", 2)
            within = Path(path.lstrip("/"))
            places += [groups / kind / part for kind in (kinds, "cpu") for part in (within, *within.parents)]
    return min(map(_quota_of, places))


def _quota_of(group: Path) -> float:
    with suppress(OSError, ValueError, ZeroDivisionError):
        names = ("cpu.max",) if (group / "cpu.max").is_file() else ("cpu.cfs_quota_us", "cpu.cfs_period_us")
        quota, period = " ".join((group / name).read_text() for name in names).split()
        if float(quota) > 0:  # "max" is none
            return float(quota) / float(period)
    return math.inf
