"""`dexgrasp completion`: what a shell needs to complete commands, options and names."""

import argparse

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
    from agents.cli.commands import make_parser
    from dexgrasp_env.extras import require_extra

    require_extra("planner", "completion")
    import shtab

    parser = make_parser()
    functions = {kind: {"bash": f"_dexgrasp_{kind}", "zsh": f"_dexgrasp_{kind}"} for kind in _names()}
    for action in _actions(parser):
        kind = _kind(action)
        if kind in functions:
            action.complete = functions[kind]  # type: ignore[attr-defined]  (read by shtab)
        elif kind == "folder":
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
        elif kind == "file":
            action.complete = shtab.FILE  # type: ignore[attr-defined]
    return str(shtab.complete(parser, shell=shell, preamble=_preamble()))


def _actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Every option and argument of a parser and of its commands."""
    found = []
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
    from agents.evaluation.protocol import protocol_names
    from agents.registry import AGENTS
    from dexgrasp_env.objects.catalogue import CATALOGUE, OBJECT_SETS

    return {"object": [*OBJECT_SETS, *CATALOGUE], "agent": list(AGENTS), "protocol": protocol_names()}


def _preamble() -> dict[str, str]:
    """Functions that offer our names, and files besides: a mesh, a set or a checkpoint does as well."""
    bash, zsh = [], []
    for kind, names in _names().items():
        words = " ".join(names)
        files = "" if kind == "protocol" else " -f"
        bash.append(f'_dexgrasp_{kind}() {{ compgen{files} -W "{words}" -- "$1"; }}')
        more = "" if kind == "protocol" else "; _files"
        zsh.append(f"_dexgrasp_{kind}() {{ compadd {words}{more} }}")
    return {"bash": "\n".join(bash), "zsh": "\n".join(zsh)}
