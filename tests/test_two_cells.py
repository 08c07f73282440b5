"""Two cells in one process: each as if it were alone, though joints, fingers, mount and table are others."""

import json
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import yaml
from processes import python
from refusals import rejected

from dexgrasp.evaluation.evaluate import evaluate
from dexgrasp.evaluation.settings import EvaluationSettings
from dexgrasp.evaluation.store import read_rows
from dexgrasp.grasp.file import record_of
from dexgrasp.planning.scene_setup import look_at
from dexgrasp.registry import make_agent
from dexgrasp_env.assets import asset_path
from dexgrasp_env.robot.cell import make_cell

RING = slice(8, 12)


def without_ring_finger(folder: Path) -> Path:
    """Write the files of a cell whose hand has three fingers, 19 joints with the arm's, on another mount and table."""
    spec = mujoco.MjSpec.from_file(str(asset_path("robot", "allegro.xml")))
    spec.delete(spec.body("ring_base"))
    spec.meshdir = str(asset_path("robot", "shells"))
    (folder / "three.xml").write_text(spec.to_xml())
    hand = yaml.safe_load(asset_path("robot", "allegro.yaml").read_text())
    for key in ("lower", "upper", "open"):
        del hand[key][RING]
    hand["fingers"] = [finger for finger in hand["fingers"] if finger["name"] != "ring"]
    hand["self_pairs"] = [pair for pair in hand["self_pairs"] if not any("ring" in body for body in pair)]
    robot = {"schema": 1, "kind": "robot", "name": "panda_three", "arm": "panda.yaml", "hand": "three.yaml"}
    cell = {"schema": 1, "name": "three fingers", "robot": "robot.yaml", "table_height": 0.05}
    files = {
        "three": hand | {"name": "three", "mjcf": "three.xml"},
        "robot": robot | {"mount": "fingers_along"},
        "cell": cell,
    }
    for name, content in files.items():
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(content))
    return folder / "cell.yaml"


def played(robot: str | None, folder: Path) -> dict[str, object]:
    """What comes of a cell: a plan, its verification, steps of the environment, a trial of an evaluation."""
    agent, cell = make_agent("bilevel"), make_cell(robot)
    look = look_at("sugar_box", agent, seed=3, robot=robot)
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
    other = str(without_ring_finger(tmp_path))
    alone = [json.loads(_run(robot, tmp_path / name)) for robot, name in ((None, "a"), (other, "b"))]
    both = [played(robot, tmp_path / name) for robot, name in ((other, "d"), (None, "c"))][::-1]
    assert alone == json.loads(json.dumps(both))
    assert [len(one["q"]) for one in both] == [23, 19]
    assert [(one["robot"], one["table"]) for one in both] == [("panda_allegro", 0.0), ("panda_three", 0.05)]
    assert all(one["failed"] == [] and one["trial"]["success"] for one in both)


def _run(robot: str | None, folder: Path) -> str:
    code = "import json, sys; from pathlib import Path; from test_two_cells import played\n"
    code += "print(json.dumps(played(sys.argv[1] or None, Path(sys.argv[2]))))"
    return python(code, robot or "", folder, cwd=Path(__file__).parent)
