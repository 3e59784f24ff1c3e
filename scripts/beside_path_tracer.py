#!/usr/bin/env python3
"""Models as Locard shades them beside the same models from a path tracer, Blender's Cycles.

    python3.11 -m venv /tmp/bpy && /tmp/bpy/bin/pip install bpy==4.5.* OpenEXR pillow
    cargo build --release
    /tmp/bpy/bin/python scripts/beside_path_tracer.py --out /tmp/beside MODEL.glb ...

For each model two views, one pinhole, and for each of --lights one light: a sun, the same light from
everywhere, or a panorama (--hdr). What glTF asks and Cycles does not do is done to its scene: faces that
are not double-sided are invisible from behind. Extensions that Locard does not know are taken out. Surfaces
neither shadow nor mirror each other, as in `composite --plain`; --shadows lets them, to see what is missing.
Prints a table and writes NAME-LIGHT.png: Locard, Cycles, and four times their difference about grey; rows
are the views. Figures are of linear premultiplied RGBA.

  alpha   mean absolute difference of alpha over the silhouettes' union
  wrong   pixels in which one has a surface and the other has none
  ratio   mean radiance of Locard over Cycles', pixels within both silhouettes
  MAE     mean absolute difference, pixels where either is not 0
  p99     99th percentile of the pixels' largest difference of a colour, within both silhouettes
"""

import argparse
import json
import math
import struct
import subprocess
import tempfile
from pathlib import Path

import bpy
import bmesh  # comes with bpy, after it
import numpy as np
import OpenEXR
from mathutils import Matrix, Quaternion, Vector
from PIL import Image

SUN_TOWARDS = (0.5, -0.35, 1.0)
# Azimuth and height of the camera, degrees; 0 is from the model's front (+z in glTF, -y here).
VIEWS = [(30.0, 25.0), (-140.0, 50.0)]
KNOWN = {"KHR_materials_unlit", "KHR_materials_emissive_strength", "KHR_texture_transform", "KHR_mesh_quantization"}


def plain_model(path, folder, shadows):
    """A copy of the model with the extensions that Locard reads and no others, as .gltf beside its files. Occlusion
    textures stay only where surfaces shadow each other: they are a path tracer's own business."""
    data = path.read_bytes()
    binary = b""
    if data[:4] == b"glTF":
        size = struct.unpack("<I", data[12:16])[0]
        root, binary = json.loads(data[20:20 + size]), data[28 + size:]
    else:
        root = json.loads(data)
    for material in root.get("materials", []):
        material["extensions"] = {k: v for k, v in material.get("extensions", {}).items() if k in KNOWN}
        if not shadows:
            material.pop("occlusionTexture", None)
    for item in root.get("buffers", []) + root.get("images", []):
        if "uri" in item and not item["uri"].startswith("data:"):
            target = folder / Path(item["uri"]).name
            target.write_bytes((path.parent / item["uri"]).read_bytes())
            item["uri"] = target.name
    if binary:
        (folder / "model.bin").write_bytes(binary)
        root["buffers"][0]["uri"] = "model.bin"
    out = folder / "model.gltf"
    out.write_text(json.dumps(root))
    return out


def load(model, shadows):
    """The model alone in Blender; returns its box's middle and half its diagonal."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(model))
    corners = []
    for thing in list(bpy.data.objects):
        if thing.type in ("LIGHT", "CAMERA"):
            bpy.data.objects.remove(thing)
        elif thing.type == "MESH":
            corners += [thing.matrix_world @ Vector(c) for c in thing.bound_box]
            if not shadows:
                thing.visible_diffuse = thing.visible_glossy = thing.visible_transmission = False
                thing.visible_shadow = False
    for material in bpy.data.materials:
        material.cycles.use_bump_map_correction = False
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2


def remove_backs(eye):
    """Takes out the faces of single-sided materials that turn their back to the eye, their neighbours' normals kept.
    A shader that lets rays through them would lose faces that lie back to back."""
    for thing in [t for t in bpy.data.objects if t.type == "MESH"]:
        mesh, world = thing.data, thing.matrix_world
        normal_matrix = world.to_3x3().inverted().transposed()
        single = [m is not None and m.use_backface_culling for m in mesh.materials] or [False]
        gone = [
            p.index for p in mesh.polygons
            if single[p.material_index]
            and (normal_matrix @ p.normal).dot(Vector(eye) - world @ p.center) <= 0
        ]
        if not gone:
            continue
        kept = mesh.attributes.new("kept normal", "FLOAT_VECTOR", "CORNER")
        normals = np.array([n.vector for n in mesh.corner_normals], dtype=np.float32)
        kept.data.foreach_set("vector", normals.ravel())
        work = bmesh.new()
        work.from_mesh(mesh)
        work.faces.ensure_lookup_table()
        bmesh.ops.delete(work, geom=[work.faces[i] for i in gone], context="FACES_ONLY")
        work.to_mesh(mesh)
        work.free()
        normals = np.zeros(3 * len(mesh.loops), dtype=np.float32)
        mesh.attributes["kept normal"].data.foreach_get("vector", normals)
        mesh.normals_split_custom_set(normals.reshape(-1, 3).tolist())


def world_from_camera(middle, radius, view, focal):
    """Rows of a pose with OpenCV's axes that sees the sphere whole, at no less than 3 cm."""
    azimuth, height = (math.radians(a) for a in view)
    towards = np.array([
        math.sin(azimuth) * math.cos(height), -math.cos(azimuth) * math.cos(height), math.sin(height)])
    distance = max(1.05 * radius * math.hypot(1.0, 2.0 * focal), radius + 0.03)
    right = np.cross([0, 0, 1], towards)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, -np.cross(towards, right), -towards
    pose[:3, 3] = np.asarray(middle) + distance * towards
    return pose


