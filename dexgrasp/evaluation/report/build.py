"""The report of one or more evaluations: one HTML page, and markdown with plots."""

import base64
import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from dexgrasp.evaluation.pooling import rows_by_agent
from dexgrasp.evaluation.protocol import DEFAULT_PROTOCOL
from dexgrasp.evaluation.report import figures, tables
from dexgrasp.evaluation.report.origin import commands, describe_run, replay_commands
from dexgrasp.evaluation.store import read_rows
from dexgrasp.evaluation.summary import summarise_agent
from dexgrasp_env.arrays import Fields
from dexgrasp_env.files import write_atomically


def read_agents(folders: Sequence[Path]) -> Fields:
    """Return the summary of each agent from the trials of all folders, pooled over seeds.

    Raises:
        InputError: if a folder holds no evaluation.
    """
    return {name: summarise_agent(own) for name, own in rows_by_agent(folders).items()}


def write_report(folders: Sequence[Path], out: Path) -> str:
    """Write report.html, report.md and its plots to `out`, and return the markdown.

    Raises:
        InputError: if a folder holds no evaluation.
    """
    content = contents(folders)
    text = render_report("markdown", content)
    for figure in chain(*content["figures"].values()):
        write_atomically(out / f"{figure.name}.png", figure.draw("png"))
    for name, page in (("report.html", render_report("html", content)), ("report.md", text)):
        # Names from files of others may hold what UTF-8 cannot.
        write_atomically(out / name, page.encode(errors="backslashreplace"))
    return text


def render_report(form: str, content: Fields) -> str:
    """Return a report as "html", one page with its plots in it, or "markdown"."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    env = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"), autoescape=form == "html",
        trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined,
    )  # fmt: skip
    env.filters["base64"] = lambda data: base64.b64encode(data).decode()
    page = env.get_template("report.j2").render(content, form=env.get_template(f"{form}.j2"))
    return re.sub(r"\n{3,}", "\n\n", page.strip()) + "\n"


def contents(folders: Sequence[Path]) -> Fields:
    """Return the variables of templates/report.j2."""
    rows = rows_by_agent(folders)
    agents = {name: summarise_agent(own) for name, own in rows.items()}
    met = list(dict.fromkeys(row["protocol"] for own in rows.values() for row in own))
    # Of several protocols the plain lift is the one that the paper's figures are of; others would be averaged into it.
    only = DEFAULT_PROTOCOL if len(met) > 1 and DEFAULT_PROTOCOL in met else None
    lifts = {name: [row for row in own if only in (None, row["protocol"])] for name, own in rows.items()}
    plain = {name: summarise_agent(own) for name, own in lifts.items() if own}
    counted = list(dict.fromkeys(p for agent in agents.values() for p in agent["by_protocol"]))
    return {
        "title": "Evaluation of grasping agents",
        "runs": [describe_run(folder) for folder in folders],
        "where": f" (protocol {only})" if only else "",
        "by_set": tables.set_table(plain),
        "by_protocol": tables.protocol_table(agents, counted),
        "clutter": tables.clutter_table(agents),
        "by_object": tables.object_tables(plain),
        "paired": tables.paired_table(rows),
        "failures": tables.failure_table(agents),
        "constraints": [
            table for name, agent in agents.items() for table in tables.constraint_tables(name, agent)
        ],
        "figures": {
            "set": [figures.success("by_set", "set of objects", plain, ["all", *tables.present(plain)])],
            "protocol": [figures.success("by_protocol", "protocol", agents, counted)]
            if len(counted) > 1
            else [],
            "object": [figures.success("by_object", "object", plain, tables.ordered_objects(plain))],
            "times": figures.planning_times(agents),
        },
        "commands": [line for folder in folders for line in commands(folder)],
        "replays": [line for folder in folders for line in replay_commands(folder, read_rows(folder))],
    }
