"""The film of a run, read back by PyAV."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
from PIL import Image

from common.camera import Intrinsics
from coordinator.pictures.film import whole_view, write_film


def test_a_film_plays_in_real_time_at_the_cameras_size(tmp_path: Path) -> None:
    """Every picture is there at its own time, gaps too, of the camera's size without an odd last row."""
    view = whole_view(Intrinsics(65, 48, 60.0, 60.0, 32.0, 24.0))
    assert (view.width, view.height) == (64, 48)
    times, greys = np.array([5.0, 5.033, 5.1, 5.4]), (20, 90, 160, 230)
    pictures = [Image.new("RGB", (64, 48), (grey, grey, grey)) for grey in greys]
    write_film(iter(pictures), (64, 48), times, tmp_path / "overlay.mp4")
    with av.open(str(tmp_path / "overlay.mp4")) as film:
        stream = film.streams.video[0]
        assert (stream.width, stream.height, stream.codec_context.name) == (64, 48, "h264")
        shown = [(frame.time, frame.to_ndarray(format="rgb24").mean()) for frame in film.decode(video=0)]
    assert np.allclose([time for time, _ in shown], times - 5.0, atol=1e-3)
    assert np.allclose([grey for _, grey in shown], greys, atol=6.0)