def light_blender(kind, hdr):
    """The light of `scene_text` in Blender's units."""
    scene = bpy.context.scene
    world = scene.world = bpy.data.worlds.new("world")
    world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    background = nodes["Background"]
    background.inputs["Color"].default_value = (1, 1, 1, 1)
    background.inputs["Strength"].default_value = 0.0
    if kind == "sun":
        sun = bpy.data.lights.new("sun", "SUN")
        sun.angle = 0.0
        # A matt white surface under E W/m² sends E/π.
        sun.energy = math.pi
        thing = bpy.data.objects.new("sun", sun)
        thing.rotation_mode = "QUATERNION"
        thing.rotation_quaternion = Vector(SUN_TOWARDS).to_track_quat("Z", "Y")
        scene.collection.objects.link(thing)
    else:
        background.inputs["Strength"].default_value = 1.0
    if kind == "map":
        picture, turn, where = (nodes.new(f"ShaderNode{k}") for k in ("TexEnvironment", "Mapping", "TexCoord"))
        picture.image = bpy.data.images.load(str(hdr))
        # Blender has the panorama's middle at +x; Locard has it at the model's -z, which is +y here.
        turn.inputs["Rotation"].default_value = (0, 0, -math.pi / 2)
        links.new(where.outputs["Generated"], turn.inputs["Vector"])
        links.new(turn.outputs["Vector"], picture.inputs["Vector"])
        links.new(picture.outputs["Color"], background.inputs["Color"])


def scene_text(model, kind, hdr):
    light = {
        "sun": f"ambient = 0\n[[light.sun]]\ntowards = {list(SUN_TOWARDS)}\n",
        "ambient": "ambient = 1\n",
        "map": f"environment = '{hdr}'\n",
    }[kind]
    return f"version = 1\nup = 'z'\n[[objects]]\nmodel = '{model}'\n[light]\n{light}"


def cycles(model, args, poses, kind, folder):
    pictures = []
    for i, pose in enumerate(poses):
        load(model, args.shadows)
        remove_backs(pose[:3, 3])
        light_blender(kind, args.hdr)
        scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        scene.render.resolution_x = scene.render.resolution_y = args.size
        scene.render.film_transparent = True
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.image_settings.color_depth = "32"
        scene.render.image_settings.color_mode = "RGBA"
        scene.cycles.samples = args.samples
        scene.cycles.use_adaptive_sampling = False
        scene.cycles.use_denoising = False
        scene.cycles.pixel_filter_type = "BOX"
        scene.cycles.filter_width = 1.0
        scene.cycles.max_bounces = 8 if args.shadows else 1
        scene.cycles.transparent_max_bounces = 64
        scene.cycles.sample_clamp_indirect = scene.cycles.sample_clamp_direct = 0.0
        camera = bpy.data.cameras.new("camera")
        camera.sensor_width, camera.lens, camera.clip_start = 36.0, 36.0 * args.focal, 1e-3
        thing = bpy.data.objects.new("camera", camera)
        # Blender's camera looks along -z with y up.
        thing.matrix_world = Matrix((pose @ np.diag([1, -1, -1, 1])).tolist())
        scene.collection.objects.link(thing)
        scene.camera = thing
        scene.render.filepath = str(folder / f"cycles{i}.exr")
        bpy.ops.render.render(write_still=True)
        pictures.append(read(scene.render.filepath, ""))
    return pictures


