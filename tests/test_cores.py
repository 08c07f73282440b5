"""Cores that a process may use, by affinity and by the quota of its container."""

import math
import os

import pytest
from tables import table

from dexgrasp_env import cores

OWN = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def test_the_least_quota_of_nested_groups_counts(tmp_path):
    own = tmp_path / "own"
    own.write_text("4:cpu,cpuacct:/docker/a\n0::/lab.slice/job\n")
    for name, text in {
        "fs/lab.slice/job/cpu.max": "max 100000", "fs/lab.slice/cpu.max": "250000 100000",
        "fs/cpu,cpuacct/docker/a/cpu.cfs_quota_us": "300000", "fs/cpu,cpuacct/docker/a/cpu.cfs_period_us": "100000",
    }.items():  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert cores._quota(tmp_path / "fs", own) == 2.5
    (tmp_path / "fs/lab.slice/cpu.max").unlink()
    assert cores._quota(tmp_path / "fs", own) == 3.0


@pytest.mark.parametrize(("files", "quota"), table("quotas"))
def test_quotas_of_both_versions_count(tmp_path, files, quota):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert cores._quota(tmp_path) == quota
    assert cores.usable_cores(tmp_path) == max(1, min(OWN, math.ceil(quota) if quota < math.inf else OWN))
