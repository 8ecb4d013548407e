"""Loads compiled code before the first frame of live input, which would otherwise wait for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, SubjectFrame, View
from gepf.common.refinement import Particles, Refined, triangle_size
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.settings import Settings
from gepf.coordinator.tracking.observation import isolate
from gepf.coordinator.tracking.refiner import LocalRefiner
from gepf.coordinator.tracking.reporting import Stopwatch, UpdatedPerson, report
from gepf.coordinator.tracking.segmenter import BodyView, ExpectedSurface, Segmenter
from gepf.coordinator.tracking.state import first_state
from gepf.coordinator.tracking.target import TargetTracker

CAMERA = Intrinsics(80, 60, 60.0, 60.0, 39.5, 29.5)


class IdentityRefiner(LocalRefiner):
    """A refiner that leaves particles as they are."""

    def refine(self, _subject: SubjectFrame, _model: BodyModel, particles: Particles) -> Refined:
        """The same poses (N, D), with standard deviations of 1 cm and 0.01 rad."""
        return unmoved(particles)


def unmoved(particles: Particles) -> Refined:
    """Unchanged poses (N, D), all equally likely, with a residual of 1 cm and a covariance on request."""
    count, dofs = particles.poses.shape
    roots = np.zeros((count, triangle_size(dofs)), np.float32)
    roots[:, np.cumsum(np.arange(1, dofs + 1)) - 1] = 0.01
    covariance_roots = roots if particles.covariance else None
    return Refined(particles.poses, np.zeros(count), np.full(count, 0.01), covariance_roots)


def warm_up(settings: Settings, bodies: Bodies) -> None:
    """Segment two frames of a small scene, as a whole and around a body, and detect and track the body there.

    The body is also detected when truncated by the image border. There are no workers.
    """
    distance_m = 2.5
    depth = np.full((CAMERA.height, CAMERA.width), 4000, dtype=np.uint16)
    depth[10:40, 30:45] = 1e3 * distance_m + 5 * (np.arange(15) - 7) ** 2  # something in front of the wall
    start = {"root_tz": distance_m} if "root_tz" in bodies.dof_names else {}
    tracked, unknown, truncated = (
        TargetTracker(IdentityRefiner(), settings, bodies, first_state(bodies, values, settings))
        for values in (start, None, None)
    )
    segmenter = Segmenter(1, settings.scene, network=bodies.family.body_network())
    for number, surface in enumerate((None, tracked.segmentation_surface())):
        room = View(number, number / 30.0, depth, 1000.0, CAMERA)
        segmenter.learn(segmenter.segment(Frame.of(room), [ExpectedSurface(surface)]))
        whole = replace(room, depth=np.where(depth < 4000, depth, 0))
        short = replace(whole, depth=whole.depth[:30], intrinsics=CAMERA.crop(0, 0, CAMERA.width, 30))
        for target in (tracked, unknown, truncated):
            frame = Frame.of(short if target is truncated else whole)
            target.accept_first_detection()
            updated = target.submit(BodyView(frame, isolate(frame, 400), Planes()), Stopwatch())
            report(
                updated if isinstance(updated, UpdatedPerson) else target.update(updated, {}), {}, settings
            )
