"""`gepf view`: shows a run, or live frames and results, in a browser, or writes them to a file."""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Callable
from urllib.parse import quote

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gepf.common.body import BodyModel, with_fixed_shape
from gepf.common.errors import BusError, GepfError, InputError, ProtocolError
from gepf.common.frame import View
from gepf.common.protocol.frames import decode_live, number_of
from gepf.common.protocol.keys import check_stream
from gepf.common.protocol.models import decode_model
from gepf.common.recent import MODELS_KEPT, put_recent
from gepf.common.transport.bus import Bus
from gepf.common.transport.session import holder_name
from gepf.coordinator.commands.console import INTERRUPTS
from gepf.coordinator.commands.finished import find_sequence
from gepf.coordinator.commands.options import SecurityOptions, ViewOptions
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.commands.publish import reach_partner
from gepf.coordinator.notices import NOTICE_S
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.results.killed import finish_killed
from gepf.coordinator.results.live_results import Result, read_result, results_key
from gepf.coordinator.results.track import filled, read_track, read_tracked_body
from gepf.coordinator.sources.camera import DEFAULT_FPS
from gepf.coordinator.sources.frame_recorder import WAITING_FRAMES
from gepf.coordinator.sources.live_stream import is_topic, live_key
from gepf.coordinator.viewing import FrameLog, PersonLog, layout

Take = Callable[[], list[tuple[str, bytes]]]
"""Returns new messages with their keys."""


class LiveScene:
    """The newest published frames and results.

    A frame is decoded only if it is shown, and a result that was not shown is replaced by the next one.
    `report` is called with a message for the user when frames or results are missing, and at the first
    malformed message.
    """

    def __init__(
        self, frames: Take, results: Take, report: Callable[[str], None], notice: float = NOTICE_S
    ) -> None:
        self._take_frames, self._take_results, self._report, self._notice = frames, results, report, notice
        self.frames: dict[int, bytes] = {}  # by number, the newest last
        self._frame_at = self._result_at = time.monotonic()  # when the last one came
        self._tracked = False  # whether a result has ever come
        self._said = set[str]()
        self.ended = False  # nothing more comes, unless the publisher or tracker is started again

    def take_results(self) -> dict[str, Result]:
        """The newest results by key; empty if none comes for a while."""
        taken = dict[str, Result]()
        for _ in range(3):  # 0.2 s without results, then depth is shown alone
            if taken:
                break
            time.sleep(2.0 / DEFAULT_FPS)  # for half of a usual camera's frames
            messages = self._take_results()
            for key, payload in self._take_frames():
                self._receive_frame(key, payload)
            for key, payload in messages:
                self._receive_result(key, payload, taken)
        now = time.monotonic()
        if now - self._frame_at > self._notice:
            self._say_once("no frame arrives; check that a publisher is running with this key and endpoint")
        elif now - self._result_at > self._notice:
            self._say_once(
                "frames arrive, but no results; check that gepf track is running, and that --results is the "
                "key of its --publish"
            )
        return taken

    def image(self, number: int) -> View | None:
        """The image with a number; None if it did not come or is too old."""
        payload = self.frames.get(number)
        return None if payload is None else self._decode("the key of frames", payload)

    def _receive_frame(self, key: str, payload: bytes) -> None:
        try:
            put_recent(self.frames, number_of(payload), payload, WAITING_FRAMES)
        except ProtocolError:
            self.ended = self.ended or (self._decode(key, payload) is None and not self._tracked)
            return
        self._frame_at, self.ended = time.monotonic(), self.ended and self._tracked

    def _receive_result(self, key: str, payload: bytes, taken: dict[str, Result]) -> None:
        """Keep a result in place of an older one."""
        try:
            result = read_result(payload)
        except ProtocolError as error:
            self.report_malformed(key, error)
            return
        self._result_at, self._tracked, self.ended = time.monotonic(), True, result is None
        if result is not None:
            taken[key] = result

    def report_malformed(self, key: str, error: Exception) -> None:
        """Report a malformed message, once for each key."""
        self._say_once(f"a message on {key} is malformed", f": {error}")

    def _say_once(self, line: str, detail: str = "") -> None:
        if line not in self._said:
            self._said.add(line)
            self._report(line + detail)

    def _decode(self, key: str, payload: bytes) -> View | None:
        try:
            return decode_live(payload)
        except ProtocolError as error:
            self.report_malformed(key, error)
            return None


logger = logging.getLogger(__name__)


def run_view(options: ViewOptions, security: SecurityOptions, show: Show) -> None:
    """Write a file for the rerun viewer if `options.save` names one, else serve the viewer to a browser."""
    key = live_key(options.run)
    if is_topic(key):  # its images have no numbers, by which results are found
        raise InputError(
            "gepf view does not show topics of ROS 2; "
            "use RViz, also for results of gepf track --publish ros2:/TOPIC"
        )
    live = {"--results": options.results, "--listen": options.listen, "--connect": options.connect}
    for option, value in ({"--sequence": options.sequence} if key else live).items():
        if value is not None:
            kind = "a run" if key else "live input (zenoh:KEY)"
            raise InputError(f"{option} is only for viewing {kind}; leave it out here")
    if options.save is not None and not options.save.parent.is_dir():
        raise InputError(f"no such folder: {options.save.parent}; give --save a file in an existing folder")
    if key is None:
        view_run(options, show)
    else:
        view_live(options, key, security, show)


