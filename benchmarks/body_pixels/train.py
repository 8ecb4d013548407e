"""Trains the network that tells people from things: python benchmarks/body_pixels/train.py CROPS FILE.

It needs only PyTorch and numpy, and no other part of the project. The coordinator computes the network
without PyTorch (`coordinator/bodies/pixels.py`): the normalisation of a layer becomes part of its weights,
which are stored with half precision. The last scenes are held out. Twenty minutes on two cores.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

SEED = 80
WIDTHS = 16, 32, 64  # channels before each pooling
UPWARDS = 48, 32, 16  # channels of the layers upwards
BATCH, FASTEST = 32, 4e-3  # crops; largest rate of learning
HELD_OUT = 0.07
FLIPPED, NOISY, WITH_HOLES, UNDIVIDED = 0.5, 0.5, 0.3, 0.2  # shares of the batches
STRETCHED, SHIFTED_M, NOISE_M = 0.1, 0.06, 0.01  # of depth: most, deviations
HOLES, HOLE_CELLS = 0.03, 4
REACH_M = 1.5  # as in pixels.py


class Layer(nn.Sequential):
    """A convolution of 3 x 3 cells, normalised, without negative values."""

    def __init__(self, channels: int, wide: int) -> None:
        convolution = nn.Conv2d(channels, wide, 3, padding=1, bias=False)
        super().__init__(convolution, nn.BatchNorm2d(wide), nn.ReLU(inplace=True))

    def folded(self) -> tuple[Tensor, Tensor]:
        """Weights (O, C, 3, 3) and bias (O,) that contain the normalisation."""
        convolution, norm, _ = self
        scale = norm.weight / torch.sqrt(norm.running_var + norm.eps)
        return convolution.weight * scale[:, None, None, None], norm.bias - norm.running_mean * scale


class Network(nn.Module):
    """The network of `coordinator/bodies/pixels.py`."""

    def __init__(self) -> None:
        super().__init__()
        first, second, third = WIDTHS
        self.down = nn.ModuleList(
            [nn.Sequential(Layer(3, first), Layer(first, first)), Layer(first, second), Layer(second, third)]
        )
        self.bottom = nn.Sequential(Layer(third, third), Layer(third, third))
        wide = third, *UPWARDS
        self.up = nn.ModuleList(Layer(wide[n] + kept, wide[n + 1]) for n, kept in enumerate(reversed(WIDTHS)))
        self.last = nn.Conv2d(UPWARDS[-1], 1, 1)

    def forward(self, image: Tensor) -> Tensor:
        """Log odds (N, H, W) of crops (N, 3, H, W)."""
        kept = []
        for block in self.down:
            image = block(image)
            kept.append(image)
            image = functional.max_pool2d(image, 2)
        image = self.bottom(image)
        for layer in self.up:
            doubled = functional.interpolate(image, scale_factor=2, mode="nearest")
            image = layer(torch.cat([doubled, kept.pop()], 1))
        return self.last(image)[:, 0]

    def save(self, file: Path) -> None:
        """Write the file that `BodyNetwork.load` reads."""
        layers = [layer.folded() for layer in self.modules() if isinstance(layer, Layer)]
        layers.append((self.last.weight, self.last.bias))
        arrays = [array.detach().numpy().astype(np.float16) for layer in layers for array in layer]
        np.savez_compressed(file, **{f"{n:02d}": array for n, array in enumerate(arrays)})


class Crops:
    """The crops of a file; see `benchmarks/body_pixels/__main__.py`."""

    def __init__(self, file: Path) -> None:
        with np.load(file) as arrays:
            self.depth, self.known, self.foreground, self.people, self.scenes = (
                arrays[name] for name in ("depth", "known", "foreground", "people", "scenes")
            )

    def batch(self, chosen: NDArray[np.int64]) -> tuple[Tensor, Tensor, Tensor]:
        """Images (N, 3, H, W), foreground and people (N, H, W) of the chosen crops."""
        columns = self.depth, self.known, self.foreground, self.people
        depth, known, foreground, people = (
            torch.from_numpy(column[chosen].astype(np.float32)) for column in columns
        )
        return torch.stack([depth, known, foreground], 1), foreground, people


def varied(image: Tensor, rng: np.random.Generator) -> Tensor:
    """Crops (N, 3, H, W) with depth stretched and shifted, some with noise or holes, or all foreground."""
    depth, known, foreground = image.unbind(1)
    count, (height, width) = len(depth), depth.shape[1:]
    stretch, shift = rng.uniform(-STRETCHED, STRETCHED, count), rng.normal(0.0, SHIFTED_M, count)
    depth = depth * column(1.0 + stretch) + column(shift)
    if rng.random() < NOISY:
        depth = depth + NOISE_M * torch.from_numpy(rng.standard_normal(depth.shape).astype(np.float32))
    if rng.random() < UNDIVIDED:
        foreground = known
    if rng.random() < WITH_HOLES:
        coarse = rng.random((count, 1, height // HOLE_CELLS, width // HOLE_CELLS)) >= HOLES
        whole = functional.interpolate(torch.from_numpy(coarse.astype(np.float32)), scale_factor=HOLE_CELLS)
        known, foreground = known * whole[:, 0], foreground * whole[:, 0]
    return torch.stack([depth.clamp(-REACH_M, REACH_M) * known, known, foreground], 1)


def column(values: NDArray[np.float64]) -> Tensor:
    """Values (N, 1, 1), one for each crop."""
    return torch.from_numpy(values.astype(np.float32))[:, None, None]


def shares(network: Network, crops: Crops, held_out: NDArray[np.int64]) -> str:
    """Shares of the cells of people that are missed, and of those of things that are taken for people."""
    network.eval()
    totals = np.zeros(4)
    with torch.no_grad():
        for chosen in np.array_split(held_out, max(1, len(held_out) // BATCH)):
            image, foreground, people = crops.batch(chosen)
            found, things = network(image) > 0.0, foreground * (1.0 - people)
            totals += [float(each.sum()) for each in (people, people * ~found, things, things * found)]
    network.train()
    return f"{100 * totals[1] / totals[0]:.1f} % missed, {100 * totals[3] / totals[2]:.1f} % taken for people"


def main() -> int:
    """Train, report, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("crops", type=Path)
    parser.add_argument("file", type=Path)
    parser.add_argument("--rounds", type=int, default=10, metavar="N")
    chosen = parser.parse_args()
    torch.manual_seed(SEED)
    rng, crops = np.random.default_rng(SEED), Crops(chosen.crops)
    is_held_out = crops.scenes >= (1.0 - HELD_OUT) * crops.scenes.max()
    training, held_out = np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)
    network, steps = Network(), len(training) // BATCH
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, FASTEST, total_steps=chosen.rounds * steps, pct_start=0.15
    )
    began_s = time.monotonic()
    for turn in range(chosen.rounds):
        order = rng.permutation(training)[: steps * BATCH].reshape(steps, BATCH)
        for picked in order:
            image, foreground, people = crops.batch(picked)
            image = varied(image, rng)
            if rng.random() < FLIPPED:
                image, foreground, people = (each.flip(-1) for each in (image, foreground, people))
            cost = functional.binary_cross_entropy_with_logits(network(image), people, reduction="none")
            optimiser.zero_grad()
            ((cost * foreground).sum() / foreground.sum()).backward()
            optimiser.step()
            schedule.step()
        print(
            f"{turn + 1}: {time.monotonic() - began_s:.0f} s, {shares(network, crops, held_out)}", flush=True
        )
        network.save(chosen.file)
    return 0


if __name__ == "__main__":
    sys.exit(main())
