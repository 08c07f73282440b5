"""`dexgrasp compare`: two agents of an evaluation, scene by scene."""

from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, Command, Folder


class Compare(Command):
    """Compare two agents scene by scene: what one alone solves, the difference, its interval and test.

    examples:
      dexgrasp evaluate --agents bilevel hardcoded --objects all20 --trials 6 --out runs/tables
      dexgrasp compare runs/tables bilevel hardcoded
      dexgrasp compare runs/seed_0 runs/seed_1 bilevel hardcoded
      dexgrasp compare runs/gap runs/ppo runs/ppo --protocols lift lift@warp

    Differences are in points of a hundred, with Newcombe's interval for paired rates, once with the scene and once with
    the object as the unit; p is the level at which the interval ends at 0.

    Attributes:
        folders: the --out of evaluations.
        a: an agent of these.
        b: another one.
        protocols: one for each, so that an agent is compared with itself elsewhere (default: all that both met).
    """

    folders: Argument[Annotated[tuple[Folder, ...], "RUN"]]
    a: Argument[str]
    b: Argument[str]
    protocols: Annotated[tuple[str, ...], "PROTOCOL"] = ()

    def run(self) -> Answer:
        """Compare."""
        from dexgrasp.evaluation.comparison import compare_agents, render_comparison

        content = compare_agents(self.folders, self.a, self.b, self.protocols)
        return Answer(content, render_comparison(content))
