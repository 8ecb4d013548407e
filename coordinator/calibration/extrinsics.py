"""Camera poses as other tools write them: Kalibr's camchain, static transforms of ROS, or matrices."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.camera import inverse, rigid
from gepf.common.errors import InputError

CameraExtrinsics = tuple[Array, float]
"""T_world_camera (4, 4), metres, and the clock offset in seconds; camera time plus offset is the common
time."""

KNOWN = (
    "give Kalibr's camchain.yaml, a file of ros2 topic echo --once /tf_static, or a folder with NAME.txt or "
    "NAME.npy for each camera: 4 x 4, camera to world, metres"
)


def read_poses(path: Path, names: Sequence[str]) -> dict[str, CameraExtrinsics]:
    """The poses of cameras by name, in the frame and the time of the first one.

    Kalibr's cameras are in the order of the names. Frames of ROS and files of matrices have the names of
    cameras. Raises InputError if one is missing, or if the file is of no known kind.
    """
    try:
        found = read_folder(path, names) if path.is_dir() else read_yaml(path, names)
    except (OSError, UnicodeDecodeError, YAMLError, KeyError, TypeError, ValueError, np.linalg.LinAlgError):
        found = None
    if found is None:
        raise InputError(f"{path} is not a readable calibration; {KNOWN}")
    back, earlier = inverse(found[names[0]][0]), found[names[0]][1]
    return {name: (back @ found[name][0], found[name][1] - earlier) for name in names}


def read_folder(path: Path, names: Sequence[str]) -> dict[str, CameraExtrinsics]:
    """Matrices camera to world, one file for each camera."""
    found = dict[str, CameraExtrinsics]()
    for name in names:
        file = next((path / f"{name}{end}" for end in READERS if (path / f"{name}{end}").is_file()), None)
        if file is None:
            raise InputError(f"{path} has no {name}.txt or {name}.npy; {KNOWN}")
        found[name] = np.reshape(READERS[file.suffix](file), (4, 4)).astype(np.float64), 0.0
    return found


READERS: dict[str, Callable[[Path], Any]] = {
    ".txt": np.loadtxt,
    ".npy": lambda file: np.load(file, allow_pickle=False),
}


def read_yaml(path: Path, names: Sequence[str]) -> dict[str, CameraExtrinsics] | None:
    """The poses in a YAML file; None if it is of no known kind."""
    yaml = YAML(typ="safe", pure=True)
    parts = [each for each in yaml.load_all(path.read_text(encoding="utf-8")) if each]
    if parts and all("transforms" in each for each in parts):
        return of_transforms([each for part in parts for each in part["transforms"]], names, path)
    return of_camchain(parts[0], names, path) if len(parts) == 1 and "cam0" in parts[0] else None


def of_camchain(chain: Mapping[str, Any], names: Sequence[str], path: Path) -> dict[str, CameraExtrinsics]:
    """Kalibr: T_cn_cnm1 maps from the camera before; camera's time + timeshift_cam_imu = the IMU's time."""
    found, transform = dict[str, CameraExtrinsics](), np.eye(4)
    for n, name in enumerate(names):
        if (camera := chain.get(f"cam{n}")) is None:
            raise InputError(
                f"{path} has no cam{n} for {name}; give the recordings in the order of its cameras"
            )
        if n > 0:
            step = np.reshape(np.array(camera["T_cn_cnm1"], dtype=np.float64), (4, 4))
            transform = transform @ inverse(step)
        found[name] = transform, float(camera.get("timeshift_cam_imu", 0.0))
    return found


def of_transforms(
    transforms: Sequence[Mapping[str, Any]], names: Sequence[str], path: Path
) -> dict[str, CameraExtrinsics]:
    """ROS: each transform maps from child_frame_id to header.frame_id; a camera is named as its frame."""
    parents = dict[str, tuple[str, Array]]()
    for each in transforms:
        at, turn = each["transform"]["translation"], each["transform"]["rotation"]
        rotation = Rotation.from_quat([turn[k] for k in "xyzw"]).as_matrix()
        step = rigid(rotation, np.array([at[k] for k in "xyz"]))
        parents[each["child_frame_id"]] = each["header"]["frame_id"], step
    found, roots = dict[str, CameraExtrinsics](), set[str]()
    for name in names:
        optical, transform = f"{name}_depth_optical_frame", np.eye(4)
        if name not in parents and optical not in parents:
            raise InputError(
                f"{path} has no frame {name} or {optical}, but {', '.join(sorted(parents))}; "
                "give the recording's folder the name of its frame"
            )
        frame = name if name in parents else optical
        for _ in range(len(parents)):
            if frame not in parents:
                break
            frame, step = parents[frame]
            transform = step @ transform
        roots.add(frame)
        found[name] = transform, 0.0
    if len(roots) > 1:
        raise InputError(f"{path} does not connect the frames of all cameras; add the transform between them")
    return found
