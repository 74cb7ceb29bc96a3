#!/usr/bin/env python3
"""Parts drawn at random, traced by POV-Ray and judged: docs/results/inspection.md, "Held-out light fields".

    povray_fields.py FOLDER build/release/bin [--seed 2611] [--parallel 10]

Eleven good lenses and 29 with a defect of a lenslet across or more: 61x61 lenslets of 9x9 bins, nine directions a bin
and nine rays a lenslet for each. The default recipe judges each light field without noise (240 DN a full bin) and in
three exposures of 10 electrons a DN (200 DN, 2 electrons of read noise). A defect counts as found if the part is
rejected with a place within three lenslets of it. Needs the package povray, and 13 s of one core a light field; ten are
traced at a time, because POV-Ray mostly waits. Light fields that FOLDER holds are not traced again.
"""

import argparse
import array
import collections
import concurrent.futures
import json
import math
import pathlib
import random
import struct
import subprocess
import tempfile
import zlib

LENSLETS, BINS, DIRECTIONS, RAYS, FIELD_MM, BIN_RAD = 61, 9, 3, 3, 24.0, 0.015  # DIRECTIONS, RAYS: along each axis
PITCH_MM, SIDE, STEPS = FIELD_MM / LENSLETS, LENSLETS * BINS, BINS * DIRECTIONS
GOOD = 11
DEFECTS = {"bubble": 6, "cut": 5, "speck": 4, "dimple": 4, "scratch": 4, "inclusion": 3, "stria": 3}
NEAR = 3
FULL = DIRECTIONS**2 * RAYS**2  # rays of a full bin

# A camera for each direction; it looks along light that leaves the middle plane with the slopes U and V.
SCENE = """#version 3.7;
global_settings {{ assumed_gamma 1 max_trace_level 30 adc_bailout 0 }}
#declare K = clock;
#declare U = (mod(K, {steps}) - {middle}) * {step};
#declare V = (floor(K / {steps}) - {middle}) * {step};
camera {{ orthographic location <U*100, V*100, 100> direction <-U, -V, -1> right <{field}, 0, 0> up <0, -{field}, 0> }}
sky_sphere {{ pigment {{ function {{ 0.75*select(x*x + y*y - {slopes}*z*z, 1, 0)*select(z, 1, 0) }}
                         color_map {{ [0.5 rgb 0] [0.5 rgb 1] }} }} }}
union {{ object {{ {body} {glass} }} {more} rotate <{turn_x}, {turn_y}, 0> translate <{x}, {y}, 0> }}
"""


def glass(index):
    return f"pigment {{ rgbt 1 }} finish {{ ambient 0 diffuse 0 }} interior {{ ior {index:.5f} }}"


def without(body, shape):
    return f"difference {{ object {{ {body} }} object {{ {shape} }} }}"


