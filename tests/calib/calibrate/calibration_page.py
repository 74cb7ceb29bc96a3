#!/usr/bin/env python3
"""Prints docs/results/calibration.md, every number of it from this run, but for the speed (calibration_speed.md):

    tests/calib/calibrate/calibration_page.py [BUILD/bin] [FOLDER with lenslet/ and bench/] > docs/results/calibration.md

Needs the targets calibration_table, bench_decode and those of PROGRAMS. Fails when a test fails.
With "--check" it runs nothing: it fails if the page's prose is not that of calibration_answer.md and
calibration_speed.md."""
import contextlib, datetime, io, json, os, subprocess, sys, tempfile, textwrap

here = os.path.dirname(os.path.abspath(__file__))
root = os.path.abspath(os.path.join(here, "../../.."))
if sys.argv[1:] == ["--check"]:
    written = open(os.path.join(root, "docs/results/calibration.md")).read()
    for name in ("calibration_answer.md", "calibration_speed.md"):
        if open(os.path.join(here, name)).read() not in written:
            sys.exit(f"docs/results/calibration.md differs from tests/calib/calibrate/{name}: write the same into both")
    sys.exit(0)
bin_folder = sys.argv[1] if len(sys.argv) > 1 else os.path.join(root, "build/release/bin")
data = sys.argv[2] if len(sys.argv) > 2 else os.environ.get("HORD_DATA", os.path.join(root, "../shared/data"))

PROGRAMS = ["test_calib_fit", "test_calib_tilts", "test_calib_calibrate", "test_calib_files", "test_algo_frame", "test_algo_ageing",
            "test_firmware_devices"]
PROMISES = [  # what is promised, by which tests
    ("95 % intervals cover the truth (93 to 97 %)", "GridFit.ninety_five*:DirectionFit.ninety_five*"),
    ("a capture left out of the direction map is predicted to 0.02 px", "TiltFrames.captured*:DirectionFit.scale*"),
    ("lenslets that are misplaced get places of their own, others (dust) none", "DisplacedLenslets.*:BlemishedLenslets.*:CalibrateGrid.misplaced*:CalibrateGrid.a_few_displaced*:CalibrateGrid.centres_that_are_not*:CalibrateGrid.lenslets_in_their_places*"),
    ("lenslets that light reaches whole are distinguished from those in the dark", "CalibrateGrid.a_dark_quarter*:CalibrateGrid.dead_lenslets*"),
    ("EMD gradient of a decoded, rotated, distorted array against the ideal aligned one: hexagonal 0.05, square 0.02 bin RMS", "DecodeFeatures.*"),
    ("decoded frames have the same bits everywhere", "Resample.*bits*:RegridBits.*:GridDecoder.*"),
    ("drift of 0.1 px is measured to 0.01 px and noticed within 50 parts", "Drift*-DriftMonitor.*"),
    ("the fault comes, and goes when the drift is gone", "DriftMonitor.*"),
    ("a worse calibration does not replace a better one, in the file or in the station", "Better.*"),
    ("", "CalibrationFile.*"),
    ("strong distortion is followed to the corners, or refused", "NotSilentlyWrong.radial*:NotSilentlyWrong.so_is*:NotSilentlyWrong.corners*:NotSilentlyWrong.no_lenslet*"),
    ("what is no white frame is refused or warned of", "NotSilentlyWrong.a_*:NotSilentlyWrong.light_*:NotSilentlyWrong.two*:NotSilentlyWrong.an_*:NotSilentlyWrong.aberrated*:NotSilentlyWrong.missing*:NotSilentlyWrong.lenslets*:NotSilentlyWrong.square*:NotSilentlyWrong.dark*:OneSidedLight.*:FallOff.*:WhiteExposures.*:RowShift.*"),
    ("no white frame: refused", "CalibrateGrid.a_frame_with_a_part*:CalibrateGrid.frames_without*"),
]
EXTREMES = [
    ("one row of lenslets", "*one_row*"), ("3x3", "*three_by_three*"), ("a quarter of the frame dark", "*dark_quarter*"),
    ("30 % missing centres", "*thirty_percent_dead*"), ("30 % wrong centres", "*thirty_percent_wrong*"), ("saturated", "CalibrateGrid.*saturated*"),
    ("a bubble in the calibration frame", "*bubble*"), ("45 degrees", "*forty_five*"), ("integer pitch at 0 degrees", "*integer_pitch*"),
    ("sharp edges", "*sharp_edges*"), ("a hint that is 10 % wrong", "*hint*"), ("nearly collinear tilts", "*collinear*"),
    ("rank-deficient problems: an answer, no abort", "*degenerate*:*insignificant_k1*"), ("other starts reach the same optimum", "*search_starts*"),
    ("analytic against numeric Jacobians", "*analytic*"),
]


