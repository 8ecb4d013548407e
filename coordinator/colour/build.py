"""Extracts the network from an npm package: python -m gepf.coordinator.colour.build PACKAGE [FILE].

PACKAGE is the file that `npm pack @mediapipe/pose@0.5.1675469404` writes. Newer versions contain no networks.
"""

from __future__ import annotations

import argparse
import hashlib
import tarfile
from pathlib import Path

from gepf.common.errors import InputError
from gepf.coordinator.colour.network import FILE

MEMBER = "package/pose_landmark_lite.tflite"
SHA256 = "f17bfbecadb61c3be1baa8b8d851cc6619c870a87167b32848ad20db306b9d61"


def extract(package: Path) -> bytes:
    """The network in a package; InputError if it is not the one that is expected."""
    try:
        with tarfile.open(package) as archive:
            member = archive.extractfile(MEMBER)
            content = b"" if member is None else member.read()
    except (OSError, tarfile.TarError, KeyError) as error:
        raise InputError(f"{package} does not contain {MEMBER} ({error}); give another package") from error
    if (found := hashlib.sha256(content).hexdigest()) != SHA256:
        raise InputError(f"{MEMBER} of {package} has the SHA-256 {found}, expected {SHA256}")
    return content


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("package", type=Path, help="mediapipe-pose-0.5.1675469404.tgz")
    parser.add_argument("file", type=Path, nargs="?", default=FILE)
    options = parser.parse_args()
    options.file.write_bytes(extract(options.package))
