"""What an evaluation is of: agents, objects, trials, seed and scene; a changed setting is another evaluation."""

import dataclasses
import hashlib
import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dexgrasp.evaluation.protocol import DEFAULT_PROTOCOL, get_protocol, parts
from dexgrasp.registry import agent_files, agent_source
from dexgrasp.runs.versions import package_versions
from dexgrasp_env.assets import asset_path
from dexgrasp_env.errors import InputError
from dexgrasp_env.files import expand
from dexgrasp_env.objects.load import target_files
from dexgrasp_env.robot.cell import make_cell

_PACKAGES = ("dexgrasp", "mujoco", "numpy", "gymnasium")


@dataclass(frozen=True)
class EvaluationSettings:
    """Everything that the outcome depends on.

    Attributes:
        agents: names, checkpoints or `package.module:Class`.
        objects: names of the catalogue and paths of meshes, sets expanded.
        trials: of each agent on each object.
        seed: of the scenes and of the agents.
        protocols: names of protocols; every agent meets every scene under each.
        robot: path of a cell's or a robot's file; None for the simulated cell.
        mount: how the hand sits on the flange; None for the protocol's.
        friction: sliding friction coefficient; None for the protocol's.
        mesh_scale: factor to metres, of meshes alone.
        mesh_mass: kg, of meshes alone; None for their own.
    """

    agents: tuple[str, ...]
    objects: tuple[str, ...]
    trials: int = 1
    seed: int = 0
    protocols: tuple[str, ...] = (DEFAULT_PROTOCOL,)
    robot: str | None = None
    mount: str | None = None
    friction: float | None = None
    mesh_scale: float = 1.0
    mesh_mass: float | None = None

    @classmethod
    def of(cls, agents: Sequence[str], objects: Sequence[str], **rest: Any) -> "EvaluationSettings":
        """Expand sets and check what can be checked without building anything.

        Raises:
            InputError: for no agent, an unknown object or protocol, numbers out of range.
        """
        from dexgrasp_env.objects.load import resolve_targets

        settings = cls(tuple(dict.fromkeys(agents)), tuple(resolve_targets(list(objects))), **rest)
        if not settings.agents:
            raise InputError("no agents given: see `dexgrasp list agents`")
        if settings.trials < 1 or settings.seed < 0:
            raise InputError(
                f"trials = {settings.trials}, seed = {settings.seed}: valid are trials >= 1 and seed >= 0"
            )
        own = [name for name in settings.parts if "friction" in get_protocol(name).scene]
        if own and settings.friction is not None:
            raise InputError(
                f"protocol {own[0]!r} has a friction of its own: leave --friction out, or take lift"
            )
        return dataclasses.replace(settings, protocols=tuple(dict.fromkeys(settings.protocols)))

    @classmethod
    def of_run(cls, run: Mapping[str, Any]) -> "EvaluationSettings":
        """Return the settings that a run.json says.

        Raises:
            InputError: if it says none that are usable now.
        """
        kept = {
            field.name: run[field.name]
            for field in dataclasses.fields(cls)
            if field.name in run and field.name not in ("agents", "objects", "protocols")
        }
        try:
            names = [[str(name) for name in run[key]] for key in ("agents", "objects")]
            return cls.of(*names, protocols=tuple(str(run["protocol"]).split("+")), **kept)
        except InputError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"run.json holds no settings of an evaluation ({error!r})") from None

    @property
    def protocol(self) -> str:
        """The protocols' names in one."""
        return "+".join(self.protocols)

    @property
    def parts(self) -> tuple[str, ...]:
        """The protocols that trials are run under: the named ones, or what they are made of."""
        return tuple(dict.fromkeys(part for name in self.protocols for part in parts(name)))

    def scene(self, protocol: str) -> dict[str, Any]:
        """Settings of `gym.make` that make the scenes of a protocol."""
        given = {"robot": self.robot, "mount": self.mount, "friction": self.friction}
        chosen = {key: value for key, value in given.items() if value is not None}
        return {
            **get_protocol(protocol).scene,
            **chosen,
            "mesh_scale": self.mesh_scale,
            "mesh_mass": self.mesh_mass,
        }

    def identity(self) -> dict[str, Any]:
        """Return the settings with the versions and contents they rest on, as JSON can hold them."""
        settings = {
            key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()
        }
        settings["protocol"] = "+".join(settings.pop("protocols"))
        return settings | {
            "cell": make_cell(self.robot).version,
            "files": {str(path): _file_hash(path) for path in self._files()},
            "code": code_hash(self.agents),
            "versions": versions(),
        }

    def _files(self) -> list[Path]:
        """Return the files that outcomes rest on: meshes, checkpoints and what lies beside these."""
        named = [path for name in self.objects for path in target_files(name)]
        named += [path for name in self.agents for path in agent_files(name)]
        return [path for path in dict.fromkeys(map(expand, named)) if path.is_file()]

    def default_folder(self) -> Path:
        """Return runs/<protocol>-<agents>-seed<seed>-<hash>: the same command finds its own results again."""
        digest = hashlib.sha256(repr(sorted(self.identity().items())).encode()).hexdigest()[:8]
        agents = "+".join(Path(agent).stem.replace(":", ".") for agent in self.agents)[:60]
        return Path("runs") / f"{self.protocol[:40]}-{agents}-seed{self.seed}-{digest}"


def versions() -> dict[str, str]:
    """Return the versions of the packages that outcomes depend on."""
    return package_versions(_PACKAGES)


def code_hash(agents: Sequence[str] = ()) -> str:
    """Return a hash of both packages' sources, their assets and users' agents: results of other code do not mix in.

    Assets are weights, the robot's description and shells, and rest poses; not what only people read.
    """
    roots = [_package_folder(name) for name in ("dexgrasp", "dexgrasp.agents", "dexgrasp_env")]
    files = sorted({path.resolve() for root in roots for path in root.rglob("*.py")})
    digest = hashlib.sha256()
    assets = sorted(path for path in asset_path().rglob("*") if path.is_file() and path.suffix != ".md")
    for path in [*files, *assets, *filter(None, map(agent_source, agents))]:
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _package_folder(name: str) -> Path:
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        raise InputError(f"package {name} is not installed")
    return Path(spec.origin).parent


def _file_hash(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
