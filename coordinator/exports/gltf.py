"""glTF 2.0: the body's surface with its skin, and the motion of its bones, for viewers and game engines.

Metres and radians (quaternions), y up; a person who faces the camera looks along +z; the origin is the
camera. The surface uses linear blend skinning with the weights of the body, so it is the tracked surface.
Time starts at 0 with the first frame. Lost frames have the reported pose. The `extras` of the animation have
the number and status of every frame.
"""

from __future__ import annotations

from typing import BinaryIO

import numpy as np
import pygltflib as gl
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gepf.common.activation import merge_weights
from gepf.common.body import BodyModel, vertex_normals
from gepf.coordinator.exports.axes import CAMERA_TO_Y_UP
from gepf.coordinator.exports.bones import Bone, bones_of, children, continuous, motion_of, offset, slides
from gepf.coordinator.exports.recorded import RecordedRun
from gepf.coordinator.palette import PALETTE
from gepf.coordinator.sources.source import rising

COMPONENT_TYPES = {"u2": gl.UNSIGNED_SHORT, "u4": gl.UNSIGNED_INT, "f4": gl.FLOAT}


def write_glb(run: RecordedRun, file: BinaryIO) -> None:
    """One binary file."""
    file.write(b"".join(scene_of(run).save_to_bytes()))


def write_gltf(run: RecordedRun, file: BinaryIO) -> None:
    """One JSON file, with the arrays inside as text."""
    scene = scene_of(run)
    scene.convert_buffers(gl.BufferFormat.DATAURI)
    file.write(scene.to_json().encode())


def scene_of(run: RecordedRun) -> gl.GLTF2:
    """The whole scene."""
    model = run.body().model
    bones = bones_of(model)
    gltf = gl.GLTF2(asset=gl.Asset(generator="gepf", version="2.0"), scene=0, scenes=[gl.Scene(nodes=[0])])
    arrays = Arrays(gltf)
    gltf.nodes = [
        gl.Node(name=bone.name, translation=offset(bones, bone).tolist(), children=children(bones, b) or None)
        for b, bone in enumerate(bones)
    ]
    if bones[0].dof < 0:  # the fixed root is rotated here, once
        level = run.from_camera(CAMERA_TO_Y_UP) @ CAMERA_TO_Y_UP
        gltf.nodes[0].rotation = Rotation.from_matrix(level).as_quat().tolist()
        gltf.nodes[0].translation = (level @ bones[0].origin).tolist()
    if len(model.triangles):
        colour = [*PALETTE.exported_body, 1.0]
        looks = gl.PbrMetallicRoughness(baseColorFactor=colour, metallicFactor=0.0, roughnessFactor=0.8)
        gltf.materials = [gl.Material(pbrMetallicRoughness=looks)]
        add_surface(gltf, arrays, model, bones)
        gltf.nodes.append(gl.Node(name=model.name, mesh=0, skin=0))
        gltf.scenes[0].nodes.append(len(bones))
    gltf.animations = [animation_of(arrays, run, model, bones)]
    gltf.buffers = [gl.Buffer(byteLength=len(arrays.blob))]
    gltf.set_binary_blob(bytes(arrays.blob))
    return gltf


class Arrays:
    """The file's one buffer, filled array by array."""

    def __init__(self, gltf: gl.GLTF2) -> None:
        self.blob = bytearray()
        self._gltf = gltf

    def add(self, array: NDArray[np.generic], form: str, target: int | None = None) -> int:
        """Add an array with rows of a type such as VEC3; returns the index of its accessor."""
        kind = COMPONENT_TYPES[array.dtype.str[1:]]
        data = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<")).tobytes()
        self._gltf.bufferViews.append(
            gl.BufferView(buffer=0, byteOffset=len(self.blob), byteLength=len(data), target=target)
        )
        self.blob += data + bytes(-len(data) % 4)
        rows = array.reshape(len(array), -1)
        accessor = gl.Accessor(
            bufferView=len(self._gltf.bufferViews) - 1, componentType=kind, count=len(array), type=form
        )
        accessor.min, accessor.max = rows.min(axis=0).tolist(), rows.max(axis=0).tolist()
        self._gltf.accessors.append(accessor)
        return len(self._gltf.accessors) - 1


