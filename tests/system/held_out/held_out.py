#!/usr/bin/env python3
"""Parts drawn at random, rendered, judged by the default recipe: docs/results/inspection.md, "Held-out light fields".

    tests/system/held_out/held_out.py build/release/bin [--seed 1126] [--keep FOLDER] [--recipe FILE]

Eleven good double-convex lenses and 29 with a defect of half a lenslet radius or more, each with another shape, pose,
source and light. A defect counts as found if the part is rejected with a place within three lenslets of those that it
changes; any other place is stray. Needs half a minute to two minutes of one core.
"""

import argparse
import json
import math
import pathlib
import random
import subprocess
import tempfile

GOOD = 11
DEFECTS = {"bubble": 6, "speck": 5, "cut": 4, "inclusion": 4, "scratch": 5, "stria": 2, "haze": 3}
LENSLETS, NEAR = 111, 3
DEFECT_LABELS = (3, 4)  # of the truth: docs/scene.md

SCENE = """name = "held-out"
[part]
kind = "double-convex"
radius_of_curvature_mm = {curvature:.2f}
aperture_radius_mm = {aperture:.2f}
edge_thickness_mm = {edge:.2f}
refractive_index = {index:.3f}
[light]
source_radius_bins = {source:.3f}
[camera]
m = 111
n = 111
i = 9
j = 9
field_mm = 24
bin_pitch_rad = 0.015
bits = 8
full_bin_dn = {light:.0f}
[pose]
x_mm = {x:.3f}
y_mm = {y:.3f}
tilt_x_rad = {tilt_x:.4f}
tilt_y_rad = {tilt_y:.4f}
[noise]
electrons_per_dn = 10
read_e = 2
"""


def scene(rng, kind):
    """The text of a scene; `kind` of its defect, or None."""
    draw = rng.uniform
    curvature, aperture = draw(180, 420), draw(8, 10)
    edge = draw(3, 5)
    text = SCENE.format(curvature=curvature, aperture=aperture, edge=edge, index=draw(1.46, 1.56),
                        source=draw(0.5, 0.8), light=draw(160, 240), x=draw(-0.7, 0.7), y=draw(-0.7, 0.7),
                        tilt_x=draw(-0.02, 0.02), tilt_y=draw(-0.02, 0.02))
    if kind is None:
        return text
    angle, distance = draw(0, 2 * math.pi), aperture * 0.75 * math.sqrt(rng.random())
    x, y, radius = distance * math.cos(angle), distance * math.sin(angle), draw(0.108, 0.6)
    sag = lambda r: curvature - math.sqrt(curvature**2 - r**2)
    face = edge / 2 + sag(aperture) - sag(distance)  # towards the camera
    text += f'[[defect]]\nkind = "{kind}"\n'
    if kind in ("scratch", "stria"):
        turn, half = draw(0, math.pi), draw(0.5, 2)
        dx, dy, z = half * math.cos(turn), half * math.sin(turn), face if kind == "scratch" else 0
        text += f"from_mm = [{x - dx:.3f}, {y - dy:.3f}, {z:.3f}]\nto_mm = [{x + dx:.3f}, {y + dy:.3f}, {z:.3f}]\n"
        text += f"radius_mm = {draw(0.108, 0.25) if kind == 'stria' else draw(0.05, 0.15):.3f}\n"
        return text + (f"index_difference = {draw(0.005, 0.02):.4f}\n" if kind == "stria" else "")
    z = face if kind == "cut" else 0
    if kind == "cut":
        radius = max(radius, 0.3)
    return text + f"centre_mm = [{x:.3f}, {y:.3f}, {z:.3f}]\nradius_mm = {radius:.3f}\n"


def judged(programs, folder, number, text, seed, recipe):
    """What is told of the scene, and the lenslets that its defect changes."""
    name = folder / f"{number:02d}"
    name.with_suffix(".toml").write_text(text)
    frame, truth = name.with_suffix(".png"), name.with_suffix(".json")
    subprocess.run([programs / "hord-lab", "render", name.with_suffix(".toml"), "--out", frame, "--truth", truth,
                    "--seed", str(seed)], check=True, capture_output=True)
    command = [programs / "hordctl", "inspect", frame, "--json"] + (["--recipe", recipe] if recipe else [])
    told = json.loads(subprocess.run(command, capture_output=True, text=True).stdout.splitlines()[0])
    labels = json.loads(truth.read_text())["labels"]
    return told, [(k % LENSLETS, k // LENSLETS) for k, label in enumerate(labels) if label in DEFECT_LABELS]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=pathlib.Path, help="folder of hordctl and hord-lab")
    parser.add_argument("--seed", type=int, default=1126)
    parser.add_argument("--keep", type=pathlib.Path, help="folder for scenes, frames and truths")
    parser.add_argument("--recipe", help="without it the default recipe")
    arguments = parser.parse_args()
    rng = random.Random(arguments.seed)
    kinds = [None] * GOOD + [kind for kind, count in DEFECTS.items() for _ in range(count)]
    passed = found = stray = 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.keep or pathlib.Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for number, kind in enumerate(kinds):
            told, changed = judged(arguments.programs, folder, number, scene(rng, kind), 1000 * arguments.seed + number,
                                   arguments.recipe)
            near = [d for d in told["defects"]
                    if any(math.hypot(d["m"] - m, d["n"] - n) <= NEAR for m, n in changed)]
            stray += len(told["defects"]) - len(near)
            passed += kind is None and told["verdict"] == "pass"
            found += kind is not None and told["verdict"] == "reject" and bool(near)
            print(f"{number:2d} {kind or 'good':9} {told['verdict']:6} {told['reason']:20} score {told['score']:.2f}",
                  flush=True)
    print(f"passed {passed} of {GOOD} good parts, found {found} of {len(kinds) - GOOD} defects, {stray} stray places")


if __name__ == "__main__":
    main()
