#!/usr/bin/env python3
"""Makes a model of the A4 sheet that `locard board -o FILE.png` draws, to be laid into a simulated site.

    scripts/sheet_as_model.py SHEET.png MODEL.glb

In a scene whose z is up it lies flat, x to its right and y to its top, with the small cross at the origin.
"""

import json
import struct
import sys
from pathlib import Path

WIDTH_M, HEIGHT_M = 0.210, 0.297
# The six tags are 235 mm high with the cross in their middle, and begin 12 mm below the paper's upper edge.
TOP_M = 0.235 / 2 + 0.012


def model(picture: bytes) -> bytes:
    x, far, near = WIDTH_M / 2, -TOP_M, HEIGHT_M - TOP_M
    corners = [(-x, 0, near), (x, 0, near), (x, 0, far), (-x, 0, far)]
    parts = [
        struct.pack("<12f", *(value for corner in corners for value in corner)),
        struct.pack("<12f", *([0, 1, 0] * 4)),
        struct.pack("<8f", 0, 1, 1, 1, 1, 0, 0, 0),
        struct.pack("<6I", 0, 1, 2, 0, 2, 3),
        picture,
    ]
    views, binary = [], b""
    for part in parts:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(part)})
        binary += part + bytes(-len(part) % 4)
    low, high = [-x, 0, far], [x, 0, near]
    root = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "indices": 3, "material": 0,
        }]}],
        "materials": [{"pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0}, "baseColorFactor": [0.8, 0.8, 0.8, 1], "metallicFactor": 0,
        }}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 4, "mimeType": "image/png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 3, "componentType": 5125, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(root).encode()
    text += b" " * (-len(text) % 4)
    chunks = b"".join(struct.pack("<I", len(c)) + kind + c for kind, c in [(b"JSON", text), (b"BIN\0", binary)])
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    Path(sys.argv[2]).write_bytes(model(Path(sys.argv[1]).read_bytes()))
