#!/usr/bin/env python3
"""Writes small models that each show one thing of glTF, for scripts/beside_path_tracer.py.

    python3 scripts/shading_charts.py FOLDER      (needs numpy and pillow)

spheres    metallic 0, 0.5, 1 upwards; roughness 0.1, 0.3, 0.5, 0.75, 1 to the right
textures   plain; turned 30°; turned, scaled and moved; mirrored node; second coordinates; NEAREST
normals    a normal map: plain; scale 2; turned 90°; u mirrored; mirrored node; seen from behind
surfaces   mask; blend before blend; vertex colours; unlit; emissive; back of a single, of a double side
"""

import io
import json
import math
import struct
import sys
from pathlib import Path

import numpy as np
from PIL import Image


class Chart:
    def __init__(self):
        self.binary = b""
        self.root = {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}], "nodes": [], "meshes": [],
            "materials": [], "accessors": [], "bufferViews": [], "textures": [], "images": [],
            "samplers": [{"magFilter": 9729, "minFilter": 9987}, {"magFilter": 9728, "minFilter": 9728}],
            "extensionsUsed": ["KHR_texture_transform", "KHR_materials_unlit"],
        }

    def add(self, key, value):
        self.root[key].append(value)
        return len(self.root[key]) - 1

    def view(self, data):
        start = len(self.binary)
        self.binary += data + b"\0" * (-len(data) % 4)
        return self.add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data)})

    def array(self, values):
        values = np.asarray(values)
        index = values.ndim == 1
        values = values.astype("<u4" if index else "<f4")
        accessor = {
            "bufferView": self.view(values.tobytes()), "componentType": 5125 if index else 5126, "count": len(values),
            "type": "SCALAR" if index else f"VEC{values.shape[1]}",
        }
        if not index:
            accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
        return self.add("accessors", accessor)

    def texture(self, picture, sampler=0):
        data = io.BytesIO()
        Image.fromarray(picture).save(data, "PNG")
        image = self.add("images", {"bufferView": self.view(data.getvalue()), "mimeType": "image/png"})
        return self.add("textures", {"source": image, "sampler": sampler})

    def place(self, at, shape, material, **node):
        position, normal, indices, more = shape
        attributes = {"POSITION": self.array(position), "NORMAL": self.array(normal)}
        attributes |= {name: self.array(values) for name, values in more.items()}
        primitive = {"attributes": attributes, "indices": self.array(indices), "material": self.add("materials", material)}
        mesh = self.add("meshes", {"primitives": [primitive]})
        self.root["scenes"][0]["nodes"].append(self.add("nodes", {"mesh": mesh, "translation": at, **node}))

    def write(self, path):
        root = {k: v for k, v in self.root.items() if v} | {"buffers": [{"byteLength": len(self.binary)}]}
        text = json.dumps(root).encode()
        text += b" " * (-len(text) % 4)
        chunks = [(b"JSON", text), (b"BIN\0", self.binary)]
        body = b"".join(struct.pack("<I", len(c)) + kind + c for kind, c in chunks)
        path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)


