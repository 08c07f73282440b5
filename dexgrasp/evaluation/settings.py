"""Settings of an evaluation, its identity, and the trials that it consists of."""

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import dexgrasp_env
from dexgrasp.evaluation.protocol import DEFAULT_PROTOCOL, TrialSeeds, get_protocol, parts
from dexgrasp.evaluation.store import Key
from dexgrasp.evaluation.video import VideoSettings
from dexgrasp.registry import agent_files, is_server, server_identity
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.arrays import Fields
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import check_file, content_hash, expand, file_hash, jsonable, readable
from dexgrasp_env.objects.catalogue import CATALOGUE
from dexgrasp_env.objects.load import Objects, object_name, target_files
from dexgrasp_env.robot.cell import make_cell
from dexgrasp_env.valid import (
    NAMED,
    TEXT,
    CellFile,
    Count,
    Friction,
    Mass,
    Mount,
    Natural,
    Positive,
    Rule,
    read,
    refuse_idle,
)

_OF_CHECKPOINTS = {"env_kwargs": r"lerobot:.*|.*\.zip", "wrappers": r".*\.zip"}
"""Setting of `EvaluationSettings` -> checkpoints that it applies to."""


def _unique(names: Iterable[str]) -> tuple[str, ...]:
    found = () if isinstance(names, str) else tuple(dict.fromkeys(map(NAMED.validate, names)))
    if not found:
        raise ValueError
    return found


def _protocols(names: Iterable[str]) -> tuple[str, ...]:
    found = _unique(names)
    for name in found:
        parts(name)
    return found


@dataclass(frozen=True)
class EvaluationSettings:
    """Settings that the outcome depends on.

    Attributes:
        agents: names (dexgrasp list agents), checkpoints, package.module:Class, or ws://HOST:PORT of a policy server.
        objects: objects, sets (dexgrasp list objects), or mesh files.
        trials: of each agent on each object.
        seed: of all scenes and of the agents.
        protocols: how to score, see dexgrasp list protocols; every agent meets every scene under each.
        robot: file of your cell (robot, table, mounts, limits, gains, torques and cameras), or of a robot alone
            (default: the simulated cell; on the command line $DEXGRASP_CELL, where it is set).
        mount: how the hand sits on the arm's flange, see dexgrasp list envs (default: the protocol's).
        friction: sliding friction coefficient (default: the protocol's, the object's, or 0.7).
        mesh_scale: factor from a mesh file's unit to metres, 0.001 for millimetres.
        mesh_mass: mass of a mesh, kg (default: by its volume).
        env_kwargs: what checkpoints (.zip, lerobot:) were trained with where no record beside them says so: obs_mode,
            control_mode, observe, frame_skip, action_scale.
        wrappers: likewise (.zip), innermost first: Name(key=value) of gymnasium.wrappers, or module.Class(key=value)
            of your own, which runs that module.
    """

    agents: Annotated[
        tuple[str, ...], Rule("one or more names, see `dexgrasp list agents`", _unique), "AGENT"
    ]
    objects: Annotated[Objects, "OBJECT"]
    trials: Count = 3
    seed: Natural = 0
    protocols: Annotated[
        tuple[str, ...], Rule("names, see `dexgrasp list protocols`", _protocols), "--protocol", "PROTOCOL"
    ] = (DEFAULT_PROTOCOL,)
    robot: CellFile = None
    mount: Mount = None
    friction: Annotated[Friction | None, "MU"] = None
    mesh_scale: Annotated[Positive, "F"] = 1.0
    mesh_mass: Annotated[Mass | None, "KG"] = None
    env_kwargs: tuple[Annotated[str, TEXT, "KEY=VALUE"], ...] = ()
    wrappers: tuple[Annotated[str, TEXT, "WRAPPER"], ...] = ()

    def __post_init__(self) -> None:
        """Validate combinations of fields.

        Raises:
            InputError: for an unknown cell or mount, a friction beside a protocol that has its own, or settings of
                checkpoints without a checkpoint.
        """
        make_cell(self.robot, self.mount)
        own = [name for name in self.parts if "friction" in get_protocol(name).scene]
        if own and self.friction is not None:
            raise InputError(
                f"protocol {own[0]!r} has a friction of its own: leave --friction out, or take lift"
            )
        used = {key for agent in self.agents for key in self.checkpoint_settings(agent)}
        need = "a checkpoint (.zip, for env_kwargs also lerobot:) among the agents"
        refuse_idle(self, {key: (key in used, need) for key in _OF_CHECKPOINTS})

    @classmethod
    def of(cls, agents: Sequence[str], objects: Sequence[str], **rest: Any) -> "EvaluationSettings":
        """Expand sets and validate the settings; nothing is built.

        Raises:
            InputError: for no agent, an unknown object or protocol, numbers out of range.
        """
        return read(cls, {"agents": agents, "objects": objects, **rest})

    @classmethod
    def of_run(cls, run: Fields) -> "EvaluationSettings":
        """Return the settings of a run.json.

        Raises:
            InputError: if they are not valid any more.
        """
        saved = {**run, "protocols": str(run.get("protocol")).split("+")}
        return read(cls, saved, "run.json", more=True)

    def checkpoint_settings(self, agent: str) -> Fields:
        """Return the keywords of `make_agent` for a checkpoint; none for other agents."""
        return {
            key: getattr(self, key)
            for key, names in _OF_CHECKPOINTS.items()
            if getattr(self, key) and re.fullmatch(names, agent)
        }

    @property
    def protocol(self) -> str:
        """Names of the protocols, joined by +."""
        return "+".join(self.protocols)

    @property
    def parts(self) -> tuple[str, ...]:
        """Protocols that trials are run under: the named ones, groups replaced by their members."""
        return tuple(dict.fromkeys(part for name in self.protocols for part in parts(name)))

    def scene(self, protocol: str) -> Fields:
        """Settings of `gym.make` that make the scenes of a protocol."""
        given = {"robot": self.robot, "mount": self.mount, "friction": self.friction}
        return {
            **get_protocol(protocol).scene,
            **{key: value for key, value in given.items() if value is not None},
            "mesh_scale": self.mesh_scale,
            "mesh_mass": self.mesh_mass,
        }

    def identity(self, files: Iterable[str] | None = None) -> Fields:
        """Return the identity of the evaluation as JSON: settings, and hashes of cell, files, code and versions.

        Args:
            files: paths to hash, where another process has found them; None to find them here.
        """
        settings = jsonable(asdict(self))
        settings["protocol"] = "+".join(settings.pop("protocols"))
        del settings["robot"]  # the cell is its content, wherever the file lies
        servers = {name: server_identity(name) for name in self.agents if is_server(name)}
        return {
            **settings,
            **({"servers": servers} if servers else {}),
            "cell": make_cell(self.robot).version,
            "files": hashes_by_name(self._files() if files is None else map(Path, files)),
            "code": code_hash(),
            "versions": versions(),
        }

    def _files(self) -> list[Path]:
        """Return the files that outcomes depend on: meshes, checkpoints with their records, files that agents read."""
        named = [path for name in self.objects for path in target_files(name)]
        # Wrappers of the user's own are `module:Class`, as agents are.
        wrappers = (":".join(text.partition("(")[0].rsplit(".", 1)) for text in self.wrappers)
        named += [path for name in (*self.agents, *wrappers) for path in agent_files(name)]
        found = [path for path in dict.fromkeys(map(expand, named)) if path.is_file()]
        for path in found:
            if path.suffix in (".zip", ".obj", ".ply", ".stl", ".glb"):  # what users' agents read is theirs
                check_file(path)
        return found

    def default_folder(self) -> Path:
        """Return runs/<protocol>-<agents>-seed<seed>-<hash>, in which the same command finds its results again."""
        digest = content_hash(sorted(self.identity().items()))[:8]
        agents = "+".join(Path(agent).stem.replace(":", ".") for agent in self.agents)[:60]
        return Path("runs") / f"{self.protocol[:40]}-{agents}-seed{self.seed}-{digest}"


