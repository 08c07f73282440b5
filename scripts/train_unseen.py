"""Train the completion network: `python scripts/train_unseen.py VIEWS.npz assets/weights/unseen.safetensors`.

`unseen_views.py` makes VIEWS.npz. Every twentieth object is held out. Training minimises |error| / spread + log spread,
so that the spread becomes the mean absolute error that the network expects of itself.
"""

import argparse
import itertools
import json

import numpy as np
import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from dexgrasp.shape.network import LOG_SPREAD, SCHEMA

_BATCH, _RATE, _DECAY, _NOISE = 256, 1.5e-3, 1e-2, 0.03  # noise in standard deviations of the features


def losses(answer: Tensor, missing: Tensor) -> tuple[Tensor, Tensor]:
    """Return the loss and the mean absolute error, cm."""
    more, log_spread = answer.chunk(2, 1)
    log_spread = log_spread.clamp(*LOG_SPREAD)
    error = (more - missing).abs()
    return (error * torch.exp(-log_spread) + log_spread).mean(), error.mean()


def train(x: Tensor, y: Tensor, held_out: Tensor, hidden: int, epochs: int) -> nn.Sequential:
    """Return the network that was trained on rows of x (N, 391), y (N, 361) that are not `held_out` (N,)."""
    sizes = [x.shape[1], hidden, hidden, hidden, 2 * y.shape[1]]
    layers = [m for a, b in itertools.pairwise(sizes) for m in (nn.Linear(a, b), nn.ReLU())]
    network = nn.Sequential(*layers[:-1])
    rows = torch.where(~held_out)[0]
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=_DECAY)
    steps = epochs * (len(rows) // _BATCH)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, _RATE, total_steps=steps)
    for epoch in range(epochs):
        for batch in rows[torch.randperm(len(rows))].split(_BATCH)[: len(rows) // _BATCH]:
            loss, _ = losses(network(x[batch] + _NOISE * torch.randn_like(x[batch])), y[batch])
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
        with torch.no_grad():
            loss, error = losses(network(x[held_out]), y[held_out])
        print(f"epoch {epoch + 1}: held out loss {loss:.3f}, error {10 * error:.2f} mm", flush=True)
    return network


def main() -> None:
    """Train and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("views")
    parser.add_argument("out")
    parser.add_argument("--hidden", type=int, default=384)
    parser.add_argument("--epochs", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    torch.manual_seed(args.seed)
    file = np.load(args.views)
    x, y = torch.tensor(file["features"]), torch.tensor(file["missing"])
    held_out = torch.tensor(file["objects"] % 20 == 0)
    mean, scale = x[~held_out].mean(0), x[~held_out].std(0) + 1e-3
    network = train((x - mean) / scale, y, held_out, args.hidden, args.epochs)
    arrays = {f"network.{key}": value for key, value in network.state_dict().items()}
    note = {"schema": SCHEMA, "epochs": args.epochs, "seed": args.seed, "views": len(x)}
    save_file({"mean": mean, "scale": scale} | arrays, args.out, {"dexgrasp": json.dumps(note)})


if __name__ == "__main__":
    main()
