"""The input of `gepf track`: recorded frames, or frames that are published during the run."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path

import msgspec
import numpy as np

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.common.frame import Frame
from gepf.common.packages import MissingPackage
from gepf.common.protocol.keys import check_stream, of_live
from gepf.common.transport.channels import Publisher
from gepf.common.transport.session import holder_name
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.colour.finder import KeypointFinder, without_colour
from gepf.coordinator.colour.network import NETWORK
from gepf.coordinator.commands.job import Job
from gepf.coordinator.commands.progress import FrameRate, Show, counted, describe_frame
from gepf.coordinator.commands.publish import play
from gepf.coordinator.files import with_parent
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.results.configuration import (
    AUTOMATIC,
    CAMERA_GIVEN,
    PATH,
    PEOPLE,
    RunConfiguration,
    digest,
    digest_view,
    versions,
)
from gepf.coordinator.results.evaluation import Truth, read_truth
from gepf.coordinator.results.live_results import results_key
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.sources import Source, open_source
from gepf.coordinator.sources.background import check_size, read_background
from gepf.coordinator.sources.camera import AS_RECORDED
from gepf.coordinator.sources.colour_folder import ColourFolder
from gepf.coordinator.sources.devices.device import AttachedCamera, vendor_of
from gepf.coordinator.sources.doubts import find_doubts
from gepf.coordinator.sources.frame_recorder import FrameRecorder
from gepf.coordinator.sources.joint_states import JointStates
from gepf.coordinator.sources.live import LiveFrames, from_first_seen
from gepf.coordinator.sources.live_stream import LiveCamera, colour_key, is_topic
from gepf.coordinator.sources.ros2 import Node
from gepf.coordinator.sources.ros2_input import DepthTopic, JointTopic
from gepf.coordinator.sources.source import select_frames
from gepf.coordinator.tracking.reporting import TrackedFrame
from gepf.coordinator.tracking.state import read_start
from gepf.coordinator.tracking.target import resolve

logger = logging.getLogger(__name__)

Streams = Generator[Iterator[Frame], None, None]

MEND_STREAM = "check that its publisher is running with this key and endpoint, and sends depth above 0"
LEFT_OUT = {"skipped": "for newer frames", "rejected": "do not fit the stream", "malformed": "malformed"}
"""Counts of live input that are shown, and why these messages were left out."""


class Input:
    """The input of a run: frames, bodies, start, scope. Live input has no source."""

    source: Source | None = None
    total: int | None = None  # frames
    live: LiveFrames | None = None
    truth: Truth | None = None
    colours: ColourFolder | None = None  # for pictures
    finder: KeypointFinder | None = None  # of keypoints in colour images

    def __init__(self, job: Job, source: Source | None, first: Source | LiveCamera) -> None:
        self.bodies = choose_bodies(job.active, job.settings.preset, job.model)
        self.job = job = replace(job, settings=resolve(job.settings, self.bodies.family))
        self.start = choose_start(job.init, source, self.bodies.dof_names) if job.people == 1 else None
        up = None
        if job.settings.rotate_deg is not None:
            turn = np.radians(job.settings.rotate_deg)
            up = first.T_rig_camera[:3, :3] @ np.array([-np.sin(turn), -np.cos(turn), 0.0])
        elif source is not None and source.gravity is not None:
            up = -source.gravity
        background = None if job.background is None else read_background(job.background, source)
        self.scope = replace(job.scope, background=background, up=up, camera=first.camera)

    @property
    def may_use_colour(self) -> bool:
        """Whether keypoints in colour are of use: for people, unless the user or the method excludes them."""
        has_keypoints = self.bodies.family.has_keypoints
        return has_keypoints and self.job.settings.refine.sensor == "camera" and not self.job.no_color

    def announce(self, _done: int) -> str:
        """A message on what is tracked and how; `_done` is the number of frames that are already recorded."""
        job = self.job
        people = f", up to {job.people} people" if job.people > 1 else ""
        particles = counted(job.settings.filter.particles, "particle")
        into = "" if job.out is None else f" into {job.out}"
        return f"tracking {job.sequence}{into} with {self.by}: {job.settings.method}, {particles}{people}"

    @property
    def by(self) -> str:
        """The images that are used for tracking, in words."""
        return "depth alone" if self.finder is None else "depth and colour"

    def describe(self, tracked: TrackedFrame, rate: FrameRate) -> str:
        """A tracked frame in a short line; for live input, also what was left out and why."""
        first, *rest = (person.estimate for person in tracked.people)
        others = "".join(f"; person {n} {estimate.status}" for n, estimate in enumerate(rest, 2))
        per_second = rate.per_second if self.live is None else rate.latest_per_second
        said = describe_frame(first, per_second, rate.latency_s, self.bodies.family.noun) + others
        counts = {} if self.live is None else self.live.counts
        left_out = ", ".join(f"{counts[kind]} {why}" for kind, why in LEFT_OUT.items() if counts.get(kind))
        said += f"; left out: {left_out}" if left_out else ""
        unseen = 0 if self.finder is None else self.finder.left_out
        return said + (f"; colour of {counted(unseen, 'frame')} left out under load" if unseen else "")

    def configure(self, recording: Mapping[str, object]) -> RunConfiguration:
        """The configuration of the run: what is tracked, and all options that affect the results."""
        job, content = self.job, self.bodies.content
        start = json.dumps(self.start, sort_keys=True).encode()
        configuration = {
            **recording,
            "model": {"name": Path(job.model).name, "content": content and content[:12]},
            "dof": None if job.active is None else ",".join(job.active),
            "init": AUTOMATIC if self.start is None else digest(start),
            "joint_states": None if job.joint_states is None else job.joint_states.hash,
            "settings": msgspec.to_builtins(job.settings),
            "scene": self.scope.describe(),
            "worker_kind": job.pool.kind,
            "keypoints": None if self.finder is None else NETWORK,
            "versions": {"gepf": versions().get("gepf")},
        }
        if job.people > 1:
            configuration[PEOPLE] = job.people
        plain: RunConfiguration = msgspec.json.decode(msgspec.json.encode(configuration))
        return plain


def check_pixels(scope: Scope, camera: Intrinsics) -> None:
    """InputError if pixels that the user gave are not in the images."""
    size, region, person = f"{camera.width}x{camera.height}", scope.region, scope.person
    if region is not None and (
        region[0] >= camera.width or region[1] >= camera.height or min(region[2:]) <= 0
    ):
        raise InputError(f"--roi lies outside the {size} images; give left,top,right,bottom inside them")
    if not isinstance(person, str):
        column, row = person
        if not (0 <= column < camera.width and 0 <= row < camera.height):
            raise InputError(f"--person {column},{row} is outside the {size} images; give a pixel inside")


class RecordedInput(Input):
    """A recording, of which every frame is tracked. InputError if it does not fit the options."""

    source: Source
    total: int

    def __init__(self, job: Job) -> None:
        color = not job.no_color if job.color is None else job.color
        coloured = open_source(job.sequence, job.given, color=color)
        self.source = source = coloured.without_colours()
        self.numbers = numbers = select_frames(source.numbers, job.frames)
        self.total = len(numbers)
        check_pixels(job.scope, source.intrinsics)
        super().__init__(job, source, source)
        if self.may_use_colour:
            self.source = source = self._choose(coloured)
        if isinstance(job.joint_states, JointStates):
            job.joint_states.check_names(self.bodies.dof_names)
        # with several people, the sequence's truth does not say whose it is
        own = source.truth if job.people == 1 else None
        self.truth = None if own is None else read_truth(own, source.T_rig_camera)
        if job.color:
            mirrored = bool(source.mirrored)
            self.colours = ColourFolder(job.color, source.intrinsics, numbers, mirrored=mirrored)
        for view in source.views:
            for doubt in find_doubts(view, self.bodies.family.nearest_m):
                logger.warning("%s: %s", view.camera or source.name, doubt)
        first = source.frame(numbers[0])
        path, given = job.sequence.resolve(), job.given
        recording: dict[str, object] = {
            "sequence": path.name,
            PATH: str(path),
            "first_frame": digest_view(first.views[0]),
            "frame_range": f"{numbers[0]}:{numbers[-1] + 1}",
        }
        if self.finder is not None:
            images = (view.colours.tobytes() for view in first.views if view.colours is not None)
            recording["first_colour"] = digest(b"".join(images))
        if source.camera:
            views = [(each.camera, each.T_rig_camera.tolist(), digest_view(each)) for each in first.views]
            recording["rig"] = digest(repr(views).encode())
        if given != AS_RECORDED:
            lens = given.intrinsics and list(given.intrinsics)
            recording[CAMERA_GIVEN] = {
                "lens": lens,
                "depth_scale": given.depth_scale,
                **({} if given.mirrored is None else {"mirrored": given.mirrored}),
            }
        self.configuration = self.configure(recording)

    def _choose(self, coloured: Source) -> Source:
        """The recording with its colour images; without them, after a warning, if they cannot be used."""
        fit = list[bool]()
        for view in coloured.views:
            numbers = self.numbers if view is coloured.views[0] else view.numbers
            places = np.unique(np.linspace(0, len(numbers) - 1, 10).astype(int))  # ten frames
            if view.colours is not None:
                fit += [view.colours(numbers[place]) is not None for place in places]
        if not fit:
            return self.source
        if not any(fit):
            logger.warning(
                "colour is not used: none of the examined colour images has the shape of the depth images; "
                "register colour to depth, or give --no-color"
            )
            return self.source
        if not all(fit):
            logger.warning("some frames have no colour image; they are tracked by depth alone")
        try:
            self.finder = KeypointFinder()
        except MissingPackage as missing:
            logger.warning("%s; or give --no-color", without_colour(missing))
            return self.source
        return coloured

    def announce(self, done: int) -> str:
        """A message on the frames and how they are tracked, or where a resumed run continues."""
        job, total, camera = self.job, self.total, self.source.intrinsics
        if done and done == total:
            return f"all {total} frames are recorded in {job.out}; writing the results"
        if done:
            return f"continuing with frame {self.numbers[done]}; {done} of {total} frames are recorded"
        if job.resume:
            return f"nothing to resume in {job.out}; starting with the first frame"
        return f"{super().announce(done)}; {counted(total, 'frame')} of {camera.width}x{camera.height}"

    def streams(self, _workers: ZenohRefiner, _node: Node | None, done: int) -> Streams:
        """One stream: the frames that are not recorded yet."""
        yield map(self.source.frame, self.numbers[done:])

    def facts(self) -> dict[str, object]:
        """The path of the colour frames for pictures."""
        return {"color": None if self.job.color is None else str(self.job.color)}


def refuse_options_of_recordings(job: Job) -> None:
    """InputError if options of recorded sequences are given with live input."""
    if job.resume:
        raise InputError("--resume is for recorded sequences; finish a killed live run with gepf report")
    for option, value in (
        ("--frames", job.frames),
        ("--color", job.color),
        ("--intrinsics", job.given.intrinsics),
        ("--depth-scale", job.given.depth_scale),
        ("--mirrored", job.given.mirrored),
    ):
        if value:
            raise InputError(f"{option} is for recorded sequences; leave it out with live input")


class LiveInput(Input):
    """Published frames, of which the newest is tracked. InputError for options of recordings."""

    def __init__(self, job: Job, cameras: Sequence[LiveCamera], show: Show) -> None:
        refuse_options_of_recordings(job)
        if not vendor_of(job.sequence) and job.pool.listen is None and job.pool.connect is None:
            raise InputError("a publisher needs an endpoint; add --listen ENDPOINT or --connect ENDPOINT")
        holder = holder_name(job.pool.security)
        if holder and (vendor := vendor_of(job.sequence)):
            cameras = [replace(each, key=of_live(holder, vendor)) for each in cameras]
        keys = [each.key for each in cameras]
        if not is_topic(keys[0]):
            for key in keys:
                check_stream(key, holder)
            job = replace(job, results=job.results or results_key(keys[0]))
        self.keys, self._show = " and ".join(keys), show
        if job.record is not None:
            with_parent(job.record)
        super().__init__(job, None, cameras[0])
        self._unused = ""  # why colour is not used, until the user has been told
        if self.may_use_colour:
            try:
                self.finder = KeypointFinder()
            except MissingPackage as missing:
                self._unused = f"{without_colour(missing)}; or give --no-color"
        self.live: LiveFrames = LiveFrames(cameras, show.say, idle=job.idle_timeout)
        rig = {c.camera: [c.key, c.T_rig_camera.tolist(), c.offset_s] for c in cameras if c.camera}
        self.configuration = self.configure({"sequence": str(job.sequence), **({"rig": rig} if rig else {})})
        self._attached = None
        if vendor_of(job.sequence):
            self._attached = AttachedCamera(job.sequence, show.say, colour=self.finder is not None)
            self._say_unused()
        self._failure: Exception | None = None  # of the attached camera
        self._recorder = None if job.record is None else FrameRecorder(job.record, cameras, show.say)

    def streams(self, workers: ZenohRefiner, node: Node | None, _done: int) -> Streams:
        """The newest frames until the publisher ends; each stream starts with its first frame with depth.

        Raises the error of the attached camera after its last frame.
        """
        self._show.say(f"listening on {self.keys}{self._not_stored}")
        with ExitStack() as stack:
            if self._attached is not None:
                self._attach(self._attached, workers.speak(self.keys), stack)
            elif node is not None and is_topic(self.keys):
                DepthTopic(node, self.keys, self.live, colour=self.finder is not None)
                self._say_unused()
                if isinstance(self.job.joint_states, JointTopic):
                    self.job.joint_states.listen(node, self.bodies.dof_names, self._show.say)
            else:
                for place, camera in enumerate(self.live.cameras):
                    if self._recorder is not None or self.finder is not None or self._unused:
                        put = partial(self._put_colour, place, camera.camera)
                        workers.listen(colour_key(camera.key), put)
                    workers.listen(camera.key, partial(self.live.receive, place=place))
            for _, frames in groupby(self.live, lambda _: self.live.stream):
                yield map(self._take, from_first_seen(frames, self._show.say))
        if self._failure is not None:
            raise self._failure

    @property
    def by(self) -> str:
        """The images that are used for tracking, in words; no frame waits for colour."""
        return "depth alone" if self.finder is None else "depth, and colour if it arrives in time"

    @property
    def is_too_slow(self) -> bool:
        """Whether most frames were left out for newer ones."""
        return 2 * self.live.counts["skipped"] > self.live.counts["received"]

    @property
    def _not_stored(self) -> str:
        """What happens to the results of a run without a folder."""
        if self.job.out is not None:
            return ""
        where = f"published on {self.job.results}" if self.job.results else "shown"
        return f"; results are {where}, not stored (--out DIR stores them)"

    def _attach(self, camera: AttachedCamera, outlet: Publisher, stack: ExitStack) -> None:
        """Receive the frames of a camera, and publish them for others, on a thread until the stack's end.

        An error ends the stream, and is kept to be raised then.
        """

        def put(payload: bytes) -> None:
            self.live.receive(payload)
            outlet.put(payload)

        def receive() -> None:
            try:
                play(camera, put, put, partial(self._put_colour, 0, ""))
            except Exception as error:  # noqa: BLE001 the main thread raises it
                self._failure = error

        thread = threading.Thread(target=receive, daemon=True)
        thread.start()
        stack.callback(thread.join)
        stack.callback(camera.close)

    def _put_colour(self, place: int, camera: str, payload: bytes) -> None:
        """Keep a colour image for its frame, and for the recording."""
        if self._recorder is not None:
            self._recorder.put_colour(camera, payload)
        if self.finder is not None:
            self.live.receive_colour(payload, place=place)
        self._say_unused()

    def _say_unused(self) -> None:
        """Say once why colour is not used."""
        if self._unused:
            self._show.say(self._unused)
            self._unused = ""

    def _take(self, frame: Frame) -> Frame:
        """Record the frame, if requested, and return it; InputError if the empty room has another size."""
        for view in frame.views:
            if view.camera == self.scope.camera:
                check_size(self.job.background, self.scope.background, view.depth.shape)
        if self._recorder is not None:
            self._recorder.put(frame)
        return frame

    def facts(self) -> dict[str, object]:
        """Counts of the messages, after the frames are written."""
        facts: dict[str, object] = {f"frames_{name}": count for name, count in self.live.counts.items()}
        if self.finder is not None:
            facts["frames_without_keypoints"] = self.finder.left_out
        if self._attached is not None:
            facts["frames_dropped"] = self._attached.dropped
        if self._recorder is not None:
            facts["frames_unwritten"] = unwritten = self._recorder.close()
            folders = " and ".join(map(str, self._recorder.folders)) or "no folder"
            missing = f"; {unwritten} could not be written in time" if unwritten else ""
            self._show.say(f"{counted(self._recorder.written, 'frame')} are in {folders}{missing}")
        return facts


def choose_start(
    init: str | None, source: Source | None, dof_names: tuple[str, ...]
) -> Mapping[str, float] | None:
    """The start pose of a file, else of the sequence's own file; None to detect it."""
    if init is None and source is not None and source.init is not None:
        return read_start(source.init, dof_names, "; check --model, or ignore this file with --init auto")
    return None if init in (None, AUTOMATIC) else read_start(Path(init), dof_names)
