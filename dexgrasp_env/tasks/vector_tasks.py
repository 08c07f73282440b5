"""Vector environments of further tasks: N scenes side by side, see `LiftVectorEnv`."""

from dexgrasp_env.tasks.clear import ClearEnv
from dexgrasp_env.tasks.gentle import GentleEnv
from dexgrasp_env.tasks.vector import LiftVectorEnv


class GentleVectorEnv(LiftVectorEnv):
    """N environments like `GentleEnv`; see `LiftVectorEnv`."""

    _env_type = GentleEnv


class ClearVectorEnv(LiftVectorEnv):
    """N environments like `ClearEnv`, each with a scene of its own; see `LiftVectorEnv`."""

    _env_type = ClearEnv
