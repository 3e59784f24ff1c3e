#!/usr/bin/env python3
"""The light of 20 simulated sites with one to three lamps that are never seen, beside what it truly is.

    scripts/light_of_sites.py target/release/locard /tmp/sites [first last]

Prints a line for each and the two bars of docs/light.md. Sites that are there are not made again."""

import math
import subprocess
import sys
import tomllib
from pathlib import Path

program, folder = sys.argv[1], Path(sys.argv[2])
first, last = (int(n) for n in sys.argv[3:5]) if len(sys.argv) > 4 else (1, 20)
folder.mkdir(parents=True, exist_ok=True)


def mean(values):
    return sum(values) / len(values)


def off_deg(a, b):
    cosine = sum(p * q for p, q in zip(a, b)) / math.hypot(*a) / math.hypot(*b)
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


within, covered, angles = 0, 0, []
for site in range(first, last + 1):
    path = folder / f"s{site}"
    settings = {"frames": 24, "fps": 10, "lamps": (site - 1) % 3 + 1, "site": site, "seed": site, "samples": 8}
    if not path.exists():
        sets = [text for name, value in settings.items() for text in ("--set", f"{name}={value}")]
        subprocess.run([program, "simulate", "-q", "-o", path, *sets], check=True)
    subprocess.run([program, "analyse", "-q", "--force", path], check=True, stdout=subprocess.DEVNULL)
    truth = tomllib.loads((path / "truth.toml").read_text())["light"]
    light = tomllib.loads((folder / f"s{site}.analysis" / "analysis.toml").read_text())["light"]
    place = light["place_m"]
    way = lambda at, seen_from: [a - b for a, b in zip(at, seen_from)]
    shown = lambda at, by, on: mean(by) * max(way(at, on)[2], 0) / math.hypot(*way(at, on)) ** 3
    truth_lamps = list(zip(truth["lamps_at_m"], truth["lamps_shown_at_1_m"]))
    # The truth is told for one point; lamps follow their distance, all other light is taken to be alike at the place.
    true_white = mean(truth["upward"]) + sum(shown(*lamp, place) - shown(*lamp, truth["at_m"]) for lamp in truth_lamps)
    lamps = sorted(truth_lamps, key=lambda lamp: -shown(*lamp, place))
    # Without the wide lamps of bounce light.
    lamps_at_m = [lamp["at_m"] for lamp in light.get("lamps", []) if lamp["diameter_m"] < 1.0]
    deg = [min((off_deg(way(at, place), way(f, place)) for f in lamps_at_m), default=math.inf) for at, _ in lamps]
    white = mean(light["white_level"])
    ratio, (low, high) = white / true_white, light["between"]
    within += abs(ratio - 1) <= 0.2
    covered += low <= 1 / ratio <= high
    angles.append(deg[0])
    print(
        f"site {site:2}: white {white:.2f} of {true_white:.2f} = {ratio:.2f}, "
        f"{'claimed' if light['claimed'] else 'not claimed'}, {'within' if low <= 1 / ratio <= high else 'OUTSIDE'} "
        f"{low:.2f} to {high:.2f}, {len(lamps_at_m)} of {len(lamps)} lamps, off by {', '.join(f'{d:.1f}°' for d in deg)} "
        f"{light.get('why', '')} {light.get('no_lamp', '')}",
        flush=True,
    )
angles.sort()
half = len(angles) // 2
middle = angles[half] if len(angles) % 2 else 0.5 * (angles[half - 1] + angles[half])
print(
    f"white within 20 %: {within} of {len(angles)} sites; truth within the interval: {covered}; "
    f"brightest lamp {middle:.1f}° off, median (5° wanted)"
)
