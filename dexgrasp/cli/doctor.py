"""`dexgrasp doctor`: what works on this machine, and whether a mesh is fit to use."""

from pathlib import Path
from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, Command
from dexgrasp.cli.output import coloured, note
from dexgrasp_env.errors import InputError
from dexgrasp_env.findings import Finding
from dexgrasp_env.valid import Positive

_MARKS = {"info": ("ok   ", "good"), "warning": ("look ", "look"), "error": ("WRONG", "bad")}


class Doctor(Command):
    """Check versions, rendering, threads and the cache; check meshes and say what to do about them.

    examples:
      dexgrasp doctor                                    this machine
      dexgrasp doctor scan.stl other.obj                 and two meshes
      dexgrasp doctor part.stl --mesh-scale 0.001        a mesh in millimetres

    exit codes: 0 all is well; 1 something has to be mended (the remedy is printed)

    Attributes:
        meshes: obj, stl, ply or glb files.
        mesh_scale: factor to metres.
    """

    meshes: Argument[Annotated[tuple[Path, ...], "MESH"]] = ()
    mesh_scale: Annotated[Positive, "F"] = 1.0

    def run(self) -> Answer:
        """Look; 1 if one of the findings is an error."""
        from dexgrasp.cli import checks
        from dexgrasp_env.objects.user_mesh import describe_mesh

        for mesh in self.meshes:
            if not mesh.is_file():
                raise InputError(f"mesh file {str(mesh)!r} does not exist")
        note("checking this machine")
        found = {
            "versions": checks.check_versions(), "rendering": checks.check_rendering(),
            "machine": checks.check_machine(),
        }  # fmt: skip
        for mesh in self.meshes:
            note(f"checking {mesh} (a first look can take a minute)")
            found[str(mesh)] = describe_mesh(mesh, scale=self.mesh_scale)
        wrong = any(finding.level == "error" for part in found.values() for finding in part)
        text = "\n".join("\n".join([part, *map(finding_line, findings)]) for part, findings in found.items())
        return Answer({"ok": not wrong, "findings": found}, text, int(wrong))


def finding_line(finding: Finding) -> str:
    """Return what is printed of a finding: its mark, what is the matter, and what to do about it."""
    remedy = f" -> {finding.remedy}" if finding.remedy not in ("", "nothing to do") else ""
    return f"  {coloured(*_MARKS[finding.level])} {finding.problem}{remedy}"


COMMAND = Doctor
