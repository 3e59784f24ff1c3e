#!/usr/bin/env python3
"""The whole composite beside the truth: simulated sites in which evidence really lies, against the same evidence put into the
recording of the empty site, by what its analysis found.

    python3 -m venv /tmp/flip && /tmp/flip/bin/pip install flip-evaluator==1.7 numpy pillow
    /tmp/flip/bin/python scripts/composite_beside_truth.py target/release/locard /tmp/truth [first last] [--parts] [--noise]

For each site of docs/truth.md the mean FLIP over the objects, their shadows and what is around them (each object's box grown by
half), in three frames. --parts: the same with each part of the composite off. --noise: the site is photographed again with a noisy
sensor, and the noise of what was put in is set beside that of what lies there. Recordings that are there are not made again."""

import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import flip_evaluator
import numpy as np
from PIL import Image

options = [text for text in sys.argv[1:] if text.startswith("--")]
if odd := sorted({*options} - {"--parts", "--noise"}):
    sys.exit(f"{odd[0]}: there is --parts and --noise")
with_parts, with_noise = "--parts" in options, "--noise" in options
arguments = [text for text in sys.argv[1:] if text not in options]
program, folder = arguments[0], Path(arguments[1]).resolve()
first, last = (int(n) for n in arguments[2:4]) if len(arguments) > 3 else (1, 10)
scenes = Path(__file__).resolve().parent.parent / "scenes"
folder.mkdir(parents=True, exist_ok=True)

FRAMES = 24
LOOKED_AT = [4, 12, 20]
# Scene and options that leave out one part of the light or the occlusion.
PARTS = {
    "shadow": ("evidence.toml", ["--set", "shadow.cast=false"]),
    "occlusion": ("evidence.toml", ["--set", "depth.occlusion=false"]),
    "gains": ("evidence.toml", ["--set", "exposure.follow=false"]),
    "light": ("guessed.toml", []),
}
GUESSED = """[light]
ambient = 0.55
[[light.sun]]
intensity = 0.6
towards = [0.0, 0.57, 0.82]
"""


def run(*arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, arguments))}\n{done.stdout}{done.stderr}")
    return done.stdout


def objects(site):
    """The objects of a site: a marker, a scale and two cases, turned and moved by its number."""
    turn, x, y = 37 * site % 360, 0.05 * (site % 3 - 1), 0.04 * (site % 4) - 0.06
    cases = [(0.10 + x, -0.04 + y, turn), (-0.09 + x, 0.03 - y, turn + 70)]
    text = f"""version = 1
up = "z"
[[objects]]
name = "marker"
model = "{scenes}/marker-{site % 2 + 1}.glb"
position_m = [{x}, {0.1 + y}, 0.0]
rotation_deg = [0, 0, {12 + turn % 50 - 25}]
[[objects]]
name = "scale"
model = "{scenes}/l-scale.glb"
position_m = [{x}, {y - 0.08}, 0.0]
rotation_deg = [0, 0, {turn % 40 - 20}]
"""
    for n, (cx, cy, yaw) in enumerate(cases):
        text += f"""[[objects]]
name = "case {n + 1}"
model = "{scenes}/cartridge-case-9mm.glb"
ground = true
position_m = [{cx}, {cy}, 0.0]
rotation_deg = [90, 0, {yaw}]
"""
    return text


def picture(path):
    return np.asarray(Image.open(path).convert("RGB"), np.float32) / 255


def is_evidence(real, empty):
    """Where objects and their shadows are. A few pixels alone are noise of the truth's paths: of 25 around each most must differ."""
    mask = np.abs(real - empty).max(2) > 16 / 255
    around = np.pad(mask.astype(int), 2)
    return sum(around[y : y + mask.shape[0], x : x + mask.shape[1]] for y in range(5) for x in range(5)) > 12


