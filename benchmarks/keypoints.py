"""Where the network's keypoints are on the body, and how far they scatter: python -m benchmarks.keypoints.

Rendered people in random clothes and poses. A keypoint is a constant point of a link, the same on both sides;
`coordinator/bodies/human/keypoints.py` has what this prints. Errors are in the image, times depth over focal
length. A deviation is that along one axis if errors are normal, from the median.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from benchmarks.running import command_line
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics, project
from gepf.common.kinematics import joint_positions, link_transforms, pose_vertices
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.colour.crop import Crop, crop_of_body
from gepf.coordinator.colour.keypoints import LANDMARK_OF
from gepf.coordinator.colour.network import PoseNetwork
from gepf.coordinator.settings import ColourSettings
from gepf.coordinator.synthesis.clothes import dress
from gepf.coordinator.synthesis.rendering import ColouredSurface, DepthRenderer

CAMERA = Intrinsics(640, 480, 570.0, 570.0, 319.5, 239.5)
DISTANCES_M = (2.2, 3.5)
LINKS = {
    "nose": "skull", "eye": "skull", "ear": "skull", "shoulder": "scapula", "elbow": "upper_arm",
    "wrist": "forearm", "hip": "pelvis", "knee": "thigh", "ankle": "shank",
}  # fmt: skip
"""Of the links on both sides of a joint, the one on which the keypoint scatters less."""
VISIBLE = 0.5  # least visibility of keypoints that are fitted
SCALE_M = 0.03  # of the robust loss
BINS = (0.0, 0.2, 0.5, 0.8, 0.95, 1.0)
NORMAL = 1.177  # median distance in two dimensions / deviation along one axis


class Seen(NamedTuple):
    """A rendered person: links (L, 3, 4), keypoints (17, 2) and their visibility (17,), side of the crop."""

    links: Array
    pixels: Array
    visibility: Array
    side: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, look, fit, print."""
    parser = command_line("keypoints", __doc__)
    parser.add_argument("--people", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    chosen: argparse.Namespace = parser.parse_args(arguments)
    model = human(1.75)
    people = render_people(model, chosen.people, chosen.seed)
    shares = list[Array]()
    for part, link in LINKS.items():
        point, errors, visibility, sides = fit(model, people, part, link)
        seen = errors[visibility > VISIBLE]
        shown = " ".join(f"{value:7.3f}" for value in point)
        print(f"{part:9}{link:10}{shown}   median {100 * np.median(seen):4.1f} cm, "
              f"90 % {100 * np.percentile(seen, 90):5.1f} cm")  # fmt: skip
        shares.append(np.stack([visibility, errors / sides]))
    visibility, share = np.concatenate(shares, axis=1)
    for low, high in pairwise(BINS):
        within = share[(visibility > low) & (visibility <= high)]
        print(f"visibility to {high:.2f}: deviation {np.median(within) / NORMAL:.3f} sides ({len(within)})")
    return 0


def render_people(model: BodyModel, count: int, seed: int) -> list[Seen]:
    """What the network sees of people in random poses whom it finds."""
    rng, network, people = np.random.default_rng(seed), PoseNetwork(), list[Seen]()
    with DepthRenderer(CAMERA) as renderer:
        for pose in PEOPLE.draw_poses(model, count, rng):
            seen = look(model, pose, renderer, network, rng)
            if seen is not None:
                people.append(seen)
    print(f"{len(people)} of {count} people were found", file=sys.stderr)
    return people


def look(
    model: BodyModel, pose: Array, renderer: DepthRenderer, network: PoseNetwork, rng: np.random.Generator
) -> Seen | None:
    """Render a pose (D,) before the camera and look at it; None if the network finds nobody."""
    vertices = pose_vertices(model, pose[None])[0]
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    shift = np.array([0.0, 0.0, rng.uniform(*DISTANCES_M)]) - middle
    surface = ColouredSurface(vertices + shift, model.triangles, dress(model, rng))
    light = np.array([*rng.uniform(-0.6, 0.6, 2) - (0.0, 0.5), -1.0])
    image = renderer.colours(surface, rng.uniform(0.3, 0.9, 3), light)
    noisy = np.clip(image + rng.normal(0.0, 4.0, image.shape), 0, 255).astype(np.uint8)
    joints = dict(zip(model.joint_names, joint_positions(model, pose[None])[0] + shift, strict=True))
    crop = crop_of_body(
        surface.vertices, 0.5 * (joints["right_hip"] + joints["left_hip"]), joints["neck"], CAMERA
    )
    assert isinstance(crop, Crop)
    found = network.see(crop.take(noisy, np.ones(noisy.shape[:2], np.bool_), ColourSettings().max_gap_px))
    if found.presence < 0.9:
        return None
    chosen = list(LANDMARK_OF.values())
    links = link_transforms(model, pose[None])[0]
    links[:, :, 3] += shift
    return Seen(links, crop.to_image(found.places[chosen]), found.visibility[chosen], crop.side)


def fit(model: BodyModel, people: list[Seen], part: str, link: str) -> tuple[Array, Array, Array, Array]:
    """The point (3,) of the left link at rest; errors in metres, visibility, sides of the crops in metres."""
    sides = {"": 0.0} if part == "nose" else {"left_": 1.0, "right_": -1.0}
    names, rows = list(LANDMARK_OF), []
    for side, sign in sides.items():
        carrier = model.link_names.index(link if link in model.link_names else f"{side[0]}_{link}")
        place = names.index(side + part)
        rows += [
            (each.links[carrier], each.pixels[place], each.visibility[place], each.side, sign)
            for each in people
        ]
    links, pixels, visibility, crops, signs = (np.array(each) for each in zip(*rows, strict=True))

    def off(point: Array) -> tuple[Array, Array]:
        mirrored = np.column_stack([signs * point[0], *np.tile(point[1:, None], len(signs))])
        at = np.einsum("nab,nb->na", links[:, :, :3], mirrored) + links[:, :, 3]
        metres = at[:, 2] / CAMERA.fx
        return (project(at, CAMERA) - pixels) * metres[:, None], metres

    def loss(point: Array) -> Array:
        return np.asarray(off(point)[0][visibility > VISIBLE].ravel() / SCALE_M)

    joint = f"left_{part}" if f"left_{part}" in model.joint_names else "head"
    start = model.joint_points[model.joint_names.index(joint)]
    found = least_squares(loss, start, loss="soft_l1").x
    errors, metres = off(found)
    return (
        found * ([0.0, 1.0, 1.0] if part == "nose" else 1.0),
        np.linalg.norm(errors, axis=1),
        visibility,
        crops * metres,
    )


if __name__ == "__main__":
    sys.exit(main())
