"""Agent `bilevel`: cloud -> hull -> proposals -> postures -> bilevel optimisation -> certified grasp -> actions."""

from dataclasses import replace

from dexgrasp.agent import BY_CLOUD, Agent, Info, Observation, cell_of
from dexgrasp.agents.stages import Episode, Stage, first_stage
from dexgrasp.geometry.request import ANYHOW, GraspRequest
from dexgrasp.planning.plan_scene import default_planner, plan_scene, start_of
from dexgrasp.planning.planner import Planner
from dexgrasp.planning.result import PlanResult, Progress
from dexgrasp.planning.settings import PlannerSettings
from dexgrasp_env.arrays import Single
from dexgrasp_env.errors import InputError
from dexgrasp_env.perception.scene import ObjectCloud, Scene
from dexgrasp_env.robot.cell import Cell, default_cell


class BilevelAgent(Agent):
    """Plans from the cloud at reset and carries the grasp out; told nothing of the object's pose or mass.

    Where the joints feel that the object was lost, the arm goes home, looks again and grasps once more; where there is
    no grasp, a neighbour that is in the way is set aside first, what lies flat is slid over the table's edge, or the
    agent looks again at once.
    """

    env_settings = BY_CLOUD | {"observe": "clear"}

    def __init__(
        self,
        proposals: str = "auto",
        settings: PlannerSettings | None = None,
        cell: Cell | None = None,
        *,
        regrasps: int = 2,
        turns: bool = True,
        moves: int = 8,
        request: GraspRequest = ANYHOW,
    ) -> None:
        """Prepare the planner.

        Args:
            proposals: `surface` (all triples of surface points), `cvae` (learned), or `auto`: `cvae`, and `surface` for
                objects that are not convex or of which the network finds no triple in closure.
            settings: thresholds and budgets of the planner.
            cell: of the robot, where an episode says none; the simulated one by default.
            regrasps: how often to look and plan again in an episode where the object was lost or no grasp found.
            turns: whether to turn an object that is barely held, once it is lifted (see `planning.carry`).
            moves: how many neighbours to set aside at most where the object cannot be grasped among them.
            request: where and how the object is to be grasped, its mass and friction, how many grasps; a
                `max_force` that an environment tells goes before.
        """
        self.settings = settings or PlannerSettings()
        self.result: PlanResult | None = None
        self._proposals, self._request = proposals, request
        self._planner = self._make(cell or default_cell())
        self._regrasps, self.turns, self._moves = regrasps, turns, moves
        self._seed = 0
        self._stage: Stage | None = None

    def _make(self, cell: Cell) -> Planner:
        return default_planner(cell, self.settings, self._proposals).asking(self._request)

    def seed(self, seed: int) -> None:
        """Seed the proposals of the next episode."""
        self._seed = int(seed)

    def plan(
        self,
        observation: Observation,
        info: Info,
        progress: Progress | None = None,
        relax: bool = False,
    ) -> PlanResult:
        """Plan from the first observation of an episode; nothing is carried out.

        Args:
            observation: of a cloud.
            info: as `reset` takes it.
            progress: called with steps done and steps in all, where a count is asked for.
            relax: where what was asked for cannot be had, say what can.

        Raises:
            InputError: for an observation that shows no cloud or no robot.
        """
        cell, most = cell_of(info, self._planner.cell), info.get("max_force", self._request.max_force)
        if cell != self._planner.cell or most != self._planner.request.max_force:
            self._planner = self._make(cell).asking(replace(self._request, max_force=most))
        scene, start = self._scene(observation, info), start_of(observation, self._planner.cell.robot)
        return plan_scene(self._planner, scene, self._seed, start, progress=progress, relax=relax)

    def reset(self, observation: Observation, info: Info) -> None:
        """Plan from the cloud of the first observation."""
        self._stage, self.result = None, None
        plan = self.result = self.plan(observation, info)
        self.report = plan.report()
        # Among neighbours each try shifts something, and another grasp may then be there.
        crowded = plan.neighbours is not None and self._regrasps > 0
        looks = max(self._regrasps, self._moves) if crowded else self._regrasps
        episode = Episode(
            self._planner, self._seed, self._scene, self.turns, self._regrasps, looks, self._moves
        )
        self._enter(first_stage(episode, plan, observation, info))

    def act(self, observation: Observation) -> Single:
        """Return the next set-points."""
        if self._stage is None:
            raise InputError("this agent has no plan: reset() says why in report.failure")
        stage = self._stage.next(observation)
        if stage is not self._stage:
            self._enter(stage)
        return stage.act(observation)

    def _enter(self, stage: Stage | None) -> None:
        """Change to a stage, and report what was planned on the way."""
        self._stage, report = stage, self.report
        if stage is None or stage.news is None:
            return
        plan, seconds, again, as_seen, details = stage.news
        report.details |= details
        if report.failure:  # the first grasp is still to be found
            report.planning_seconds = plan.planning_seconds = (report.planning_seconds or 0.0) + seconds
            report.again = again and not plan.found
            if plan.found:
                report.failure, self.result = None, plan if as_seen else None

    def _scene(self, observation: Observation, info: Info) -> Scene:
        return Scene.of_observation(observation, info)


class AloneAgent(BilevelAgent):
    """`bilevel` without what stands around the object, an ablation: what knowing of neighbours is worth."""

    def _scene(self, observation: Observation, info: Info) -> Scene:
        return replace(super()._scene(observation, info), neighbours=(), rest=ObjectCloud())