def grown(mask):
    """The box of a mask, grown by half."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    (top, bottom), (left, right) = ((s[0], s[-1] + 1) for s in (rows, columns))
    down, across = (bottom - top) // 4, (right - left) // 4
    return slice(max(0, top - down), bottom + down), slice(max(0, left - across), right + across)


def errors(site_folder, out, layers):
    mean_errors = []
    for n in LOOKED_AT:
        real, made = picture(site_folder / f"there/rgb/{n:05}.png"), picture(out / f"frame_{n:06}.png")
        empty = picture(site_folder / f"empty/rgb/{n:05}.png")
        box = grown(is_evidence(real, empty))
        error = flip_evaluator.evaluate(real, made, "LDR", applyMagma=False)[0]
        mean_errors.append(float(error[box].mean()))
        if layers is not None:
            grey = np.repeat(error[box].reshape(*real[box].shape[:2], -1)[..., :1], 3, 2)
            shown = np.concatenate([empty[box], real[box], made[box], grey], 1)
            Image.fromarray((255 * shown).clip(0, 255).astype(np.uint8)).save(layers / f"frame_{n:02}.png")
    return mean_errors


def noise_ratios(site_folder, simulate, composite):
    """sigma of the noise (the picture less the same one without noise) composited over photographed: where objects and their
    shadows are, and over their box. Both composites follow the analysis of the noisy recording; else they would differ by
    their light, too."""
    for name, evidence in {"noisy": False, "noisy-there": True}.items():
        simulate(name, evidence, 1)
    run("analyse", "-q", site_folder / "noisy")
    # The same analysis, said to be of the recording without noise.
    said = {name: tomllib.loads((site_folder / f"{name}.analysis/analysis.toml").read_text()) for name in ("empty", "noisy")}
    carried = site_folder / "carried.analysis"
    shutil.copytree(site_folder / "noisy.analysis", carried, dirs_exist_ok=True)
    text = (carried / "analysis.toml").read_text()
    (carried / "analysis.toml").write_text(text.replace(said["noisy"]["recording"], said["empty"]["recording"]))
    noisy, clean = site_folder / "made-noisy", site_folder / "made-clean"
    composite("noisy", noisy, [])
    composite("empty", clean, ["--analysis", carried])
    variances = []
    for n in LOOKED_AT:
        real, empty = (picture(site_folder / f"{name}/rgb/{n:05}.png") for name in ("there", "empty"))
        evidence = is_evidence(real, empty)
        residuals = (
            picture(site_folder / f"noisy-there/rgb/{n:05}.png") - real,
            picture(noisy / f"frame_{n:06}.png") - picture(clean / f"frame_{n:06}.png"),
        )
        box = grown(evidence)
        variances.append([[residual[evidence].var(), residual[box].var()] for residual in residuals])
    camera, made = np.sqrt(np.mean(variances, 0))
    return made / camera, 255 * camera


all_parts, noises = {}, []
for site in range(first, last + 1):
    here = folder / f"s{site}"
    here.mkdir(exist_ok=True)
    (here / "evidence.toml").write_text(objects(site))
    settings = {
        "frames": FRAMES,
        "fps": 10,
        "lamps": (site - 1) % 3 + 1,
        "site": site,
        "seed": site,
        "samples": 12,
        "format": "png",
    }
    walk = ["flaws.exposure_walk_ev=0.3", "flaws.white_balance_share=0.05", f"flaws.seed={site}"]
    sets = [text for name, value in settings.items() for text in ("--set", f"{name}={value}")]
    sets += [text for flaw in walk for text in ("--set", flaw)]

    def simulate(name, evidence, noise):
        more = ["--evidence", here / "evidence.toml"] if evidence else []
        if not (here / name).exists():
            run("simulate", "-q", "-o", here / name, *sets, "--set", f"noise_scale={noise}", *more)

    frames = f"{LOOKED_AT[0]}..{LOOKED_AT[-1] + 1}"

    def composite(recording, out, more, scene="evidence.toml"):
        where = ["--scene", here / scene, "--frames", frames, "-o", out]
        run("composite", here / recording, *where, *more, "--quiet", "--force")

    simulate("empty", False, 0)
    simulate("there", True, 0)
    run("analyse", "-q", "--force", here / "empty")
    (here / "guessed.toml").write_text(objects(site) + GUESSED)
    parts = {"all": ("evidence.toml", [])} | (PARTS if with_parts else {})
    line = []
    for name, (scene, more) in parts.items():
        out = here / f"made-{name}"
        composite("empty", out, more, scene)
        mean_errors = errors(here, out, out if name == "all" else None)
        all_parts.setdefault(name, []).append(float(np.mean(mean_errors)))
        line.append(f"{name} {np.mean(mean_errors):.4f}")
    if with_noise:
        ratios, sigma = noise_ratios(here, simulate, composite)
        noises.append(ratios)
        line.append(f"sigma {ratios[0]:.3f} of the camera's {sigma[0]:.2f} codes on the evidence, {ratios[1]:.3f} over the box")
    light = tomllib.loads((here / "empty.analysis/analysis.toml").read_text()).get("light", {})
    print(f"site {site:2}: {', '.join(line)}; {sum(lamp['diameter_m'] < 1 for lamp in light.get('lamps', []))} lamps found", flush=True)
for name, values in all_parts.items():
    print(f"{name}: mean FLIP {np.mean(values):.4f}, worst {max(values):.4f}" + (" (0.055 wanted, 0.08 at each site)" if name == "all" else " without it"))
if noises:
    means, furthest = np.mean(noises, 0), np.abs(np.array(noises) - 1).max(0)
    print(f"sigma of the noise, composited over photographed: {means[0]:.3f} on the evidence (a site at most {furthest[0]:.3f} off 1), "
          f"{means[1]:.3f} over the box ({furthest[1]:.3f}); within 0.05 wanted")
