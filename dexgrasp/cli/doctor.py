"""`dexgrasp doctor`: what works on this machine, and whether a mesh is fit to use."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated

from dexgrasp.cli.command import Answer, Argument, Command, Scale
from dexgrasp.cli.output import coloured, note
from dexgrasp.runs.versions import package_version
from dexgrasp_env.cores import usable_cores
from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import NO_WHEEL, remedy
from dexgrasp_env.findings import Finding

_OPTIONAL = {
    "torch": "the learned agents and training",
    "stable-baselines3": "checkpoints and reinforcement learning",
}
_RENDER = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><light pos='0 0 3'/><geom size='1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 32, 32) as renderer:
    renderer.update_scene(data)
    assert renderer.render().max() > 0, "the picture is black"
"""


class Doctor(Command):
    """Check versions, rendering, threads and the cache; check meshes and say what to do about them.

    examples:
      dexgrasp doctor                                    this machine
      dexgrasp doctor scan.stl other.obj                 and two meshes
      dexgrasp doctor part.stl --mesh-scale 0.001        a mesh in millimetres

    exit codes: 0 all is well; 1 something has to be mended (the remedy is printed)

    Attributes:
        meshes: obj, stl, ply, glb, gltf, off, dae or 3mf files.
        mesh_scale: factor to metres.
    """

    meshes: Argument[Annotated[tuple[Path, ...], "MESH"]] = ()
    mesh_scale: Annotated[Scale, {"of": "meshes"}] = 1.0

    def run(self) -> Answer:
        """Check; exit code 1 if one of the findings is an error."""
        from dexgrasp_env.objects.user_mesh import describe_mesh

        for mesh in self.meshes:
            if not mesh.is_file():
                raise InputError(f"mesh file {str(mesh)!r} does not exist")
        note("checking this machine")
        found = {
            "versions": check_versions(), "rendering": check_rendering(),
            "machine": check_machine(),
        }  # fmt: skip
        for mesh in self.meshes:
            note(f"checking {mesh} (a first look can take a minute)")
            found[str(mesh)] = describe_mesh(mesh, scale=self.mesh_scale)
        wrong = any(finding.level == "error" for part in found.values() for finding in part)
        lines = [line for part, findings in found.items() for line in (part, *map(finding_line, findings))]
        return Answer({"ok": not wrong, "findings": found}, lines, wrong)


def finding_line(finding: Finding) -> str:
    """Return a finding as a line: its level, the problem and the remedy."""
    marks = {"info": ("ok   ", "good"), "warning": ("look ", "look"), "error": ("WRONG", "bad")}
    remedy = f" -> {finding.remedy}" if finding.remedy not in ("", "nothing to do") else ""
    return f"  {coloured(*marks[finding.level])} {finding.problem}{remedy}"


def check_versions() -> list[Finding]:
    """Check the versions of Python and of the packages."""
    needed = ("dexgrasp", "numpy", "scipy", "mujoco", "gymnasium", "numba", "trimesh", "manifold3d")
    return [
        Finding("info", f"python {'.'.join(map(str, sys.version_info[:3]))}"),
        *map(_judged, (*needed, *_OPTIONAL)),
        *(
            Finding("info", f"the extra {extra} is not whole", remedy(extra))
            for extra, (first, _) in NO_WHEEL.items()
            if sys.version_info >= first
        ),
    ]


def _judged(package: str) -> Finding:
    found = package_version(package)
    if found is None:
        if package in _OPTIONAL:
            return Finding("info", f"no {package}", f"{_OPTIONAL[package]} need it: {remedy('learning')}")
        return Finding("error", f"{package} is not installed", f"pip install {package}")
    if package == "mujoco" and int(found.split(".")[0]) >= 4:
        problem = f"mujoco {found}: 4.0 breaks dm-control 1.0.50 and solves sparse systems wrongly"
        return Finding("error", problem, "pip install 'mujoco>=3.17,<4'")
    return Finding("info", f"{package} {found}")


def check_rendering() -> list[Finding]:
    """Render a picture with every backend, each in its own process, which a bad driver may crash."""
    faults = {backend: _renders(backend) for backend in ("egl", "osmesa", "glfw")}
    working = [backend for backend, why in faults.items() if not why]
    unneeded = "cannot be used here, and need not" if working else ""
    findings = [
        Finding("info", f"{backend}: {(unneeded or why) if why else 'works'}")
        for backend, why in faults.items()
    ]
    if not working:
        remedy = (
            "for pictures and videos install libosmesa6, or libegl1 with libgl1; everything else runs without"
        )
        return [*findings, Finding("warning", "no off-screen rendering", remedy)]
    from dexgrasp_env.rendering import wished_gl  # imports mujoco, which may be what is missing

    if (wish := wished_gl()) and wish not in working:
        remedy = f"unset it, or set it to {working[0]}"
        findings.append(Finding("error", f"MUJOCO_GL={wish} draws nothing", remedy))
    return findings


def _renders(backend: str) -> str:
    """Return the fault of a rendering backend; empty if it works."""
    with tempfile.TemporaryDirectory() as folder:  # MuJoCo logs into the current folder
        command, surroundings = (
            [sys.executable, "-c", _RENDER],
            {"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend},
        )
        try:
            done = subprocess.run(
                command, cwd=folder, env=os.environ | surroundings, capture_output=True, text=True, timeout=60
            )
        except subprocess.TimeoutExpired:
            return "does not answer"
    if done.returncode == 0:
        return ""
    last = (done.stderr.strip().splitlines() or [""])[-1][:100]
    return f"crashes (signal {-done.returncode})" if done.returncode < 0 else f"does not work ({last})"


def check_machine() -> list[Finding]:
    """Check processors, thread settings, the cache and compiled code."""
    limits = [
        f"{key}={os.environ[key]}" for key in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS") if os.environ.get(key)
    ]
    return [
        Finding("info", f"{usable_cores()} processors" + (f" ({', '.join(limits)})" if limits else "")),
        _check_cache(),
        _check_code(),
    ]


def _check_cache() -> Finding:
    from dexgrasp_env.files import cache_dir, write_atomically

    folder = cache_dir()
    try:
        write_atomically(folder / "doctor", b"")
        (folder / "doctor").unlink()
    except OSError as error:
        problem = f"the cache {str(folder)!r} cannot be written: {error.strerror}"
        return Finding(
            "warning", problem, "set DEXGRASP_CACHE to a writable folder; all works without, slower"
        )
    return Finding("info", f"cache {folder} can be written")


def _check_code() -> Finding:
    from dexgrasp_env.compiled import code_folder

    folder = code_folder()
    if folder is None:
        problem = "compiled code is kept nowhere, as neither its own folder nor a cache can be written"
        return Finding(
            "warning", problem, "set NUMBA_CACHE_DIR to a writable folder: each process compiles anew"
        )
    beside = "beside the code" if folder.name == "__pycache__" else "where it can be written"
    return Finding("info", f"compiled code is kept in {folder} ({beside})")
