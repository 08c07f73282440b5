"""`dexgrasp warmup`: compile all that plans and environments need, for container images or before a demonstration."""

from dexgrasp.cli.command import Answer, CellOptions, Command


class Warmup(Command, CellOptions):
    """Compile what plans and environments need; the first run does it otherwise.

    examples:
      dexgrasp warmup                                    all that plans and environments call
      dexgrasp warmup --robot my_cell.yaml               and what each grasp of the hand of this robot needs

    Where what is compiled is kept: in __pycache__ beside the code, or in NUMBA_CACHE_DIR; where that cannot be
    written in DEXGRASP_CACHE, as postures always. In an image for another machine the processor has to be of the same
    kind.
    """

    def run(self) -> Answer:
        """Compile what is not cached yet."""
        from dexgrasp.planning.planner import compile_ahead
        from dexgrasp.planning.rehearsal import rehearse
        from dexgrasp.runs.compiling import compiling

        with compiling("warmup"):
            rehearse()
        for fingers in ((), *self.cell.robot.hand.grasps):
            compile_ahead(self.cell.grasping(fingers))
        return Answer({"ready": True}, "everything that plans and environments need is compiled")
