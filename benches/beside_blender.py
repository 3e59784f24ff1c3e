#!/usr/bin/env python3
"""Depth of field beside the Defocus node of Blender's compositor: equal size, equal blur, the same run.

    python3.11 -m venv peer && peer/bin/pip install bpy==4.5.* numpy
    peer/bin/python benches/beside_blender.py [--locard PROGRAM] [--size WxH ...] [--circle PX ...]

Defocus is told the radius of each pixel's circle by a picture, and that none is larger (blur_max), so that it looks no
further than it must; threads are as many as it likes. The radius that it draws is first checked on a single light. Ours is
`locard bench` at the same size: upload to wait, median of its rounds. Each row holds the seconds of both and their ratio.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time

import bpy
import numpy as np

FLAT = "depth_of_field layered, circles of {} px"
SITE = "depth_of_field layered, a site with circles up to 24 px"


def picture(name, pixels):
    height, width, _ = pixels.shape
    made = bpy.data.images.new(name, width, height, alpha=True, float_buffer=True)
    made.colorspace_settings.name = "Non-Color"
    made.pixels.foreach_set(pixels.astype(np.float32).ravel())
    return made


def defocus(color, radius_px, out):
    """Seconds that Blender takes to blur `color` (height, width, 4) by a circle of `radius_px` for each pixel."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    height, width, _ = color.shape
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.resolution_percentage = 100
    scene.render.engine = "CYCLES"
    scene.render.compositor_device = "CPU"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = out
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    shown = tree.nodes.new("CompositorNodeImage")
    shown.image = picture("colour", color)
    circles = tree.nodes.new("CompositorNodeImage")
    circles.image = picture("radius", np.dstack([radius_px] * 3 + [np.ones_like(radius_px)]))
    node = tree.nodes.new("CompositorNodeDefocus")
    node.bokeh = "CIRCLE"
    node.use_zbuffer = False
    node.z_scale = 1.0
    node.use_preview = False
    node.blur_max = float(radius_px.max())
    composite = tree.nodes.new("CompositorNodeComposite")
    tree.links.new(shown.outputs["Image"], node.inputs[0])
    tree.links.new(circles.outputs["Image"], node.inputs[1])
    tree.links.new(node.outputs[0], composite.inputs[0])
    start = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    return time.perf_counter() - start


def check(radius_px, out):
    """The radius that is drawn, from the area over which a single light is spread."""
    color = np.zeros((128, 128, 4), np.float32)
    color[..., 3] = 1.0
    color[64, 64, :3] = 1000.0
    defocus(color, np.full((128, 128), radius_px, np.float32), out)
    drawn = bpy.data.images.load(out)
    light = np.array(drawn.pixels[:]).reshape(128, 128, 4)[..., 0]
    bpy.data.images.remove(drawn)
    return math.sqrt((light > 0.5 * light.max()).sum() / math.pi)


def checkers(width, height):
    y, x = np.mgrid[0:height, 0:width]
    color = np.ones((height, width, 4), np.float32)
    color[..., 0], color[..., 1], color[..., 2] = x // 16 % 2, y // 16 % 2, 0.3
    return color


def site_px(width, height):
    """Radii of the site of src/compositor/bench/full_picture.rs."""
    y, x = np.mgrid[0:height, 0:width]
    x, y = x / width, y / height
    circle = 24.0 * y
    for i in range(8):
        cx, cy, own = i / 8 + 0.06, 0.25 + 0.5 * (i % 2), (i % 2) * -12.0
        circle = np.where(np.hypot(x - cx, 0.75 * (y - cy)) < 0.055, own, circle)
    return np.abs(0.5 * circle)


def arguments():
    after = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--locard", default="target/release/locard", help="the program (default: %(default)s)")
    parser.add_argument("--size", nargs="+", default=["640x480", "1280x720"], metavar="WxH")
    parser.add_argument("--circle", nargs="+", type=int, default=[12, 24], metavar="PX", choices=[4, 8, 12, 24, 48])
    return parser.parse_args(after)


def main():
    args = arguments()
    # Blender says on stdout what it does; what we have to say goes to where stdout was.
    said = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "out.exr")
        print(f"Blender {bpy.app.version_string}: a radius of 12 px is drawn as {check(12.0, out):.2f} px", file=said)
        print(f"{'':10} {'circles':>12} {'Defocus':>10} {'layered':>10} {'times':>7}", file=said)
        for size in args.size:
            width, height = map(int, size.split("x"))
            ours = subprocess.run(
                [args.locard, "bench", "--size", size, "--json"], check=True, capture_output=True, text=True
            )
            ms = {row["name"]: row["ms"] for row in json.loads(ours.stdout)["rows"]}
            color = checkers(width, height)
            cases = [(f"{c} px", FLAT.format(c), np.full((height, width), c / 2, np.float32)) for c in args.circle]
            cases.append(("a site", SITE, site_px(width, height)))
            for name, row, radius_px in cases:
                theirs, mine = defocus(color, radius_px, out), ms[row] / 1e3
                line = f"{size:10} {name:>12} {theirs:8.2f} s {mine:8.4f} s {theirs / mine:7.0f}"
                print(line, file=said, flush=True)


if __name__ == "__main__":
    main()
