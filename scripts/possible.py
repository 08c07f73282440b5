"""Of the scenes of an evaluation, which have a grasp that bears the object at all, and how many of these were held?

    dexgrasp evaluate --agents bilevel --objects all20 --trials 4 --robot weak.yaml --out RUN
    python scripts/possible.py RUN

A scene is possible if the planner finds a grasp that bears the weight when it knows the true shape, place, mass and
centre, and looks at many more rounds of proposals than it is patient for otherwise. What this says no to may still be
possible with the palm, or in a posture that nobody tried. RUN/possible.jsonl keeps a line a scene; those that are there
are not done again.
"""

import sys
from dataclasses import replace
from typing import Annotated, Any

import gymnasium as gym

import dexgrasp_env  # noqa: F401  (registers the environments)
from dexgrasp.cli.command import Argument, Folder, Script
from dexgrasp.cli.commands import run_script
from dexgrasp.evaluation.report.tables import rate_words
from dexgrasp.evaluation.store import read_rows
from dexgrasp.evaluation.summary import grouped, summarise_agent
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp.runs.lines import Lines
from dexgrasp.runs.progress import progress_bar
from dexgrasp_env.arrays import Fields
from dexgrasp_env.errors import InputError
from dexgrasp_env.poses import rotate
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.valid import Count

_CONVEX = 0.97  # of the hull's volume that a surface encloses, from where the hull stands for it


def true_target(row: Fields) -> GraspTarget:
    """Return the object of a trial as it lies, nothing of it guessed."""
    env = gym.make(**row["env"], disable_env_checker=True)
    env.reset(seed=row["scene_seed"])
    simulation: Any = env.unwrapped.simulation  # type: ignore[attr-defined]
    model, pose = simulation.object, simulation.poses()[0]
    env.close()
    hollow = model.mesh.volume < _CONVEX * model.mesh.convex_hull.volume
    parts = [part.surface().vertices for part in model.parts] if hollow else [model.solid.corners]
    corners = [rotate(pose[3:], part) + pose[:3] for part in parts]
    return GraspTarget.of_corners(corners, model.mass, pose[:3])


def most_borne(row: Fields, rounds: int) -> float:
    """Return the `load` of the best grasp that was found; below 1 it does not bear the weight."""
    cell = make_cell(row["env"].get("robot"), row["env"].get("mount"))
    planner = Planner(replace(PlannerSettings(), patience=rounds), cell=cell)
    grasp = planner.plan(true_target(row), row["agent_seed"], cell.robot.home.copy()).grasp
    return 0.0 if grasp is None else grasp.certificate.load


class Possible(Script):
    """Looks at the scenes that are not there yet, and counts.

    Attributes:
        folder: of an evaluation.
        rounds: looked at whole before the answer is no.
    """

    folder: Argument[Annotated[Folder, "RUN"]]
    rounds: Count = 12

    def run(self) -> int:
        rows, kept = read_rows(self.folder), Lines(self.folder / "possible.jsonl", "scene", _fault)
        if others := sorted({row["protocol"] for row in rows} - {"lift"}):
            raise InputError(f"trials of {', '.join(others)}: what is possible is judged for lift alone")
        known = {tuple(line["scene"]): line["load"] for line in kept.rows}
        with progress_bar("scene", "scenes") as show:
            for number, row in enumerate(rows, start=1):
                if scene_of(row) not in known:
                    load = known[scene_of(row)] = most_borne(row, self.rounds)
                    kept.append({"scene": scene_of(row), "load": load})
                show(number, len(rows))
        kept.close()
        for agent, own in grouped(rows, "agent").items():
            for said, possible in (("possible", True), ("others", False)):
                some = [row for row in own if (known[scene_of(row)] >= 1.0) is possible]
                if some:
                    found = summarise_agent(some)
                    held = f"{found['successes']} of {found['trials']} held, {rate_words(found)}"
                    print(f"{agent}, {said}: {held}; {found['failures']}")
        return 0


def _fault(line: Any) -> str | None:
    return None if isinstance(line, dict) and {"scene", "load"} <= line.keys() else "it has scene and load"


def scene_of(row: Fields) -> tuple[Any, ...]:
    """Return what tells a scene from the others of its evaluation."""
    return row["protocol"], row["object"], row["trial"]


if __name__ == "__main__":
    sys.exit(run_script(Possible))
