#!/usr/bin/env python3
"""Shadows on a floor beside those of another renderer: Cycles, as the module bpy from PyPI.

    python3 -m venv venv && venv/bin/pip install bpy==4.5.4 OpenEXR numpy
    venv/bin/python scripts/shadows_beside_path_tracer.py target/release/locard HDRI PROP.glb...

Each prop stands on a grey floor (0.4) under an even sky, under a sun ten degrees wide with a sky, and in the panorama. Cycles
renders the floor with the prop unseen, with the light that it throws back.
Locard composites the prop into a grey picture of the same camera, and its ratio (`--layers`, shadow.R, .G, .B) is put onto the
same grey. Printed is the difference in 8-bit codes of means of 5 x 5 pixels, mean and 99th percentile, over the shadow where the
prop does not cover it.
"""

import math
import os
import subprocess
import sys
import tempfile

import bpy
import numpy as np
import OpenEXR
from mathutils import Matrix, Vector

WIDTH, HEIGHT, FOCAL_PX = 320, 240, 330.0
SAMPLES = int(os.environ.get("SAMPLES", "256"))
GREY = 0.4
SIZE_M = 0.12
EYE, AT = Vector((0.12, -0.42, 0.36)), Vector((0.0, 0.0, 0.02))
SUN = Vector((0.5, 0.3, 0.8)).normalized()
LIGHTS = {
    "sky": "ambient = 1.0",
    "sun": "ambient = 0.4\n[[light.sun]]\ntowards = [%f, %f, %f]\ncolor = [1.0, 0.9, 0.7]\ndiameter_deg = 10" % tuple(SUN),
    "panorama": 'environment = "{hdri}"',
}


def encode(light):
    light = np.clip(light, 0.0, 1.0)
    return 255 * np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def means(picture, reach=2):
    """Of 5 x 5 pixels: a path tracer's noise is not what is looked for."""
    side = 2 * reach + 1
    sums = np.pad(picture, ((reach, reach), (reach, reach), (0, 0)), "edge").cumsum(0).cumsum(1)
    sums = np.pad(sums, ((1, 0), (1, 0), (0, 0)))
    return (sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side]) / side**2


def look():
    """The camera's columns in the world: right, down, forward."""
    forward = (AT - EYE).normalized()
    right = forward.cross(Vector((0, 0, 1))).normalized()
    return right, forward.cross(right), forward


def by_locard(program, prop, light, folder):
    """The ratio, and the prop's coverage."""
    os.makedirs(f"{folder}/rgb", exist_ok=True)
    image = bpy.data.images.new("grey", WIDTH, HEIGHT)
    image.pixels = [0.5, 0.5, 0.5, 1.0] * (WIDTH * HEIGHT)
    image.filepath_raw, image.file_format = f"{folder}/rgb/0.png", "PNG"
    image.save()
    for n in (1, 2):
        with open(f"{folder}/rgb/{n}.png", "wb") as copy, open(f"{folder}/rgb/0.png", "rb") as first:
            copy.write(first.read())
    with open(f"{folder}/rgb.txt", "w") as file:
        file.writelines(f"{n / 30:.6f} rgb/{n}.png\n" for n in range(3))
    right, down, forward = look()
    q = Matrix((right, down, forward)).transposed().to_quaternion()
    with open(f"{folder}/groundtruth.txt", "w") as file:
        file.writelines(f"{t} {EYE.x} {EYE.y} {EYE.z} {q.x} {q.y} {q.z} {q.w}\n" for t in (-0.1, -0.05, 0.0, 0.05, 0.1, 0.15))
    with open(f"{folder}/scene.toml", "w") as file:
        file.write(
            f'version = 1\nup = "z"\n[[objects]]\nmodel = "{prop}"\nground = true\nposition_m = [0.0, 0.0, 0.0]\n'
            f"size_m = {SIZE_M}\n[light]\n{light}\n"
        )
    sets = {
        "fx_px": FOCAL_PX, "fy_px": FOCAL_PX, "cx_px": WIDTH / 2, "cy_px": HEIGHT / 2, "width_px": WIDTH, "height_px": HEIGHT,
    }
    command = [program, "composite", folder, "--scene", f"{folder}/scene.toml", "--frames", "1..2", "--quiet"]
    for key, value in sets.items():
        command += ["--set", f"camera.{key}={value}"]
    command += ["-o", f"{folder}/out", "--layers", f"{folder}/layers"]
    subprocess.run(command, check=True)
    file = OpenEXR.File(f"{folder}/layers/layer_000001.exr", separate_channels=True)
    channels = file.channels()
    ratio = np.stack([np.asarray(channels[f"shadow.{c}"].pixels, float) for c in "RGB"], -1)
    return ratio, np.asarray(channels["virtual.A"].pixels, float)


