"""Settings of the planner, and the problem that every step of planning takes: object, robot and settings."""

from dataclasses import dataclass, replace
from functools import cached_property

from dexgrasp.geometry.convex_parts import MOST_PARTS
from dexgrasp.geometry.request import GraspRequest
from dexgrasp.geometry.target import GraspTarget
from dexgrasp.grasp.thresholds import FROZEN, Thresholds, frozen_for, planned_friction
from dexgrasp.mechanics.contact_models import ContactModel, contact_model
from dexgrasp.mechanics.contacts import Shape, shape_of
from dexgrasp.mechanics.kinematics.tree import RobotTree, robot_tree
from dexgrasp.mechanics.kinematics.world import World, make_world
from dexgrasp_env.errors import InputError
from dexgrasp_env.robot.cell import Cell
from dexgrasp_env.robot.robot import Hand


@dataclass(frozen=True)
class PlannerSettings(Thresholds):
    """Limits of every grasp, and budgets of the search; lengths in m, angles in rad.

    Attributes:
        closure_aim: margin that the optimiser works towards first.
        surface_points: samples of the surface that triples are made of.
        table_clearance: proposed contacts are at least this high above the table.
        triples: triples that are turned into hand postures.
        neighbours: postures of the hand's atlas looked at for each.
        postures: postures tried by the optimiser before the planner gives up.
        candidates: feasible configurations among which the firmest is carried out.
        patience: rounds more, among neighbours 3 at most, which follow only where none before gave a firm grasp.
        rises: of the tips as the hand opens, m; those after the first only for grasps not firm.
        most_parts: convex parts of an object's cloud that are planned on; 1: its hull.
        initial_orientations: starting postures a proposal (six in section 3.3).
        iterations: steps of the SQP, for one posture.
        seconds: time after which no further posture is tried; None: results do not depend on the machine.
        max_force: N that each finger presses with at most; None: as the joints allow.
        loads: levels that the dataset sorts grasps by, firmest first: share of the assumed mass, push borne, weights.
        friction_squeeze: coefficient that the squeeze is made for, and grasps are ranked by.
        fingers: of a grasp, as the hand has them.
        torsion: radius of their soft tips, m; 0: points.
        widest: m between contacts that two fingers open beyond.
        firm_load: load under `friction_squeeze` with which the search ends.
    """

    closure_aim: float = 0.50
    surface_points: int = 96
    table_clearance: float = 0.015
    triples: int = 40
    neighbours: int = 64
    postures: int = 60
    candidates: int = 4
    patience: int = 4
    rises: tuple[float, ...] = (0.0, 0.006)
    most_parts: int = MOST_PARTS
    initial_orientations: int = 6
    iterations: int = 40
    seconds: float | None = None
    max_force: float | None = None
    loads: tuple[tuple[float, float], ...] = ((1.0, 1.2), (1.0, 0.8), (1.0, 0.5), (1.0, 0.2), (0.6, 0.0))
    friction_squeeze: float = 0.42
    firm_load: float = 1.2
    fingers: int = 3
    torsion: float = 0.0
    widest: float = 1.0

    def asked(self, request: GraspRequest) -> "PlannerSettings":
        """Return settings for what a request says: friction with the usual reserve, force, seconds.

        Raises:
            InputError: for less force than fingers press with at least.
        """
        most = request.max_force
        if most is not None and most <= self.least_press:
            raise InputError(
                f"max_force is {most:g} N, and fingers press with {self.least_press:g} N at least: valid is more"
            )
        friction, hold = self.friction, self.friction_hold
        if request.friction is not None:
            friction, hold = planned_friction(request.friction)
        seconds = request.seconds or self.seconds
        return replace(self, friction=friction, friction_hold=hold, max_force=most, seconds=seconds)

    def for_hand(self, hand: Hand) -> "PlannerSettings":
        """Return settings for the tips of a hand."""
        ours = frozen_for(hand)
        of_hand = ("distance", "least_press")  # unless they are asked for
        own = {name: getattr(ours, name) for name in of_hand if getattr(self, name) == getattr(FROZEN, name)}
        return replace(self, tip_radius=hand.tip_radius, fingers=len(hand.grasp), torsion=hand.torsion, **own)

    @property
    def model(self) -> ContactModel:
        """Contact model of the fingertips."""
        return contact_model(self.torsion)

    @property
    def proposed(self) -> Shape:
        """Of the contacts that are proposed: two or three; further fingers follow these."""
        return shape_of(min(self.fingers, 3), self.model)

    @property
    def tip_height(self) -> float:
        """Height of a tip's centre above the surface that it touches, m: the middle of what `distance` allows."""
        return self.tip_radius + 0.5 * sum(self.distance)

    def broadened(self, factor: int) -> "PlannerSettings":
        """Return settings that sample `factor` times as many points, and triples and postures to match."""
        return replace(
            self,
            surface_points=factor * self.surface_points,
            triples=factor**2 * self.triples,
            postures=factor * self.postures,
        )


@dataclass(frozen=True, eq=False)
class GraspProblem:
    """An object to be grasped by a robot within limits.

    Attributes:
        target: the object.
        cell: of the robot.
        settings: the limits.
    """

    target: GraspTarget
    cell: Cell
    settings: PlannerSettings

    @cached_property
    def tree(self) -> RobotTree:
        """Kinematics of the robot."""
        return robot_tree(self.cell)

    @property
    def shape(self) -> Shape:
        """Shape of the contacts that the grasping fingers make."""
        return shape_of(len(self.tree.tip_body), self.tree.model)

    @cached_property
    def world(self) -> World:
        """The robot's shapes, the object, which the tips may touch, and what stands around it, which nothing may."""
        return make_world(self.cell.seeing(None), self.target.distance, self.target.around)