@dataclass(frozen=True)
class TrialSpec:
    """Specification of a trial.

    Attributes:
        agent: its name.
        target: the object, as `gym.make` takes it.
        label: name of the object in results.
        trial: number from 0 on.
        protocol: its name.
        video: file to record to, or None.
        film: settings of the video.
        seeds: of a replayed trial; None to derive them from the evaluation's seed.
    """

    agent: str
    target: str
    label: str
    trial: int
    protocol: str = DEFAULT_PROTOCOL
    video: Path | None = None
    film: VideoSettings = VideoSettings()
    seeds: TrialSeeds | None = None

    @property
    def key(self) -> Key:
        """Key of the trial within its evaluation."""
        return self.protocol, self.agent, self.label, self.trial


def plan_trials(settings: EvaluationSettings) -> list[TrialSpec]:
    """Return every trial of an evaluation, agent by agent, object by object, protocol by protocol."""
    labels = object_labels(settings.objects)
    return [
        TrialSpec(agent, target, labels[target], trial, protocol)
        for agent in settings.agents
        for target in settings.objects
        for protocol in settings.parts
        for trial in range(settings.trials)
    ]


def object_labels(targets: Sequence[str]) -> dict[str, str]:
    """Return the label of each object in results: name or file stem; the file's name or path where two are equal."""
    labels: dict[str, str] = {}
    for target in targets:
        label = object_name(target)
        if target not in CATALOGUE and (label in CATALOGUE or label in labels.values()):
            label = Path(target).name if Path(target).name not in labels.values() else target
        labels[target] = label
    return labels


def versions() -> dict[str, str]:
    """Return the versions of the packages that outcomes depend on."""
    return package_versions(("dexgrasp", "mujoco", "numpy", "gymnasium"))


def code_hash(more: Iterable[Path] = ()) -> str:
    """Return a hash of the sources and assets (without markdown) of both packages, and of more files."""
    library = Path(__file__).parents[1]
    roots = (library, library / "agents", Path(dexgrasp_env.__file__).parent)
    files = sorted({path.resolve() for root in roots for path in root.rglob("*.py")})
    digest = hashlib.sha256()
    assets = sorted(path for path in asset_path().rglob("*") if path.is_file() and path.suffix != ".md")
    for path in (*files, *assets, *more):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def short_hash(path: Path) -> str:
    """Return the first 16 digits of the SHA-256 of a file.

    Raises:
        InputError: if it cannot be read.
    """
    with readable(path):
        return file_hash(path)[:16]


def hashes_by_name(paths: Iterable[Path]) -> dict[str, str]:
    """Return the hashes of files by their paths, relative to the current folder where they are below it."""
    here = Path.cwd()
    names = ((path.relative_to(here) if path.is_relative_to(here) else path, path) for path in paths)
    return {str(name): short_hash(path) for name, path in names}