def drawn(seed, number, kind):
    """The text of a scene, and its truth: places in lenslets."""
    rng = random.Random(seed * 1000 + number)
    draw = rng.uniform
    curvature, aperture, edge, index = draw(170, 420), draw(8, 10), draw(3, 5), draw(1.46, 1.56)
    flat = rng.random() < 0.3  # plano-convex
    if flat:
        curvature *= 0.6
    source, x0, y0, turn_x, turn_y = draw(0.5, 0.8), draw(-0.7, 0.7), draw(-0.7, 0.7), draw(-1.1, 1.1), draw(-1.1, 1.1)
    sag = lambda r: curvature - math.sqrt(curvature**2 - r**2)
    top = edge / 2 + sag(aperture)
    under = f"plane {{ -z, {edge / 2} }}" if flat else f"sphere {{ <0, 0, {curvature - top}>, {curvature} }}"
    body = (f"intersection {{ sphere {{ <0, 0, {top - curvature}>, {curvature} }} "
            f"cylinder {{ <0, 0, {-top - 1}>, <0, 0, {top + 1}>, {aperture} }} {under} }}")
    truth, more = {"kind": kind}, ""
    if kind:
        angle, distance = draw(0, 2 * math.pi), aperture * 0.75 * math.sqrt(rng.random())
        x, y = distance * math.cos(angle), distance * math.sin(angle)
        face = top - sag(distance)
        radius = math.exp(draw(math.log(PITCH_MM / 2), math.log(2 * PITCH_MM)))
        inside = min(radius, edge / 2 - 0.3)
        turn, half = draw(0, math.pi), draw(0.75, 2)
        ends = [(x + s * half * math.cos(turn), y + s * half * math.sin(turn)) for s in (-1, 1)]
        if kind == "bubble":
            body = without(body, f"sphere {{ <{x}, {y}, 0>, {inside} }}")
        elif kind == "cut":
            body = without(body, f"sphere {{ <{x}, {y}, {face}>, {radius} }}")
        elif kind == "dimple":
            depth = draw(0.008, 0.025)
            of_dimple = (radius**2 + depth**2) / 2 / depth
            body = without(body, f"sphere {{ <{x}, {y}, {face - depth + of_dimple}>, {of_dimple} }}")
        elif kind == "speck":
            more = f"sphere {{ <{x}, {y}, 0>, {radius} pigment {{ rgb 0 }} finish {{ ambient 0 diffuse 0 }} }}"
        elif kind == "scratch":
            half_width = draw(0.05, 0.15)
            (xa, ya), (xb, yb) = ends
            za, zb = (top - sag(math.hypot(*end)) + 0.3 * half_width for end in ends)
            body = without(body, f"cylinder {{ <{xa}, {ya}, {za}>, <{xb}, {yb}, {zb}>, {half_width} }}")
        else:
            difference = rng.choice([-1, 1]) * draw(0.008, 0.025)
            (xa, ya), (xb, yb) = ends
            shape = (f"sphere {{ <{x}, {y}, 0>, {inside} }}" if kind == "inclusion" else
                     f"cylinder {{ <{xa}, {ya}, 0>, <{xb}, {yb}, 0>, {min(radius, 0.4)} }}")
            body = without(body, shape)
            more = f"object {{ {shape} {glass(index + difference)} }}"
        if kind not in ("scratch", "stria"):
            ends = [(x, y)] * 2
        truth["ends"] = [[(a + x0) / PITCH_MM + (LENSLETS - 1) / 2, (b + y0) / PITCH_MM + (LENSLETS - 1) / 2]
                         for a, b in ends]
        truth["radius"] = radius / PITCH_MM
    return SCENE.format(steps=STEPS, middle=(STEPS - 1) / 2, step=BIN_RAD / DIRECTIONS, field=FIELD_MM,
                        slopes=(source * BIN_RAD)**2, body=body, glass=glass(index), more=more, turn_x=turn_x,
                        turn_y=turn_y, x=x0, y=y0), truth


def traced(text):
    """Rays of every bin, row by row of the macro-pixel frame."""
    rays, width = array.array("H", bytes(2 * SIDE * SIDE)), LENSLETS * RAYS
    with tempfile.TemporaryDirectory() as folder:
        scene = pathlib.Path(folder) / "scene.pov"
        scene.write_text(text)
        last = str(STEPS**2 - 1)
        subprocess.run(["povray", f"+I{scene}", f"+O{folder}/f.ppm", f"+W{width}", f"+H{width}", "-D", "-A", "+FP8",
                        "Grayscale_Output=on", "File_Gamma=1.0", "+KFI0", f"+KFF{last}", "+KI0", f"+KF{last}", "+WT1",
                        "-GA"], check=True, capture_output=True, stdin=subprocess.DEVNULL)
        for at, image in enumerate(sorted(pathlib.Path(folder).glob("*.ppm"))):
            samples = image.read_bytes()[-2 * width * width + 1::2]  # 16 bits: the low bytes are 0 or 255
            seen = samples.translate(bytes([0] * 128 + [1] * 128))
            u, v = at % STEPS // DIRECTIONS, at // STEPS // DIRECTIONS
            for n in range(LENSLETS):
                rows = [seen[(n * RAYS + k) * width:(n * RAYS + k + 1) * width] for k in range(RAYS)]
                sums = [sum(cell) for cell in zip(*[row[k::RAYS] for row in rows for k in range(RAYS)])]
                begin = (n * BINS + v) * SIDE + u
                for m, count in enumerate(sums):
                    rays[begin + m * BINS] += count
    return rays


