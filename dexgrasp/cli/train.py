"""Train networks: the learned half of the paper, policies cloned from demonstrations or reinforced.

examples:
  dexgrasp train cvae --data runs/ycb6 --out runs/cvae --minutes 25
  dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
  dexgrasp train grip --objects varied-0..59 --from runs/bc --out runs/grip
  dexgrasp train ppo --objects varied-0..29 --from runs/bc --out runs/ppo
  dexgrasp evaluate --agents runs/bc runs/ppo hardcoded --objects seen

A run that was interrupted goes on when the same command is given again, on a CPU to the same bits. The folder of a
policy is an agent by its path (JSON and safetensors); with several seeds it has a folder seed-S for each.
"""

from dataclasses import replace
from functools import partial
from typing import Annotated

from dexgrasp.cli.command import Answer, Folder
from dexgrasp.cli.training import Device, PolicyCommand, TrainingCommand
from dexgrasp.cvae.settings import TrainingSettings
from dexgrasp.imitation.settings import BcSettings
from dexgrasp.reinforcement.settings import GripSettings, RlSettings
from dexgrasp_env.arrays import Fields
from dexgrasp_env.valid import Count, Positive, one_of

_CVAE = ("epochs", "seed", "threads", "latent", "kl_weight", "held_out_object")
_BC = ("epochs", "threads", "hidden", "chunk", "execute")
_GRIP = ("objects", "episodes", "friction", "mass", "num_envs", "rate", "threads")
_SAC = (
    "objects", "env_id", "control_mode", "hold", "chunk", "episode_steps", "backend", "randomise", "resets", "share",
    "steps", "num_envs", "hidden", "rate", "discount", "reward_scale", "threads",
)  # fmt: skip
Minutes = Annotated[Positive | None, "M", {"instead_of": "settings.epochs"}]


class Cvae(TrainingCommand):
    """Train the autoencoder that proposes fingertips.

    examples:
      dexgrasp train cvae --data runs/ycb6 --out runs/cvae --minutes 25
      dexgrasp train cvae --data runs/ycb6 --out runs/cvae --epochs 300 --held-out-object potted_meat_can --device cuda

    A run that was interrupted goes on when the same command is given again, on a CPU to the same bits. The folder of
    --out holds cvae.safetensors (the weights of the least test loss), checkpoint.safetensors, run.json, curve.jsonl,
    curves.png and tensorboard/. Weights are read by `dexgrasp.planning.cvae_source.CvaeProposals`.

    Attributes:
        data: of `dexgrasp dataset generate`.
        minutes: as many epochs as fit, by measured speed.
        device: where it is computed.
    """

    data: Folder
    settings: Annotated[TrainingSettings, _CVAE] = TrainingSettings()
    minutes: Minutes = None
    device: Device = "auto"

    def learn(self) -> Answer:
        """Train, return the losses."""
        from dexgrasp.cvae.cvae_training import WEIGHTS, CvaeTraining

        make = partial(CvaeTraining, self.data, settings=self.settings)
        training = self.train(make, "epoch", minutes=self.minutes)
        state, losses = training.state, training.state.curve[training.best - 1]
        figures = {
            "epochs": state.epochs, "best_epoch": training.best, "seconds": state.seconds, "losses": losses,
            "weights": self.out / WEIGHTS, "curves": self.out / "curves.png",
        }  # fmt: skip
        lines = [
            f"{split}: loss {values['total']:.4f}, fingertips {values['fingertip_cm']:.2f} cm, KL {values['kl']:.2f}"
            for split, values in losses.items()
            if isinstance(values, dict) and values
        ]
        epoch = f"epoch {training.best} of {state.epochs}, {state.seconds:.0f} s"
        return Answer(figures, "\n".join([*lines, f"{epoch}; weights in {figures['weights']}"]))

    def figures(self, row: Fields) -> Fields:
        """Return the losses."""
        return {"train": row["train"]["total"], "test_cm": row["test"]["fingertip_cm"]}