def by_cycles(prop, light, hdri):
    """Light of the floor, and of the floor far from the prop."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.use_adaptive_sampling = SAMPLES, False, False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.max_bounces = 8
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH, HEIGHT, 100
    bpy.ops.import_scene.gltf(filepath=prop)
    meshes = [o for o in scene.objects if o.type == "MESH"]
    corners = lambda: [o.matrix_world @ v.co for o in meshes for v in o.data.vertices]
    low = [min(c[i] for c in corners()) for i in range(3)]
    high = [max(c[i] for c in corners()) for i in range(3)]
    root = bpy.data.objects.new("root", None)
    scene.collection.objects.link(root)
    for o in scene.objects:
        if o.parent is None and o is not root:
            o.parent = root
    factor = SIZE_M / max(h - l for h, l in zip(high, low))
    root.scale = (factor,) * 3
    root.location = (0, 0, -low[2] * factor)
    for o in meshes:
        o.visible_camera = False
    bpy.ops.mesh.primitive_plane_add(size=40)
    floor = bpy.context.object
    grey = bpy.data.materials.new("grey")
    grey.use_nodes = True
    shader = grey.node_tree.nodes.new("ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (GREY, GREY, GREY, 1)
    grey.node_tree.links.new(shader.outputs[0], grey.node_tree.nodes["Material Output"].inputs["Surface"])
    floor.data.materials.append(grey)
    world = bpy.data.worlds.new("world")
    scene.world = world
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    background = nodes["Background"]
    level = {"sky": 1.0, "sun": 0.4}.get(light)
    if level:
        background.inputs["Color"].default_value = (level, level, level, 1)
    else:
        picture = nodes.new("ShaderNodeTexEnvironment")
        picture.image = bpy.data.images.load(hdri)
        mapping, place = nodes.new("ShaderNodeMapping"), nodes.new("ShaderNodeTexCoord")
        # Its middle lies along +x there and along +y here.
        mapping.inputs["Rotation"].default_value = (0, 0, -math.pi / 2)
        links.new(place.outputs["Generated"], mapping.inputs["Vector"])
        links.new(mapping.outputs[0], picture.inputs["Vector"])
        links.new(picture.outputs["Color"], background.inputs["Color"])
    if light == "sun":
        lamp = bpy.data.lights.new("sun", "SUN")
        # A white matt surface that faces it shows irradiance / pi.
        lamp.energy, lamp.color, lamp.angle = math.pi, (1.0, 0.9, 0.7), math.radians(10)
        o = bpy.data.objects.new("sun", lamp)
        o.rotation_euler = SUN.to_track_quat("Z", "Y").to_euler()
        scene.collection.objects.link(o)
    camera = bpy.data.cameras.new("camera")
    camera.sensor_width, camera.lens = 36.0, 36.0 * FOCAL_PX / WIDTH
    o = bpy.data.objects.new("camera", camera)
    right, down, forward = look()
    o.matrix_world = Matrix.Translation(EYE) @ Matrix((right, -down, -forward)).transposed().to_4x4()
    scene.collection.objects.link(o)
    scene.camera = o
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    with tempfile.TemporaryDirectory() as folder:
        def render():
            scene.render.filepath = f"{folder}/out.exr"
            bpy.ops.render.render(write_still=True)
            channels = OpenEXR.File(scene.render.filepath, separate_channels=True).channels()
            names = {name.split(".")[-1]: np.asarray(c.pixels, float) for name, c in channels.items()}
            return np.stack([names[c] for c in "RGB"], -1)

        seen = render()
        for mesh in meshes:
            mesh.hide_render = True
        # Everywhere the same but for noise: all light is far away.
        free = render().mean(axis=(0, 1))
    return seen, free


def main():
    program, hdri, props = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2]), sys.argv[3:]
    print("prop, light: difference in codes, mean and 99th percentile")
    for prop in map(os.path.abspath, props):
        for light, text in LIGHTS.items():
            with tempfile.TemporaryDirectory() as folder:
                ratio, coverage = by_locard(program, prop, text.format(hdri=hdri), folder)
            seen, free = by_cycles(prop, light, hdri)
            unshaded = GREY * free / free.mean()
            truth = seen / free
            ours, theirs = means(ratio), means(truth)
            beside = (means(coverage[..., None]) == 0)[..., 0] & (np.abs(ours - 1).max(-1) > 0.005)
            off = np.abs(encode(unshaded * ours) - encode(unshaded * theirs))[beside]
            name = f"{os.path.basename(prop)}, {light}"
            print(f"{name}: {off.mean():.2f} {np.percentile(off, 99):.2f} over {beside.sum()} pixels", flush=True)
            if (out := os.environ.get("OUT")) is not None:
                np.savez(f"{out}/{name.replace(', ', '-')}.npz", ratio=ratio, truth=truth, coverage=coverage)



main()