def exposed(rays, exposure):
    """8-bit samples; exposure 0 has no noise."""
    if exposure == 0:
        return bytes(int(240 * r / FULL + 0.5) for r in rays)
    rng = random.Random(exposure)
    electrons = [2000 * r / FULL for r in rays]
    return bytes(max(0, min(255, int((e + rng.gauss(0, math.sqrt(e + 4))) / 10 + 0.5))) for e in electrons)


def png(samples):
    chunk = lambda kind, data: struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    rows = b"".join(b"\0" + samples[y * SIDE:(y + 1) * SIDE] for y in range(SIDE))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", SIDE, SIDE, 8, 0, 0, 0, 0)) +
            chunk(b"IDAT", zlib.compress(rows, 1)) + chunk(b"IEND", b""))


def is_near(defect, truth):
    (ax, ay), (bx, by) = truth["ends"]
    squared = (bx - ax)**2 + (by - ay)**2
    along = ((defect["m"] - ax) * (bx - ax) + (defect["n"] - ay) * (by - ay)) / squared if squared else 0
    along = max(0, min(1, along))
    away = math.hypot(defect["m"] - ax - along * (bx - ax), defect["n"] - ay - along * (by - ay))
    return away <= NEAR + (0 if squared else truth["radius"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("programs", type=pathlib.Path, help="folder of hordctl")
    parser.add_argument("--seed", type=int, default=2611)
    parser.add_argument("--parallel", type=int, default=10, help="light fields traced at a time")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    kinds = [None] * GOOD + [kind for kind, count in DEFECTS.items() for _ in range(count)]

    def trace(number):
        file = arguments.folder / f"{number:02d}.u16"
        if not file.exists():
            file.write_bytes(traced(drawn(arguments.seed, number, kinds[number])[0]).tobytes())

    with concurrent.futures.ThreadPoolExecutor(arguments.parallel) as pool:
        list(pool.map(trace, range(len(kinds))))
    told = collections.Counter()
    for number, kind in enumerate(kinds):
        truth = drawn(arguments.seed, number, kind)[1]
        rays = array.array("H", (arguments.folder / f"{number:02d}.u16").read_bytes())
        for exposure in range(4):
            frame = arguments.folder / f"{number:02d}.{exposure}.png"
            frame.write_bytes(png(exposed(rays, exposure)))
            inspect = [arguments.programs / "hordctl", "inspect", frame, "--macro", "9x9", "--json"]
            said = json.loads(subprocess.run(inspect, capture_output=True, text=True).stdout.splitlines()[0])
            near = [d for d in said["defects"] if kind and is_near(d, truth)]
            of = "noisy" if exposure else "noise-free"
            told[of, "stray places"] += len(said["defects"]) - len(near)
            right = said["verdict"] == ("reject" if kind else "pass") and (near or not kind)
            told[of, "defects found" if kind else "good parts passed"] += bool(right)
            if not right or len(said["defects"]) > len(near):
                print(f"{frame.name} {kind or 'good'} {said['verdict']} {said['reason']} score {said['score']:.2f}, "
                      f"{len(said['defects']) - len(near)} stray")
    for (of, what), count in sorted(told.items()):
        print(f"{of} {what}: {count}")


if __name__ == "__main__":
    main()
