"""`dexgrasp report`: tables and plots from evaluations."""

from dexgrasp.cli.command import Answer, Argument, Command, Folder
from dexgrasp.cli.output import note


class Report(Command):
    """Write report.html (one page that needs no other file) and report.md from `dexgrasp evaluate`.

    examples:
      dexgrasp report runs/tables                    markdown on stdout; report.html, report.md and plots in the folder
      dexgrasp report runs/a runs/b --out report     several evaluations in one report
    The paper's Tables 1-3 stand beside ours, and 4-6 where the agents report certificates and times.

    Attributes:
        folders: the --out of an evaluation.
        out: where report.html, report.md and the plots go (default: the first DIR).
    """

    folders: Argument[tuple[Folder, ...]]
    out: Folder | None = None

    def run(self) -> Answer:
        """Write the report and return its markdown."""
        from dexgrasp.evaluation.report.build import read_agents, write_report

        out = self.out or self.folders[0]
        text = write_report(self.folders, out)
        note(f"report and plots are in {out}")
        content = {
            "report": out / "report.md",
            "html": out / "report.html",
            "agents": read_agents(self.folders),
        }
        return Answer(content, text.rstrip("\n"))