def locard(args, poses, text, folder):
    """Writes a recording of grey frames, composites, and reads the layers."""
    recording, layers = folder / "recording", folder / "layers"
    size, focal = args.size, args.focal
    (recording / "frames").mkdir(parents=True, exist_ok=True)
    lines = []
    # A pose holds between two of its own, so that frames see nothing of each other.
    for i, pose in enumerate(poses):
        Image.new("RGB", (size, size), (119, 119, 119)).save(recording / "frames" / f"{i}.png")
        q = Matrix(pose[:3, :3].tolist()).to_quaternion()
        where = " ".join(f"{v:.9f}" for v in [*pose[:3, 3], q.x, q.y, q.z, q.w])
        lines += [f"{i + step:.3f} {where}" for step in (-0.1, 0.1)]
    (recording / "poses.txt").write_text("\n".join(lines))
    (recording / "recording.toml").write_text(
        "version = 1\n[frames]\nimages = 'frames'\nfps = 1\n"
        "[poses]\ntrajectory = 'poses.txt'\nmax_gap_s = 2\n[camera]\nprofile = 'camera.toml'\n")
    (recording / "camera.toml").write_text(
        f"version = 1\n[camera]\nwidth_px = {size}\nheight_px = {size}\nfx_px = {size * focal}\n"
        f"fy_px = {size * focal}\ncx_px = {size / 2}\ncy_px = {size / 2}\n[camera.exposure]\ntime_s = 0.0\n")
    (folder / "scene.toml").write_text(text)
    subprocess.run(
        [args.locard.resolve(), "composite", recording, "--scene", folder / "scene.toml", "--plain", "--quiet", "--force",
         "--layers", layers, "-o", folder / "frames"], check=True)
    return [read(str(layers / f"layer_{i:06}.exr"), "virtual.") for i in range(len(poses))]


def read(path, prefix):
    channels = OpenEXR.File(path, separate_channels=True).channels()
    return np.stack([channels[prefix + c].pixels.astype(np.float32) for c in "RGBA"], axis=-1)


def compared(ours, theirs):
    a, b = np.concatenate(ours), np.concatenate(theirs)
    either = (a[..., 3] > 0) | (b[..., 3] > 0)
    inside = (a[..., 3] > 0.999) & (b[..., 3] > 0.999)
    # Away from edges, where a sample more or less decides.
    for axis in (0, 1):
        inside = inside & np.roll(inside, 1, axis) & np.roll(inside, -1, axis)
    apart = np.abs(a - b)
    anything = (a != 0).any(-1) | (b != 0).any(-1)
    mean = lambda p: float(p[inside][..., :3].mean()) if inside.any() else float("nan")
    return {
        "alpha": float(apart[..., 3][either].mean()),
        "wrong": int((apart[..., 3] > 0.95).sum()),
        "ratio": mean(a) / max(mean(b), 1e-9),
        "MAE": float(apart[anything].mean()),
        "p99": float(np.percentile(apart[inside][..., :3].max(-1), 99)) if inside.any() else float("nan"),
    }


def picture(ours, theirs, path):
    encode = lambda v: np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.clip(v, 1e-9, 1) ** (1 / 2.4) - 0.055)
    over_grey = lambda p: encode(np.clip(p[..., :3] + (1 - p[..., 3:]) * 0.18, 0, 1))
    rows = [
        np.concatenate([over_grey(a), over_grey(b), np.clip(0.5 + 4 * (a - b)[..., :3], 0, 1)], axis=1)
        for a, b in zip(ours, theirs)
    ]
    Image.fromarray((np.concatenate(rows) * 255 + 0.5).astype(np.uint8)).save(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="folder for the pictures")
    parser.add_argument("--locard", type=Path, default=Path("target/release/locard"))
    parser.add_argument("--lights", default="sun,ambient", help="of sun, ambient, map")
    parser.add_argument("--hdr", type=Path, help="the panorama of the light `map`")
    parser.add_argument("--size", type=int, default=400, help="pixels of a side")
    parser.add_argument("--focal", type=float, default=1.8, help="focal length in picture widths")
    parser.add_argument("--view", type=lambda t: tuple(map(float, t.split(","))), action="append",
                        help="AZIMUTH,HEIGHT of the camera in degrees, once for each view; 0 is the model's front")
    parser.add_argument("--samples", type=int, default=128)
    parser.add_argument("--shadows", action="store_true", help="let Cycles' surfaces shadow and mirror each other")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    args.hdr = args.hdr and args.hdr.resolve()
    print("| model | light | alpha | wrong | ratio | MAE | p99 |\n|---|---|---|---|---|---|---|")
    for path in args.models:
        for kind in args.lights.split(","):
            with tempfile.TemporaryDirectory() as folder:
                folder = Path(folder)
                model = plain_model(path, folder, args.shadows)
                middle, radius = load(model, args.shadows)
                poses = [world_from_camera(middle, radius, view, args.focal) for view in args.view or VIEWS]
                ours = locard(args, poses, scene_text(model, kind, args.hdr), folder)
                theirs = cycles(model, args, poses, kind, folder)
            differences = compared(ours, theirs)
            figures = " | ".join(f"{v}" if isinstance(v, int) else f"{v:.4f}" for v in differences.values())
            print(f"| `{path.name}` | {kind} | {figures} |", flush=True)
            picture(ours, theirs, args.out / f"{path.stem}-{kind}.png")


if __name__ == "__main__":
    main()
