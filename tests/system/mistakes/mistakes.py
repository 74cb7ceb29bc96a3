#!/usr/bin/env python3
"""The table of docs/mistakes.md: common mistakes, what the programs say of them, and their exit status. It runs the real
programs in an empty folder with a few small files.

    mistakes.py BIN                  prints the page
    mistakes.py BIN --compare PAGE   fails, and shows the difference, if the page says something else
"""
import difflib, os, re, shlex, subprocess, sys, tempfile

HEAD = """# Mistakes and what the programs say

Each row was made by running the command: the message is what the program writes on the standard error output, and the
status is its exit status. A message is one line: what is wrong, and the cure.

This page is written by the command

    {generate}

and a test (`mistakes_page`) fails if the programs say something else. The files that the commands name are listed at
the end.
"""

SIMULATED = "".join(f'[{device}]\nbackend = "simulated"\n' for device in ("part_sensor", "strobe", "sensor", "rejector"))
RECIPE = 'schema = 1\nname = "lens"\nnumber = 7\n'


def pgm(width, height, value=64):
    return b"P5\n%d %d\n255\n" % (width, height) + bytes([value]) * (width * height)


FILES = {
    "flat.pgm": ("an even grey frame of 90x63 pixels", pgm(90, 63)),
    "odd.pgm": ("a frame of 97x61 pixels, which no macro-pixel divides", pgm(97, 61)),
    "small.pgm": ("a frame of 10x10 pixels", pgm(10, 10)),
    "cut.pgm": ("a frame whose last rows are missing", pgm(90, 63)[:2000]),
    "colour.ppm": ("a colour image", b"P6\n9 9\n255\n" + bytes(243)),
    "noted.pgm": ("a frame whose note says 7x7 bins", pgm(63, 63)),
    "noted.frame.json": ("its note", b'{"schema": 1, "kind": "macro-pixels", "grid": {"m": 9, "n": 9, "i": 7, "j": 7}, "bits": 8}'),
    "raw.pgm": ("a frame whose note says that it is raw", pgm(90, 63)),
    "raw.frame.json": ("its note", b'{"schema": 1, "kind": "raw", "bits": 8}'),
    "text.png": ("a text with the name of an image", b"this is no image\n"),
    "old.mat": ("a MATLAB file of version 5", b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + bytes(200)),
    "cut.lfp": ("a Lytro file that is cut off", b"\x89LFP\r\n\x1a\n" + bytes(30)),
    "blank.toml": ("an empty file", b""),
    "lens.toml": ("a recipe", (RECIPE + "[limits]\nemd_bins = 1.0\n").encode()),
    "lens2.toml": ("another recipe with the same number", RECIPE.replace("lens", "lens2").encode()),
    "typo.toml": ("a recipe with a key that does not exist", (RECIPE + "[limits]\nemd_bin = 1.0\n").encode()),
    "quote.toml": ("a recipe with a text that is not closed", RECIPE.replace('"lens"', '"lens').encode()),
    "range.toml": ("a recipe with a limit below 0", (RECIPE + "[limits]\nemd_bins = -1.0\n").encode()),
    "schema.toml": ("a recipe of a later schema", RECIPE.replace("schema = 1", "schema = 99").encode()),
    "unsealed.toml": ("a sealed recipe that was edited", None),
    "needs.toml": ("a recipe whose reference is missing", (RECIPE + '[reference]\nfile = "missing.hordref"\n').encode()),
    "cut.hordref": ("a reference that is cut off", b"HORDREF2 and more"),
    "edited.toml": ("a calibration that was edited", b"# hord-grid 0123456789abcdef\nversion = 1\n"),
    "station.toml": ("a station's configuration, all devices simulated", SIMULATED.encode()),
    "table.toml": ("a configuration with a misspelled table", SIMULATED.replace("[strobe]", "[strobee]").encode()),
    "key.toml": ("a configuration with a key that does not exist", (SIMULATED + "[line]\ntransport = 900\n").encode()),
    "backend.toml": ("a configuration with an unknown backend", SIMULATED.replace('"simulated"', '"simulatd"', 1).encode()),
    "late.toml": ("a configuration whose times contradict each other", (SIMULATED + "[line]\ntransport_ms = 1\n").encode()),
    "nofile.toml": ("a configuration whose recipe is missing", (SIMULATED + '[inspection]\nrecipe = "missing.toml"\n').encode()),
    "folder.toml": ("a configuration whose store lies in a folder that does not exist", (SIMULATED + '[store]\nfolder = "missing/store"\n').encode()),
    "feature.toml": ("a configuration with a GenICam feature and no GenICam camera", (SIMULATED + '[[sensor.feature]]\nname = "Gain"\nvalue = 3\n').encode()),
    "page.toml": ("a configuration of hord-page", b'[station]\nmodbus = "127.0.0.1:1502"\n'),
    "mqtt.toml": ("a configuration of hord-mqtt with a key that does not exist", b'[broker]\nhots = "localhost"\n'),
    "shard.jsonl": ("a shard of a replay that is no JSON", b"not a shard\n"),
    "scene.toml": ("a scene with a key that does not exist", b"[lens]\nradius = 3\n"),
    "cell.toml": ("a scene", b'name = "cell"\n[camera]\nm = 45\nn = 45\n'),
    "wall.toml": ("a list of stations", b'[[station]]\nname = "Cell 1"\nmodbus = "127.0.0.1:1502"\n'),
}