def add_surface(gltf: gl.GLTF2, arrays: Arrays, model: BodyModel, bones: tuple[Bone, ...]) -> None:
    """The mesh in the rest pose, and its skin."""
    carrying = {int(dof) for dof in model.link_dofs[model.skin_links[model.skin_weights > 0]]}
    first = {bone.dof: b for b, bone in reversed(list(enumerate(bones)))}
    moving = sorted(first[dof] for dof in carrying)  # one bone for the last degree of freedom of each link
    joints, weights = skin_of(model, bones, moving)
    vertices = model.vertices @ CAMERA_TO_Y_UP
    attributes = gl.Attributes(
        POSITION=arrays.add(vertices.astype(np.float32), "VEC3", gl.ARRAY_BUFFER),
        NORMAL=arrays.add(vertex_normals(vertices, model.triangles), "VEC3", gl.ARRAY_BUFFER),
        JOINTS_0=arrays.add(joints, "VEC4", gl.ARRAY_BUFFER),
        WEIGHTS_0=arrays.add(weights, "VEC4", gl.ARRAY_BUFFER),
    )
    indices = arrays.add(model.triangles.ravel().astype(np.uint32), "SCALAR", gl.ELEMENT_ARRAY_BUFFER)
    surface = gl.Primitive(attributes=attributes, indices=indices, material=0)
    gltf.meshes = [gl.Mesh(name=model.name, primitives=[surface])]
    back = np.tile(np.eye(4, dtype=np.float32), (len(moving), 1, 1))
    back[:, 3, :3] = [-bones[b].origin for b in moving]  # column by column
    gltf.skins = [gl.Skin(joints=moving, skeleton=0, inverseBindMatrices=arrays.add(back, "MAT4"))]


def skin_of(
    model: BodyModel, bones: tuple[Bone, ...], moving: list[int]
) -> tuple[NDArray[np.uint16], NDArray[np.float32]]:
    """Positions (V, 4) in the skin's list of bones, and weights (V, 4) that sum to 1, the largest first."""
    place = {bones[b].dof: i for i, b in enumerate(moving)}
    of_link = np.array([place.get(int(dof), 0) for dof in model.link_dofs])
    links, weights = merge_weights(of_link[model.skin_links], model.skin_weights)
    links = np.pad(links, ((0, 0), (0, 4)))[:, :4]  # glTF has four links per vertex
    weights = np.pad(weights, ((0, 0), (0, 4)))[:, :4]
    shares = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)
    return np.where(shares > 0, links, 0).astype(np.uint16), shares


def animation_of(arrays: Arrays, run: RecordedRun, model: BodyModel, bones: tuple[Bone, ...]) -> gl.Animation:
    """Rotations of rotating bones and positions of translating bones, at the times of the frames."""
    track = run.track
    turns, places = motion_of(model, bones, track.pose, run.from_camera(CAMERA_TO_Y_UP))
    seconds = rising((run.seconds - run.seconds[0]).astype(np.float32))
    times = arrays.add(seconds.astype(np.float32), "SCALAR")
    animation = gl.Animation(name=run.name, samplers=[], channels=[])
    animation.extras = {"frame": track.frame.tolist(), "status": track.status.tolist()}

    def add(node: int, path: str, values: NDArray[np.float32], form: str) -> None:
        animation.samplers.append(gl.AnimationSampler(input=times, output=arrays.add(values, form)))
        target = gl.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(gl.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

    for b, bone in enumerate(bones):
        if bone.moves:
            quaternions = continuous(Rotation.from_matrix(turns[:, b]))
            add(b, "rotation", quaternions.astype(np.float32), "VEC4")
        if bone.moves and slides(bones, bone, places[:, b]):
            add(b, "translation", places[:, b].astype(np.float32), "VEC3")
    return animation