class Bc(PolicyCommand):
    """Clone a policy from demonstrations.

    examples:
      dexgrasp demos generate --objects varied-0..99 --episodes 20 --noise 0.03 --out runs/demos --workers 2
      dexgrasp train bc --data runs/demos --out runs/bc --minutes 10
      dexgrasp train bc --data runs/demos --view cloud --out runs/bc_cloud --epochs 30 --seed 0 1 2
      dexgrasp train bc --data runs/demos --out runs/bc --epochs 20 --try-on seen --trials 3 --every 5
      dexgrasp evaluate --agents runs/bc bilevel --objects all20

    A policy sees the whole state and predicts the set-points of the next 8 control steps; or it looks at a cloud once,
    predicts how the object is grasped, and closes its hand until the joints feel contact. --out then holds policy.json
    and policy.safetensors: an agent by its path, wherever agents are named. A run that was interrupted goes on when the
    same command is given again, on a CPU to the same bits.

    Attributes:
        data: of `dexgrasp demos generate`.
        view: what the policy sees (default: what the demonstrations do).
        minutes: as many epochs as fit, by measured speed.
        every: epochs between trials.
    """

    data: tuple[Folder, ...]
    view: Annotated[str | None, one_of(("state", "cloud"))] = None
    settings: Annotated[BcSettings, _BC] = BcSettings()
    minutes: Minutes = None
    every: Count = 5

    def learn(self) -> Answer:
        """Train a policy for each seed, return losses and successes."""
        from dexgrasp.demos.generate import read_about
        from dexgrasp.imitation.cloning import VIEWS
        from dexgrasp.imitation.features import view_of

        view = self.view or view_of(str(read_about(self.data[0])["settings"].get("obs_mode")))
        settings = replace(self.settings, view=view)
        return self.train_each(partial(VIEWS[view], self.data), "epoch", settings, minutes=self.minutes)


class Grip(PolicyCommand):
    """Correct the grip of a cloned policy by reinforcement.

    examples:
      dexgrasp train grip --objects varied-0..59 --from runs/bc --out runs/grip
      dexgrasp train grip --objects varied-0..59 --from runs/bc --friction 0.3 0.5 --mass 1 1.5 --out runs/grip
      dexgrasp evaluate --agents runs/grip runs/bc --objects all20 --protocol robust

    PPO of Stable-Baselines3, one decision an episode: from the first look the network shifts and tilts the palm by up
    to 3 cm and 0.2 rad and bends fingers and thumb, and a policy of `train bc` from the state acts with that. It begins
    with no correction. Episodes are slippery and heavy by default, as a grip that holds there bears pushes as well. A
    run that was interrupted goes on when the same command is given again, on a CPU to the same bits.

    Attributes:
        clone: a policy of `train bc`.
        every: rounds between trials.
    """

    settings: Annotated[GripSettings, _GRIP]
    clone: Annotated[Folder, "--from"]
    every: Count = 10

    def learn(self) -> Answer:
        """Train a policy for each seed, return returns and successes."""
        from dexgrasp.reinforcement.policy_training import GripTraining

        return self.train_each(partial(GripTraining, clone=self.clone), "round", self.settings)


class _Rl(PolicyCommand):
    """How it begins.

    Attributes:
        settings: of the training.
        clone: a policy of `train bc` to begin with.
    """

    settings: RlSettings
    clone: Annotated[Folder | None, "--from"] = None

    def learn(self) -> Answer:
        """Train a policy for each seed, return returns and successes."""
        from dexgrasp.reinforcement.policy_training import PolicyTraining

        settings = replace(self.settings, algorithm=type(self).__name__.lower())
        return self.train_each(partial(PolicyTraining, clone=self.clone), "round", settings)


class Ppo(_Rl):
    """Train a policy with PPO.

    examples:
      dexgrasp train ppo --objects sugar_box --steps 2000000 --out runs/ppo
      dexgrasp train ppo --objects varied-0..29 --from runs/bc --steps 500000 --out runs/ppo_bc --try-on seen
      dexgrasp train ppo --objects sugar_box --control-mode ee_delta --resets runs/demos --out runs/ppo_demos
      dexgrasp train ppo --objects seen --env-id DexGrasp/LiftPushed-v2 --randomise mass=0.8:1.2 --out runs/ppo_pushed
      dexgrasp evaluate --agents runs/ppo_bc runs/bc --objects all20 --protocol lift pushed slippery
      dexgrasp train ppo --objects all20 --backend warp --device cuda --num-envs 4096 --out runs/ppo_gpu
      dexgrasp evaluate --agents runs/ppo_gpu --objects all20 --protocol lift lift@warp

    Stable-Baselines3's algorithm on the native vector environment, dense reward. With --from, a cloned policy acts and
    a share of the network's action is added to its own: what it can do already is the start. A run that was interrupted
    goes on when the same command is given again; rounds (one episode of every environment) have seeds of their own, so
    that on a CPU it goes on to the same bits.
    """

    settings: Annotated[
        RlSettings, (*_SAC, "spread", "settle", "noise", "rollout", "passes", "divergence", "adaptive")
    ]


class Sac(_Rl):
    """Train a policy with SAC.

    examples:
      dexgrasp train sac --objects seen --from runs/bc --share 0.1 --out runs/sac_bc --seed 0 1 2

    All else is as of `dexgrasp train ppo`, whose help says more.
    """

    settings: Annotated[RlSettings, (*_SAC, "buffer", "warm_up", "updates")]


COMMAND = {"cvae": Cvae, "bc": Bc, "grip": Grip, "ppo": Ppo, "sac": Sac}
