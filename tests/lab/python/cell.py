"""Frames of the simulated cell, rendered by hord-lab, and hordctl as a person calls it."""
import json, os, subprocess, tempfile

import numpy as np
from PIL import Image

BIN = os.environ["HORD_BIN"]
SOURCE = os.environ["HORD_SOURCE"]

LENS = """name = "{name}"
[part]
kind = "double-convex"
radius_of_curvature_mm = 190
aperture_radius_mm = 10
edge_thickness_mm = 4
refractive_index = 1.5
[light]
source_radius_bins = 0.61
[camera]
m = 45
n = 45
i = 9
j = 9
field_mm = 24
bin_pitch_rad = 0.015
bits = {bits}
full_bin_dn = {full}
[noise]
electrons_per_dn = 10
read_e = 6
"""
BUBBLE = '[[defect]]\nkind = "bubble"\ncentre_mm = [2, -1, 0]\nradius_mm = 0.6\n'


class Cell:
    """A folder of frames; remove with close()."""

    def __init__(self):
        self.folder = tempfile.TemporaryDirectory(prefix="hord-python.")

    def close(self):
        self.folder.cleanup()

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def write(self, name, text):
        with open(self.path(name), "w") as file:
            file.write(text)
        return self.path(name)

    def render(self, name, defects="", seed=1, bits=8):
        scene = self.write(name + ".toml", LENS.format(name=name, bits=bits, full=240 << (bits - 8)) + defects)
        frame = self.path(name + ".png")
        if not os.path.exists(frame):
            subprocess.run([os.path.join(BIN, "hord-lab"), "render", scene, "--out", frame, "--seed", str(seed)], check=True, capture_output=True)
        return frame

    def good_parts(self, count):
        """Each lies a little differently: exposures of one part would count once."""
        poses = [(0.3 * np.sin(5 * k), 0.3 * np.cos(7 * k)) for k in range(count)]
        return [self.render(f"good{k}", f"[pose]\nx_mm = {x:.3f}\ny_mm = {y:.3f}\n", seed=100 + k) for k, (x, y) in enumerate(poses)]


def pixels(file):
    return np.array(Image.open(file))


def hordctl(*arguments):
    done = subprocess.run([os.path.join(BIN, "hordctl"), *map(str, arguments)], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def inspected(*arguments):
    """The object of hordctl inspect --json."""
    status, out, error = hordctl("inspect", *arguments, "--json")
    assert status != 2, error
    return json.loads(out)


def white_frame(pitch=12.4, turn=0.004, side=400):
    y, x = np.mgrid[0:side, 0:side]
    u = ((x - side / 2) * np.cos(turn) + (y - side / 2) * np.sin(turn)) / pitch
    v = ((y - side / 2) * np.cos(turn) - (x - side / 2) * np.sin(turn)) / pitch
    r2 = (u - np.round(u)) ** 2 + (v - np.round(v)) ** 2
    return (20 + 200 * np.exp(-r2 / (2 * 0.16**2))).astype(np.uint8)