# Sentences of libraries (CLI11's ranges and sets of words) are left out: they differ from version to version.
# Port 9 (discard) has no server: the answer is a refused connection.
MISTAKES = [
    ("The command line", [
        "hordctl",
        "hordctl inspekt flat.pgm",
        "hordctl wobble",
        "hordctl recipe chek lens.toml",
        "hordctl inspect",
        "hordctl inspect --macroo 9x9 flat.pgm",
        "hordctl inspect flat.pgm --macro",
        "hordctl inspect flat.pgm --macro 9by9",
        "hordctl inspect flat.pgm --macro 9x9 --macro 7x7",
        "hordctl inspect flat.pgm --macro 4294967305x9",
        "hordctl selftest now",
        "hordctl soak --parts 100",
        "hordctl help",
        "hordctl command rest",
        "hordctl command start",
        "hordctl reset",
        "hordctl start",
        "hordctl status --timeout abc",
        "hordctl run --simulate --foo",
        "hordctl results --verdict rejects",
        "hordctl results --last",
        "hordctl results --last 0",
        "hordctl inspect flat.pgm --json=maybe",
        "hordctl replay --today --recipe lens.toml",
        "hordctl run --simulate --parts -3",
        "hordctl run --simulate --parts ten",
        "hordctl run --simulate --parts 1e3",
        "hordctl run --simulate --seed 010",
        "hord-lab experiment papper --out o",
    ]),
    ("Frames", [
        "hordctl inspect missing.png",
        "hordctl inspect text.png",
        "hordctl inspect cut.pgm",
        "hordctl inspect colour.ppm",
        "hordctl inspect odd.pgm",
        "hordctl inspect flat.pgm --macro 7x7",
        "hordctl inspect small.pgm --macro 5x5",
        "hordctl inspect noted.pgm --macro 9x9",
        "hordctl inspect raw.pgm",
        "hordctl inspect lens.toml",
        "hordctl inspect flat.pgm --feature emdd",
        "hordctl inspect flat.pgm --feature reference-emd",
        "hordctl inspect flat.pgm --feature z-score",
        "hordctl inspect flat.pgm --out small.pgm",
        "hordctl import text.png --out o.png",
        "hordctl import old.mat --out o.png",
        "hordctl import cut.lfp --out o.png",
        "hordctl export flat.pgm --feature emdd --out o",
        "hordctl learn flat.pgm --out o.hordref",
        "hordctl learn flat.pgm noted.pgm --out o.hordref",
    ]),
    ("Recipes and references", [
        "hordctl recipe check missing.toml",
        "hordctl recipe check blank.toml",
        "hordctl recipe check typo.toml",
        "hordctl recipe check quote.toml",
        "hordctl recipe check range.toml",
        "hordctl recipe check schema.toml",
        "hordctl recipe check unsealed.toml",
        "hordctl recipe check needs.toml",
        "hordctl recipe check lens.toml lens2.toml",
        "hordctl recipe check station.toml",
        "hordctl recipe check cell.toml",
        "hordctl inspect flat.pgm --reference cut.hordref",
        "hordctl inspect flat.pgm --reference missing.hordref",
        "hordctl inspect flat.pgm --recipe cut.hordref",
    ]),
    ("Calibration", [
        "hordctl calibrate flat.pgm --out grid.toml",
        "hordctl calibrate small.pgm --out grid.toml",
        "hordctl calibrate noted.pgm --out grid.toml",
        "hordctl calibrate missing.png --out grid.toml",
        "hordctl inspect flat.pgm --grid edited.toml",
        "hordctl inspect flat.pgm --grid lens.toml",
        "hordctl inspect flat.pgm --grid missing.toml",
    ]),
    ("A station", [
        "hordctl status --modbus 127.0.0.1:9",
        "hordctl command reset --modbus 127.0.0.1:9",
        "hordctl devices --module host:seven",
        "hordctl devices --modbus 192.168.1.30",
        "hordctl devices --unit 5",
        "hordctl results --store missing",
        "hordctl results --store . --reason verdict-lat",
        "hordctl results --store . --since 2026-11-22 --until 2026-11-21",
        "hordctl replay --store missing",
        "hordctl run --simulate --parts 1 --modbus 127.0.0.1:0 --store flat.pgm",
        "hordctl run --simulate --parts 1 --modbus 127.0.0.1:0 --out flat.pgm",
        "hordctl merge shard.jsonl --out o.jsonl",
    ]),
    ("Configurations", [
        "hordd --check --config missing.toml",
        "hordd --check --config blank.toml",
        "hordd --check --config key.toml",
        "hordd --check --config table.toml",
        "hordd --check --config backend.toml",
        "hordd --check --config late.toml",
        "hordd --check --config nofile.toml",
        "hordd --check --config folder.toml",
        "hordd --check --config feature.toml",
        "hordd --check --config lens.toml",
        "hordd --check --config cell.toml",
        "hord-safe --config blank.toml",
        "hord-page --check --config station.toml",
        "hord-page --check --config wall.toml",
        "hord-page --check --store flat.pgm",
        "hord-page --stations page.toml",
        "hord-page --listen 8070",
        "hord-mqtt --check --config mqtt.toml",
        "hord-mqtt --check --config station.toml",
    ]),
    ("The simulated cell", [
        "hord-lab render missing.toml --out o.png",
        "hord-lab render scene.toml --out o.png",
        "hord-lab render station.toml --out o.png",
        "hord-lab render lens.toml --out o.png",
        "hord-lab soak --parts -1",
    ]),
]