def view_run(options: ViewOptions, show: Show) -> None:
    """Show a run; a browser can be connected until an interrupt."""
    finish_killed(options.run)
    track = filled(read_track(options.run))
    source = find_sequence(options.run, options.sequence)
    if source is None:
        logger.warning("the sequence of this run was moved; --sequence SEQ shows its depth as well")
    middle = np.nanmean(track.joint_positions[:1], axis=(0, 1))
    recording, address = open_viewer(options, layout(middle, track.up))
    model = read_tracked_body(options.run).model
    with show.steps("preparing frames") as advance:
        view, person = FrameLog(recording), PersonLog(recording)
        for f, number in enumerate(track.frame.tolist()):
            image = None if source is None else source.view(number)
            view.log(number, float(track.time_s[f]), image)
            person.log(track, f, model)
            advance(f + 1, len(track.frame))
        recording.flush()
    if address is not None:
        show.say(f"open {address} in a browser")
        show.say("press Ctrl-C to end")
        signal.pause()


def view_live(options: ViewOptions, key: str, security: SecurityOptions, show: Show) -> None:
    """Show published frames and results until an interrupt; a file ends with the results, too."""
    secured = security.choose(options.listen, options.connect)
    holder = holder_name(secured)
    check_stream(key, holder)
    results = check_stream(options.results or results_key(key), holder)
    reached = Pool(0, options.listen, options.connect, secured)
    with reach_partner(reached, "publisher", key, show) as bus:
        newest_results = bus.subscribe_newest(
            f"{results}/**", WAITING_FRAMES
        )  # several people have keys below it
        scene = LiveScene(bus.subscribe_newest(key, WAITING_FRAMES), newest_results, show.say)
        recording, address = open_viewer(options, layout(live=True))
        show.say(f"showing {key}, and results on {results}")
        show.say(f"writing {options.save}; Ctrl-C ends" if address is None else f"see {address}; Ctrl-C ends")
        view = LiveView(recording, bus, scene, results)
        try:
            while view.step() or not scene.ended or address is not None:
                INTERRUPTS.check()
        except KeyboardInterrupt:  # ends a file, as the end of the results does
            INTERRUPTS.noted = False
        recording.flush()


def open_viewer(options: ViewOptions, blueprint: rrb.Blueprint) -> tuple[rr.RecordingStream, str | None]:
    """A recording that is written to a file, or served in a browser at an address."""
    recording = rr.RecordingStream("gepf")
    if options.save is not None:
        recording.save(options.save, default_blueprint=blueprint)
        return recording, None
    # nothing is stored, and the viewer suppresses interrupts
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    try:
        server = recording.serve_grpc(grpc_port=options.port + 1, default_blueprint=blueprint)
        rr.serve_web_viewer(web_port=options.port, open_browser=options.browser, connect_to=server)
    except (OSError, RuntimeError, ValueError) as error:
        raise GepfError(f"the viewer did not start ({error}); try another --port") from error
    return recording, f"http://localhost:{options.port}?url={quote(server, safe='')}"


class LiveView:
    """Logs the newest results with their frames."""

    def __init__(self, recording: rr.RecordingStream, bus: Bus, scene: LiveScene, results: str) -> None:
        self._recording, self._bus, self._scene, self._results = recording, bus, scene, results
        self._began = time.monotonic()
        self._frames = FrameLog(recording)
        self._people: dict[str, PersonLog] = {}  # by key
        self._bodies: dict[str, BodyModel] = {}  # by key
        self._shown: int | None = None  # number of the last frame
        self._centred = False  # the eye, on a person

    def step(self) -> bool:
        """Log new results, or depth alone if there are none; returns whether there were results."""
        results = self._scene.take_results()
        for key, result in results.items():
            self._log_result(key, result)
        newest = next(reversed(self._scene.frames), None)
        if not results and newest is not None and newest != self._shown:
            self._frames.log(newest, time.monotonic() - self._began, self._scene.image(newest))
            self._shown = newest
        self._recording.flush()
        return bool(results)

    def _log_result(self, key: str, result: Result) -> None:
        track, number = result.track, int(result.track.frame[0])
        self._frames.log(number, time.monotonic() - self._began, self._scene.image(number))
        self._shown = number
        if key not in self._people:
            self._people[key] = PersonLog(self._recording, key.removeprefix(self._results).strip("/"))
        self._people[key].log(track, 0, self._find_body(result))
        if track.placed[0] and not self._centred:
            middle = np.nanmean(track.joint_positions[0], axis=0)
            self._recording.send_blueprint(layout(middle, live=True))
            self._centred = True

    def _find_body(self, result: Result) -> BodyModel | None:
        """The tracked body; None if the tracker does not say it, or does not have it yet."""
        if result.body is None:
            return None
        if result.body not in self._bodies:
            try:
                payload = self._bus.fetch(result.body)
                if payload is None:
                    return None
                put_recent(self._bodies, result.body, decode_model(payload), MODELS_KEPT)
            except (BusError, ProtocolError) as error:
                self._scene.report_malformed(result.body, error)
                return None
        body = self._bodies[result.body]
        if len(result.shape) != body.shape_count:
            return None
        body = with_fixed_shape(body, result.shape)
        names = body.dof_names, body.joint_names
        return body if names == (result.track.dof_names, result.track.joint_names) else None