def run(program, *arguments):
    return subprocess.run([os.path.join(bin_folder, program), *arguments], check=True, capture_output=True, text=True, env={**os.environ, "HORD_DATA": data}).stdout


def tests(which):
    """[(name, what it recorded)] of the tests that ran and passed, in whichever of PROGRAMS they are."""
    own = {"name", "file", "line", "status", "result", "timestamp", "time", "classname", "value_param", "type_param"}
    ran = []
    for program in PROGRAMS:
        if "  " not in run(program, "--gtest_list_tests", f"--gtest_filter={which}"):
            continue
        with tempfile.NamedTemporaryFile(suffix=".json") as file:
            run(program, f"--gtest_filter={which}", f"--gtest_output=json:{file.name}")
            report = json.load(open(file.name))
        for suite in report["testsuites"]:
            for case in suite["testsuite"]:
                recorded = "; ".join(f"{key}: {value}" for key, value in case.items() if key not in own)
                ran.append((f"{suite['name']}.{case['name']}", recorded))
    if not ran:
        sys.exit(f"no test {which}")
    return ran


def wrapped(lines):
    """Prose in at most 120 columns, paragraph by paragraph; tables, headings and code as they are."""
    def is_prose(line):
        return line.strip() and not line.startswith(("|", "#", "    "))

    while lines:
        block = [lines.pop(0)]
        indent = "  " if block[0].startswith("- ") else ""
        while is_prose(block[0]) and lines and is_prose(lines[0]) and not lines[0].startswith("- "):
            block.append(lines.pop(0))
        if max(map(len, block)) > 120 and is_prose(block[0]):
            text = " ".join(line.strip() for line in block)
            block = textwrap.wrap(text, 120, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
        yield from block


page = io.StringIO()
with contextlib.redirect_stdout(page):
    commit = subprocess.run(["git", "-C", root, "rev-parse", "--short=8", "HEAD"], capture_output=True, text=True).stdout.strip()
    model = next((line.split(": ")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), "a machine")
    print("# Lenslet-grid calibration, measured\n")
    print(f"Made by `tests/calib/calibrate/calibration_page.py BUILD/bin FOLDER > docs/results/calibration.md`; FOLDER holds `lenslet/` and `bench/`.\n"
          f"Run on {datetime.date.today()} at commit {commit}, on {model}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.0f} at the start: other work lengthens\n"
          "CPU times. Every number comes from that run, but for the speed against threshold and components. tests/calib/support/synthetic.h draws the\n"
          "frames of known truth; it shares no code with the fitter, and its seed is 1 where none is named.\n")
    print(open(os.path.join(here, "calibration_answer.md")).read())
    print(run("calibration_table", data))
    print(open(os.path.join(here, "calibration_speed.md")).read())
    print("## What tests hold\n\n| promise | test | measured |\n|---|---|---|")
    for promise, which in PROMISES:
        for name, recorded in tests(which):
            print(f"| {promise} | `{name}` | {recorded or 'held'} |")
            promise = ""
    print("\n## Extremes\n\n| case | test |\n|---|---|")
    for case, which in EXTREMES:
        print(f"| {case} | {', '.join(f'`{name}`' for name, _ in tests(which))} |")
    print("\n## What decoding costs\n\n"
          "The macro-pixel path is one whole inspection, from the frame's samples to the verdict, of a macro-pixel frame of 555x555 lenslets with 9x9 bins (`bench_decode`,\n"
          "CPU time of one thread). A raw frame is decoded first, then judged the same way: the share in the last column is what is added. Splitting a macro-pixel frame into\n"
          "HORDs is the part of the path that decoding most resembles; decoding reads 9 raw pixels a bin where splitting reads one.\n")
    print("\n".join(line for line in run("bench_decode").splitlines() if line.startswith("|")))
print("\n".join(wrapped(page.getvalue().splitlines())))
