"""Two cells in one process: each as if it were alone, though joints, fingers, mount and table are others."""

import json
from pathlib import Path

import gymnasium as gym
import numpy as np
from processes import python
from refusals import rejected

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.store import read_rows
from dexgrasp.grasp.file import record_of
from dexgrasp.planning.scene_setup import look_at
from dexgrasp.registry import make_agent
from dexgrasp_env.robot.cell import make_cell

CELL = "schema: 1\nname: gripper\nrobot: panda_gripper.yaml\ntable_height: 0.05\n"
"""Another hand, mount and table."""


def played(robot: str | None, folder: Path) -> dict[str, object]:
    """What comes of a cell: a plan, its verification, steps of the environment, a trial of an evaluation."""
    agent, cell = make_agent("bilevel"), make_cell(robot)
    look = look_at("pear", agent, seed=3, robot=robot)
    plan = agent.plan(look.observation, look.info)
    content = plan.contents(look.subject.identity, "bilevel", look.subject.pose)[0]
    failed = rejected(record_of(content, cell=cell))
    env = gym.make("DexGrasp/Lift-v2", objects="pear", robot=robot)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    seen = [env.step(rng.uniform(-1.0, 1.0, env.action_space.shape))[0] for _ in range(5)][-1]
    settings = EvaluationSettings.of(["bilevel"], ["soda"], trials=1, seed=1, robot=robot)
    evaluate(settings, folder)
    (row,) = read_rows(folder)
    return {
        "q": content["q"], "robot": content["robot"]["name"], "table": content["table_height"], "failed": failed,
        "seen": {key: value.tolist() for key, value in seen.items()},
        "trial": {key: row[key] for key in ("success", "steps", "total_reward", "height", "slip")},
    }  # fmt: skip


def test_two_cells_in_one_process_are_as_each_alone(tmp_path):
    (tmp_path / "cell.yaml").write_text(CELL)
    other = str(tmp_path / "cell.yaml")
    alone = [json.loads(_run(robot, tmp_path / name)) for robot, name in ((None, "a"), (other, "b"))]
    both = [played(robot, tmp_path / name) for robot, name in ((other, "d"), (None, "c"))][::-1]
    assert alone == json.loads(json.dumps(both))
    assert [len(one["q"]) for one in both] == [23, 9]
    assert [(one["robot"], one["table"]) for one in both] == [("panda_allegro", 0.0), ("panda_gripper", 0.05)]
    assert all(one["failed"] == [] and one["trial"]["success"] for one in both)


def _run(robot: str | None, folder: Path) -> str:
    code = "import json, sys; from pathlib import Path; from test_two_cells import played\n"
    code += "print(json.dumps(played(sys.argv[1] or None, Path(sys.argv[2]))))"
    return python(code, robot or "", folder, cwd=Path(__file__).parent)