def plate(**more):
    """A square of 0.9 that faces +z, its picture upright."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.45
    uv = [[0, 1], [1, 1], [1, 0], [0, 0]]
    return corners, [[0, 0, 1]] * 4, np.array([0, 1, 2, 0, 2, 3]), {"TEXCOORD_0": uv} | more


def sphere(radius=0.45, rows=48, columns=96):
    v, u = np.meshgrid(np.linspace(0, math.pi, rows + 1), np.linspace(0, math.tau, columns + 1), indexing="ij")
    normal = np.stack([np.sin(v) * np.sin(u), np.cos(v), np.sin(v) * np.cos(u)], -1).reshape(-1, 3)
    i = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    faces = np.stack([i, i + columns + 1, i + 1, i + 1, i + columns + 1, i + columns + 2], -1)
    return radius * normal, normal, faces.ravel(), {}


def letter():
    """A picture without symmetry: an F on a coloured ground, a border, a channel of noise-free ramps."""
    y, x = np.mgrid[0:128, 0:128]
    picture = np.stack([60 + x, 60 + y, np.full_like(x, 90)], -1).astype(np.uint8)
    for x0, y0, x1, y1 in [(40, 24, 52, 104), (40, 24, 92, 36), (40, 58, 80, 70)]:
        picture[y0:y1, x0:x1] = (240, 240, 240)
    picture[(x < 6) | (y < 6) | (x > 121) | (y > 121)] = (30, 30, 30)
    return picture


def dome():
    """A normal map of a dome on a flat ground, with a ridge to the right of it (+x right, +y up)."""
    y, x = np.mgrid[0:256, 0:256]
    u, v = (x + 0.5) / 256 - 0.4, 0.5 - (y + 0.5) / 256
    inside = u * u + v * v < 0.3 ** 2
    n = np.stack([np.where(inside, u / 0.36, 0), np.where(inside, v / 0.36, 0)], -1)
    n[(x > 200) & (x < 212)] = (-0.6, 0)
    n[(x >= 212) & (x < 224)] = (0.6, 0)
    z = np.sqrt(np.maximum(1 - (n * n).sum(-1, keepdims=True), 0))
    return np.round((np.concatenate([n, z], -1) * 0.5 + 0.5) * 255).astype(np.uint8)


def matt(**more):
    pbr = {"metallicFactor": 0, "roughnessFactor": 1} | more.pop("pbr", {})
    return {"pbrMetallicRoughness": pbr} | more


def transformed(texture, **transform):
    return {"index": texture, "extensions": {"KHR_texture_transform": transform}}


def spheres():
    chart = Chart()
    for j, metallic in enumerate((0, 0.5, 1)):
        for i, roughness in enumerate((0.1, 0.3, 0.5, 0.75, 1)):
            pbr = {"baseColorFactor": [0.8, 0.4, 0.15, 1], "metallicFactor": metallic, "roughnessFactor": roughness}
            chart.place([i, j, 0], sphere(), matt(pbr=pbr))
    return chart


def textures():
    chart = Chart()
    picture = chart.texture(letter())
    color = lambda use: matt(pbr={"baseColorTexture": use})
    turn = math.radians(30)
    chart.place([0, 1, 0], plate(), color({"index": picture}))
    chart.place([1, 1, 0], plate(), color(transformed(picture, rotation=turn)))
    chart.place([2, 1, 0], plate(), color(transformed(picture, rotation=turn, scale=[1.5, 0.7], offset=[0.2, -0.1])))
    chart.place([0, 0, 0], plate(), color({"index": picture}), scale=[-1, 1, 1])
    second = {"TEXCOORD_1": [[1, 1], [1, 0], [0, 0], [0, 1]]}
    chart.place([1, 0, 0], plate(**second), color({"index": picture, "texCoord": 1}))
    coarse = chart.texture(letter()[::8, ::8].copy(), 1)
    chart.place([2, 0, 0], plate(), color({"index": coarse}))
    return chart


def normals():
    chart = Chart()
    picture = chart.texture(dome())
    bumped = lambda **use: matt(normalTexture={"index": picture} | use)
    quarter = {"extensions": {"KHR_texture_transform": {"rotation": math.pi / 2}}}
    chart.place([0, 1, 0], plate(), bumped())
    chart.place([1, 1, 0], plate(), bumped(scale=2))
    chart.place([2, 1, 0], plate(), bumped(**quarter))
    chart.place([0, 0, 0], plate(TEXCOORD_0=[[1, 1], [0, 1], [0, 0], [1, 0]]), bumped())
    chart.place([1, 0, 0], plate(), bumped(), scale=[-1, 1, 1])
    chart.place([2, 0, 0], plate(), bumped() | {"doubleSided": True}, rotation=[0, 1, 0, 0])
    return chart


def surfaces():
    chart = Chart()
    y, x = np.mgrid[0:128, 0:128]
    hole = np.clip(255 * (np.hypot(x - 63.5, y - 63.5) / 64), 0, 255)
    cut = chart.texture(np.concatenate([letter(), hole[..., None].astype(np.uint8)], -1))
    red = {"baseColorFactor": [0.8, 0.05, 0.05, 0.5]}
    blue = {"baseColorFactor": [0.05, 0.05, 0.8, 0.25]}
    colors = [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0.2, 0.2, 0.2, 1]]
    unlit = {"KHR_materials_unlit": {}}
    chart.place([0, 1, 0], plate(), matt(pbr={"baseColorTexture": {"index": cut}}, alphaMode="MASK", alphaCutoff=0.6))
    chart.place([1, 1, 0], plate(), matt(pbr={"baseColorTexture": {"index": cut}}, alphaMode="BLEND"))
    chart.place([2, 1, 0], plate(), matt(pbr=red, alphaMode="BLEND"))
    chart.place([2.2, 1.2, 0.2], plate(), matt(pbr=blue, alphaMode="BLEND"))
    chart.place([3, 1, 0], plate(COLOR_0=colors), matt())
    chart.place([0, 0, 0], plate(), matt(pbr={"baseColorTexture": {"index": cut}}, extensions=unlit))
    chart.place([1, 0, 0], plate(), matt(emissiveFactor=[0.2, 0.5, 0.1], pbr={"baseColorFactor": [0.3, 0.3, 0.3, 1]}))
    back = {"rotation": [0, 1, 0, 0]}
    chart.place([2, 0, 0], plate(), matt(), **back)
    chart.place([3, 0, 0], plate(), matt(doubleSided=True, pbr={"baseColorTexture": {"index": cut}}), **back)
    return chart


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for make in (spheres, textures, normals, surfaces):
        make().write(folder / f"{make.__name__}.glb")
