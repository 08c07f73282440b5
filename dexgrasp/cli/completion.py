"""`dexgrasp completion`: what a shell needs to complete commands, options and names."""

import argparse
from typing import Any

_EPILOG = """examples:
  dexgrasp completion bash > ~/.local/share/bash-completion/completions/dexgrasp
  dexgrasp completion zsh > ~/.zsh/functions/_dexgrasp        a folder of $fpath

Write it again after an update: commands, options, objects, agents and protocols are those of this version."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "completion", help="a script that completes commands in bash or zsh", epilog=_EPILOG,
        description="Print a completion script for a shell.",
    )  # fmt: skip
    parser.add_argument("shell", choices=("bash", "zsh"), help="which shell")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    print(completion_script(args.shell))
    return 0


def completion_script(shell: str) -> str:
    """Return the script of a shell for every command.

    Raises:
        InputError: where shtab is not installed.
    """
    from dexgrasp.cli.commands import make_parser
    from dexgrasp_env.extras import require_extra

    require_extra("planner", "completion")
    import shtab

    parser = make_parser()
    for action in _actions(parser):
        kind = _kind(action)
        if kind in ("folder", "file"):
            action.complete = shtab.DIRECTORY if kind == "folder" else shtab.FILE
        elif kind:
            action.complete = {"bash": f"_dexgrasp_{kind}", "zsh": f"_dexgrasp_{kind}"}
    return str(shtab.complete(parser, shell=shell, preamble=_functions(shell)))


def _actions(parser: argparse.ArgumentParser) -> list[Any]:
    """Every option and argument of a parser and of its commands, to which shtab wants `complete` added."""
    found: list[Any] = []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            found += [inner for sub in action.choices.values() for inner in _actions(sub)]
        else:
            found.append(action)
    return found


def _kind(action: argparse.Action) -> str:
    """What an argument is a name of; nothing that can be completed for numbers and choices."""
    kinds = {"agents": "agent", "agent": "agent", "objects": "object", "object": "object", "target": "object",
             "protocol": "protocol"}  # fmt: skip
    shown = str(action.metavar or "")
    if action.choices is not None:
        return ""
    if action.dest in kinds:
        return kinds[action.dest]
    return (
        "folder"
        if shown in ("DIR", "RUN")
        else "file"
        if any(w in shown for w in ("FILE", "JSON", "MESH"))
        else ""
    )


def _names() -> dict[str, list[str]]:
    from dexgrasp.evaluation.protocol import protocol_names
    from dexgrasp.registry import AGENTS
    from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS

    return {"object": [*OBJECT_SETS, *CATALOGUE], "agent": list(AGENTS), "protocol": protocol_names()}


def _functions(shell: str) -> str:
    """Functions that offer our names, and files besides: a mesh, a set or a checkpoint does as well."""
    lines = []
    for kind, names in _names().items():
        words, only = " ".join(names), kind == "protocol"
        if shell == "bash":
            lines.append(f'_dexgrasp_{kind}() {{ compgen{"" if only else " -f"} -W "{words}" -- "$1"; }}')
        else:
            lines.append(f"_dexgrasp_{kind}() {{ compadd {words}{'' if only else '; _files'} }}")
    return "\n".join(lines)