def prepare(folder, binaries):
    for name, (_, content) in FILES.items():
        if content is not None:
            with open(os.path.join(folder, name), "wb") as file:
                file.write(content)
    sealed = os.path.join(folder, "unsealed.toml")
    with open(sealed, "w") as file:
        file.write(RECIPE)
    subprocess.run([os.path.join(binaries, "hordctl"), "recipe", "seal", sealed], check=True, capture_output=True)
    with open(sealed, "a") as file:
        file.write("[limits]\nemd_bins = 2.0\n")


def run(folder, binaries, command):
    words = shlex.split(command)
    environment = {"PATH": "/usr/bin:/bin", "LC_ALL": "C.UTF-8", "TZ": "UTC", "HOME": folder}
    done = subprocess.run([os.path.join(binaries, words[0])] + words[1:], cwd=folder, env=environment,
                          capture_output=True, text=True, timeout=120)
    # A file may be named by its whole path.
    said = done.stderr.replace(os.path.realpath(folder) + "/", "").replace(folder + "/", "").replace(binaries + "/", "")
    # Without the lines of a progress.
    return done.returncode, [line for line in said.splitlines() if line.strip() and not re.fullmatch(r"\w+: +\d+ %", line)]


def page(binaries):
    out = [HEAD.format(generate="tests/system/mistakes/mistakes.py build/release/bin > docs/mistakes.md")]
    count = 0
    with tempfile.TemporaryDirectory(prefix="hord-mistakes.") as folder:
        prepare(folder, binaries)
        for title, commands in MISTAKES:
            out.append(f"\n## {title}\n\n| command | message | status |\n|---|---|---|\n")
            for command in commands:
                status, lines = run(folder, binaries, command)
                if status == 0 or not lines:
                    sys.exit(f"{command}: status {status}, and nothing is said: it is no mistake")
                message = "<br>".join(line.replace("|", "\\|").replace("<", "&lt;") for line in lines)
                out.append(f"| `{command}` | {message} | {status} |\n")
                count += 1
    if count < 40:
        sys.exit(f"only {count} mistakes")
    out.append("\n## The files\n\n| file | what it is |\n|---|---|\n")
    out += [f"| `{name}` | {what} |\n" for name, (what, _) in FILES.items()]
    return "".join(out)


binaries = os.path.abspath(sys.argv[1])
text = page(binaries)
if len(sys.argv) == 2:
    sys.stdout.write(text)
else:
    with open(sys.argv[3], encoding="utf-8") as file:
        held = file.read()
    if held != text:
        sys.stdout.writelines(difflib.unified_diff(held.splitlines(True), text.splitlines(True), sys.argv[3], "what the programs say"))
        sys.exit("the page is not what the programs say: tests/system/mistakes/mistakes.py build/release/bin > docs/mistakes.md")
    print("the page says what the programs say")
