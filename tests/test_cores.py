"""Cores that a process may use, by affinity and by the quota of its container."""

import math
import os

import pytest
from tables import table

from dexgrasp_env import cores

OWN = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


@pytest.mark.parametrize(("files", "quota"), table("quotas"))
def test_quotas_of_both_versions_count(tmp_path, files, quota):
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    assert cores._quota(tmp_path) == quota
    assert cores.usable_cores(tmp_path) == max(1, min(OWN, math.ceil(quota) if quota < math.inf else OWN))
