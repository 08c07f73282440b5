"""`dexgrasp completion`: what a shell needs to complete commands, options and names."""

import argparse
from collections.abc import Iterator
from typing import Annotated, Any

from dexgrasp.cli.command import Answer, Argument, Command
from dexgrasp_env.valid import one_of

_KINDS = {
    "AGENT": "agent", "OBJECT": "object", "TARGET": "object", "PROTOCOL": "protocol",
    "MOUNT": "mount", "CAMERA": "camera", "DIR": "folder", "RUN": "folder",
    "FILE": "file", "MESH": "file", "GRASP.json": "file", "CELL.yaml": "file",
}  # fmt: skip
"""What the value of an option is called -> what it is."""


class Completion(Command):
    """Print a completion script for a shell.

    examples:
      dexgrasp completion bash > ~/.local/share/bash-completion/completions/dexgrasp
      dexgrasp completion zsh > ~/.zsh/functions/_dexgrasp        a folder of $fpath

    Write it again after an update: commands, options, objects, agents and protocols are those of this version.

    Attributes:
        shell: which shell.
    """

    shell: Argument[Annotated[str, one_of(("bash", "zsh"))]]

    def run(self) -> Answer:
        """Make the script."""
        script = completion_script(self.shell)
        return Answer({"script": script}, script)


def completion_script(shell: str) -> str:
    """Return the script of a shell for every command.

    Raises:
        InputError: where shtab is not installed.
    """
    from dexgrasp.cli.commands import COMMANDS, make_parser
    from dexgrasp_env.extras import require_extra

    require_extra("planner", "completion")
    import shtab

    parser, functions = make_parser(*COMMANDS), list[str]()
    known = {"folder": shtab.DIRECTORY, "file": shtab.FILE}
    for own, names in _names().items():
        known[own] = dict.fromkeys(("bash", "zsh"), f"_dexgrasp_{own}")
        words, only = " ".join(names), own not in ("object", "agent")
        if shell == "bash":
            functions.append(f'_dexgrasp_{own}() {{ compgen{"" if only else " -f"} -W "{words}" -- "$1"; }}')
        else:
            functions.append(f"_dexgrasp_{own}() {{ compadd {words}{'' if only else '; _files'} }}")
    for action in _actions(parser):
        if kind := _KINDS.get(str(action.metavar).partition("|")[0]):
            action.complete = known[kind]
    return shtab.complete(parser, shell=shell, preamble="\n".join(functions))


def _actions(parser: argparse.ArgumentParser) -> Iterator[Any]:
    """Yield every option and argument of a parser and of its commands, to which shtab wants `complete` added."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for within in action.choices.values():
                yield from _actions(within)
        else:
            yield action


def _names() -> dict[str, list[str]]:
    """Our names by kind; where a mesh, a set or a checkpoint does as well, files are offered besides."""
    from dexgrasp.evaluation.protocol import protocol_names
    from dexgrasp.registry import AGENTS
    from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS
    from dexgrasp_env.robot.cell import default_cell

    cell = default_cell()
    return {
        "object": [*OBJECT_SETS, *CATALOGUE], "agent": list(AGENTS), "protocol": protocol_names(),
        "mount": list(cell.mounts), "camera": ["grasp", "front", *cell.camera_names],
    }  # fmt: skip


COMMAND = Completion
