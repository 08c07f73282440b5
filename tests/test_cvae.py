from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from planned import lying
from processes import typed
from refusals import refused
from robots import CELL

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")


from dexgrasp import make_agent  # noqa: E402
from dexgrasp.agents.ablations import (  # noqa: E402
    COLLISION,
    NO_CLOSURE,
    NO_IK,
    TOO_WEAK,
    KinematicPlanner,
    RawPlanner,
)
from dexgrasp.data.dataset.dataset import read_dataset  # noqa: E402
from dexgrasp.data.dataset.generate import generate  # noqa: E402
from dexgrasp.data.dataset.settings import DatasetSettings  # noqa: E402
from dexgrasp.geometry.target import GraspTarget  # noqa: E402
from dexgrasp.learning.cvae.cvae_network import Cvae  # noqa: E402
from dexgrasp.learning.cvae.cvae_training import CvaeTraining  # noqa: E402
from dexgrasp.learning.cvae.grasp_batches import split  # noqa: E402
from dexgrasp.learning.cvae.settings import TrainingSettings  # noqa: E402
from dexgrasp.mechanics.margin import margins  # noqa: E402
from dexgrasp.planning.cvae_source import CvaeProposals, shipped_weights  # noqa: E402
from dexgrasp.planning.decoder import (  # noqa: E402
    NetworkSettings,
    read_decoder,
)
from dexgrasp.planning.planner import Planner  # noqa: E402
from dexgrasp.planning.proposals import ProposalSource  # noqa: E402
from dexgrasp.planning.settings import PlannerSettings  # noqa: E402
from dexgrasp.runs.weights import read_arrays  # noqa: E402

NETWORK = NetworkSettings(latent=3, points=64, local=16, cloud=32, hidden=32)
TRAINING = TrainingSettings(epochs=3, clouds=2, grasps=8, network=NETWORK)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "set"
    generate(DatasetSettings.of(["gelatin_box"], grasps_per_pose=30, chunk=30), folder)
    return folder


@pytest.fixture(scope="module")
def trained(data, tmp_path_factory):
    out = tmp_path_factory.mktemp("trained") / "run"
    state = CvaeTraining(data, TRAINING, out).run()
    return out, state


def box():
    return lying((0.06, 0.09, 0.1), (0.5, 0.05))


def test_the_wrench_layer_adds_the_residual_of_the_forces_to_the_loss(data, tmp_path):
    plain, wrench = (replace(TRAINING, epochs=1, wrench_layer=on) for on in (False, True))
    trainings = [CvaeTraining(data, settings, tmp_path) for settings in (plain, wrench)]
    trainings[0].build()
    net = trainings[1].net = trainings[0].net
    one, other = (training.losses(0, 1.0) for training in trainings)
    assert float(other.total.detach()) > float(one.total.detach())
    (other.total - one.total).backward()
    assert net.decoder[-1].weight.grad[:9].abs().sum() > 0


def test_splits_share_no_grasp(data):
    parts = split(read_dataset(data), TRAINING)
    assert parts["held_out_poses"]
    train_tips = {t.tobytes() for p in parts["train"] for t in p.tips}
    assert not any(t.tobytes() in train_tips for p in parts["test"] for t in p.tips)
    with refused("valid are gelatin_box"):
        split(read_dataset(data), replace(TRAINING, held_out_object="soda"))


def test_command_line(data, tmp_path, capsys, printed, monkeypatch):
    monkeypatch.setattr(CvaeTraining, "steps", 2)
    assert typed(f"train cvae --data {data} --out {tmp_path / 'run'} --epochs 1 --json") == 0
    assert printed()["losses"]["test"]["fingertip_cm"] > 0
    assert (tmp_path / "run" / "curves.png").is_file()
    assert typed(f"train cvae --data {tmp_path} --out {tmp_path / 'b'} --epochs 1") == 2
    assert "holds no dataset" in capsys.readouterr().err


def test_shipped_weights_propose_closure_and_lead_to_a_grasp():
    proposals = CvaeProposals().propose(box(), PlannerSettings(), np.random.default_rng(0))
    assert proposals.failure is None
    assert margins(proposals.contacts, proposals.normals, PlannerSettings().friction).min() > 0.0
    assert len(proposals.contacts) > 10
    assert Planner(source=CvaeProposals()).plan(box(), 0).grasp is not None


@pytest.mark.parametrize("name", ["cvae", "cvae_kinematics"])
def test_agents_carry_out_learned_grasps(name):
    import gymnasium as gym

    import dexgrasp_env  # noqa: F401

    agent = make_agent(name)
    env = gym.make("DexGrasp/Lift-v2", objects="sugar_box", **agent.env_settings)
    for seed in range(8):  # latents are not ranked: some scenes have none that can be carried out
        observation, info = env.reset(seed=seed)
        agent.seed(seed)
        agent.reset(observation, info)
        if agent.report.failure is None:
            break
    assert agent.report.failure is None
    assert env.action_space.contains(agent.act(observation))
    env.close()


def test_what_the_ablations_reject_and_what_not():
    """`cvae` checks IK, collisions and Eq. 4 of a grasp; `cvae_kinematics` that its forces bear the weight."""
    target = lying((0.05, 0.1, 0.08), mass=0.2)
    heavy = GraspTarget.of(target.hull, mass=60.0)
    raw = RawPlanner(PlannerSettings(), CELL).plan(target, 0)
    assert set(raw.log.blocked) <= {COLLISION, NO_CLOSURE, NO_IK}
    assert raw.grasp is not None
    assert raw.grasp.certificate.closure_residual < 1e-6
    assert raw.grasp.certificate.min_clearance_m >= 0.0
    assert -(raw.grasp.forces * raw.grasp.normals).sum(1).min() >= 4.0 - 1e-6
    assert KinematicPlanner(PlannerSettings(), CELL).plan(target, 0).grasp.certificate.holds
    refused = KinematicPlanner(PlannerSettings(), CELL)
    proposals = refused.source.propose(heavy, replace(refused.settings, triples=3), np.random.default_rng(0))
    refused.source = Given(proposals)
    plan = refused.plan(heavy, 0)
    assert plan.grasp is None
    assert TOO_WEAK in plan.log.blocked


class Given(ProposalSource):
    """Proposals as they are given."""

    def __init__(self, proposals):
        self._proposals = proposals

    def propose(self, target, settings, rng):
        return self._proposals


def test_the_decoder_in_numpy_is_the_network(trained):
    out, _ = trained
    rng = np.random.default_rng(0)
    for path in (out / "cvae.safetensors", shipped_weights()):
        decoder, (arrays, _) = read_decoder(path), read_arrays(path)
        model = Cvae(decoder.settings)
        model.load_state_dict({name: torch.from_numpy(array) for name, array in arrays.items()})
        cloud = rng.normal(size=(200, 6)).astype(np.float32)
        latent = rng.normal(size=(50, decoder.settings.latent)).astype(np.float32)
        with torch.no_grad():
            feature = model.cloud(torch.from_numpy(cloud)[None])
            grasps = model.decode(feature.expand(50, -1), torch.from_numpy(latent)).numpy()
        assert_allclose(decoder.feature(cloud), feature[0].numpy(), atol=1e-5)
        assert_allclose(decoder.decode(decoder.feature(cloud), latent), grasps, atol=1e-5)
