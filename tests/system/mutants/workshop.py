"""Compiles all mutants of a room at once, runs the tests on each, and tells what becomes of it."""

import collections
import concurrent.futures
import dataclasses
import itertools
import json
import os
import re
import resource
import shlex
import subprocess
import sys
import threading

from mutations import ROOT, schema

RELEASE = ROOT / "build/release"
OUT = ROOT / "build/mutants"
SOAK_SEEDS, SOAK_PARTS = (1, 2), 10000
FAST_TEST_MS = 30  # tests up to this time run first
MUTANTS_A_FILE = 2000  # more than any file has
# The store's tests on no disk, with a tenth of their crashes, flipped bits and damaged values.
QUICK = {"HORD_CRASHES": "15", "HORD_FLIPS": "40", "HORD_EDITS": "10",
         **({"TMPDIR": "/dev/shm"} if os.access("/dev/shm", os.W_OK) else {})}


def source_of(object_file):
    return re.sub(r"CMakeFiles/[^/]+\.dir/", "", object_file).removesuffix(".o")


# A file keeps what was reached, so that processes that a test starts or kills count, too.
CHOICE = """#include <cstdlib>
#include <fcntl.h>
#include <sys/mman.h>
constexpr int kMutants = %d;
static unsigned char not_kept[kMutants];
int hord_mutant = 0;
unsigned char* hord_reached = not_kept;
static const bool ready = [] {
    if (const char* number = std::getenv("HORD_MUTANT")) hord_mutant = std::atoi(number);
    const char* file = std::getenv("HORD_REACHED");
    if (file == nullptr) return false;
    void* kept = mmap(nullptr, kMutants, PROT_READ | PROT_WRITE, MAP_SHARED, open(file, O_RDWR | O_CLOEXEC), 0);
    if (kept == MAP_FAILED) std::abort();
    hord_reached = static_cast<unsigned char*>(kept);
    return true;
}();
"""


def run(command, cpu_s=600, mutant=0, wall_s=3600, **environment):
    def limits():
        resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    return subprocess.run(command, cwd=RELEASE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          errors="replace", preexec_fn=limits, timeout=wall_s,
                          env={**os.environ, **QUICK, "HORD_MUTANT": str(mutant), **environment})


@dataclasses.dataclass
class Test:
    program: str
    name: str
    ms: float
    reached: bytes = b""  # by the mutant's number


class Workshop:
    """Programs with all mutants of a room, and what becomes of each."""

    def __init__(self, name, room, mutants, jobs):
        self.room, self.mutants = room, mutants
        self.folder = OUT / name
        self.folder.mkdir(parents=True, exist_ok=True)
        programs = [t.split()[0] for t in self.room.tests]
        targets = [*programs, *self.room.helpers, *(["mutant-none"] if self.room.soak else [])]
        subprocess.run(["cmake", "--build", str(RELEASE), "-j", str(jobs), "--target", *targets], check=True,
                       stdout=subprocess.DEVNULL)
        for helper in self.room.helpers:  # a program looks for them beside itself
            (self.folder / helper).unlink(missing_ok=True)
            (self.folder / helper).symlink_to(RELEASE / "bin" / helper)
        self.commands = {}
        for entry in json.loads((RELEASE / "compile_commands.json").read_text()):
            self.commands.setdefault(entry["file"], shlex.split(entry["command"]))
        self.built = {}  # when the object of a source was made
        for file, words in self.commands.items():
            made = RELEASE / words[words.index("-o") + 1]
            if made.exists():
                self.built[os.path.relpath(file, ROOT)] = made.stat().st_mtime
        self.fates = {}  # by mutant
        self.numbers = MUTANTS_A_FILE * len(room.files()) + 1
        self.originals, self.precompiled = {}, {}  # machine code by file and folder; the file of a folder's head.h
        self.compile_all(jobs)
        self.tests = []
        for test in self.room.tests:
            name, _, chosen = test.partition(" ")
            self.tests += self.time_tests(self.link(name, self.folder / name), chosen or "*")
        with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
            list(pool.map(self.find_reached, self.tests))
        if self.room.soak:
            self.soak = self.link("mutant-none", self.folder / "soak")

    def compile(self, source, like, out, *flags):
        words = [w for w in self.commands[str(like)] if w not in ("-Werror", "-Winvalid-pch")]
        words = words[next(k for k, w in enumerate(words) if w.endswith("++")):]
        words[words.index("-o") + 1] = str(out)
        words[words.index("-c") + 1] = str(source)
        return run([words[0], "-I", str(self.folder / "mutated"), *words[1:], *flags, "-w"])

    def compile_all(self, jobs):
        """The room's files with their mutants; also files of the room and its tests that include a mutated header."""
        by_file = collections.defaultdict(list)
        for m in self.mutants:
            by_file[m.file].append(m)
        files = self.room.files()
        headers = [f for f in by_file if f.endswith(".h")]
        check = self.folder / "check.cpp"
        for header in headers:
            user = ROOT / next(f for f in files if f.endswith(".cpp"))
            check.write_text(f'#include "{header}"\n')
            out = self.folder / (header.replace("/", "_") + ".o")
            self.settle(header, by_file[header], out, lambda: self.compile(check, user, out, "-fsyntax-only"))
        using = self.objects_that_include(headers)
        changed = {*by_file, *map(source_of, using)}
        with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
            def one(file):
                out = self.folder / (file.replace("/", "_") + ".o")
                here = self.folder / "mutated" / file
                self.settle(file, by_file[file], out, lambda: self.compile(here, ROOT / file, out, "-O1", "-g0"))
                return str(out)

            sources = [f for f in files if f.endswith(".cpp") and f in changed]
            self.objects = dict(zip(sources, pool.map(one, sources)))
            choice = self.folder / "choice.cpp"
            choice.write_text(CHOICE % self.numbers)
            run(["c++", "-c", str(choice), "-o", str(self.folder / "choice.o")])
            self.choice = str(self.folder / "choice.o")

            def test(file):
                out = self.folder / (file.replace("/", "_") + ".o")
                done = self.compile(ROOT / file, ROOT / file, out)
                if done.returncode != 0:
                    sys.exit(f"{file}: {done.stdout[-2000:]}")
                return str(out)

            words = {w for t in self.room.tests for w in self.link_command(t.split()[0])[1]}
            wanted = {w: source_of(w) for w in words & using if source_of(w) not in self.objects}
            self.replaced = dict(zip(wanted, pool.map(test, wanted.values())))

    def objects_that_include(self, headers):
        if not headers:
            return set()
        said = subprocess.run(["ninja", "-t", "deps"], cwd=RELEASE, check=True, capture_output=True, text=True).stdout
        blocks = (block.split("\n") for block in said.split("\n\n"))
        return {lines[0].split(":")[0] for lines in blocks
                if any(os.path.relpath(RELEASE / line.strip(), ROOT) in headers for line in lines[1:])}

    def settle(self, file, mutants, out, compile_it):
        """Unless it was done: writes and compiles the file with its mutants; leaves out those that do not compile."""
        here = self.folder / "mutated" / file
        here.parent.mkdir(parents=True, exist_ok=True)
        kept = here.with_name(here.name + ".invalid")
        known = set(kept.read_text().split()) if kept.exists() else set()
        self.fates.update({m: "invalid" for m in mutants if str(m.number) in known})
        while True:
            text, lines, alone = schema(file, [m for m in mutants if m not in self.fates])
            text = text.replace("#line 1\n", f'#line 1 "{here}"\n')
            for m in alone:
                self.fates[m] = "alone"
            stamps = [self.built.get(file, 0), *(h.stat().st_mtime for h in self.folder.glob("mutated/**/*.h"))]
            if here.exists() and here.read_text() == text:
                if out.exists() and out.stat().st_mtime > max(stamps):
                    return
            elif known:  # of another text
                known.clear()
                self.fates = {m: fate for m, fate in self.fates.items() if m.file != file}
                kept.unlink()
                continue
            else:
                here.write_text(text)
            done = compile_it()
            if done.returncode == 0:
                out.touch()
                kept.write_text(" ".join(str(m.number) for m in mutants if self.fates.get(m) == "invalid"))
                return
            wrong = {int(n) for n in re.findall(re.escape(str(here)) + r":(\d+):\d+: (?:fatal )?error", done.stdout)}
            found = [lines[max(n for n in lines if n <= w)] for w in wrong if any(w - 25 <= n <= w for n in lines)]
            if not found:
                sys.exit(f"{file} does not compile:\n{done.stdout[:3000]}")
            for m in found:
                self.fates[m] = "invalid"

    def link_command(self, target):
        said = subprocess.run(["ninja", "-t", "commands", target], cwd=RELEASE, check=True, capture_output=True,
                              text=True)
        words = shlex.split(said.stdout.strip().splitlines()[-1])
        words = words[words.index("&&") + 1:]
        words = words[:words.index("&&")]
        at = words.index("-o")
        del words[at:at + 2]
        first = next(k for k, w in enumerate(words) if w.endswith((".o", ".a")))
        return words[:first], words[first:]

    def link(self, target, out):
        head, tail = self.link_command(target)
        # A program that does not use a source's folder may not have what the source uses.
        linked = {os.path.dirname(w) for w in tail}
        objects = [self.choice] + [o for source, o in self.objects.items() if os.path.dirname(source) in linked]
        tail = [self.replaced.get(w, w) for w in tail]
        done = run([*head, "-fuse-ld=gold", "-Wl,--allow-multiple-definition", *objects, *tail, "-o", str(out)])
        if done.returncode != 0:
            sys.exit(f"{target}: {done.stdout[-3000:]}")
        return str(out)

    def time_tests(self, program, chosen):
        report = self.folder / "times.json"
        done = run([program, f"--gtest_output=json:{report}", "--gtest_filter=" + chosen])
        if done.returncode != 0:
            sys.exit(f"{program} fails without a mutant:\n{done.stdout[-2000:]}")
        suites = json.loads(report.read_text())["testsuites"]
        return [Test(program, f"{s['name']}.{t['name']}", float(t["time"].rstrip("s")) * 1000)
                for s in suites for t in s["testsuite"] if t["result"] == "COMPLETED"]

    def find_reached(self, test):
        kept = self.folder / f"reached-{threading.get_ident()}"
        kept.write_bytes(bytes(self.numbers))
        run([test.program, "--gtest_filter=" + test.name], HORD_REACHED=str(kept))
        test.reached = kept.read_bytes()

    def fails(self, mutant, *command, normal_s):
        """Fails, or takes far longer than normal. A mutant whose threads wait for ever uses no processor."""
        try:
            return run(command, 2 + int(4 * normal_s), mutant.number, 20 + 10 * normal_s).returncode != 0
        except subprocess.TimeoutExpired:
            return True

    def tests_fail(self, mutant):
        fast_first = lambda t: (t.ms > FAST_TEST_MS, t.program)
        reaching = sorted((t for t in self.tests if t.reached[mutant.number]), key=fast_first)
        for _, group in itertools.groupby(reaching, key=fast_first):
            group = list(group)
            command = (group[0].program, "--gtest_fail_fast", "--gtest_brief=1",
                       "--gtest_filter=" + ":".join(t.name for t in group))
            normal_s = sum(t.ms for t in group) / 1000
            if all(self.fails(mutant, *command, normal_s=normal_s) for _ in range(2 if self.room.real_time else 1)):
                return True
        return False

    def judge(self, mutant):
        """invalid (does not compile), alone (not tried), killed by tests or soak, same code, survived."""
        if mutant in self.fates:
            return self.fates[mutant]
        if self.tests_fail(mutant):
            return "tests"
        if self.room.soak:
            for seed in SOAK_SEEDS:
                if self.fails(mutant, self.soak, "--parts", str(SOAK_PARTS), "--seed", str(seed), normal_s=5):
                    return "soak"
        return "same code" if self.same_code(mutant) else "survived"

    def same_code(self, mutant):
        """Whether the optimised machine code is that of the original. The includes are compiled once a file."""
        if mutant.file.endswith(".h"):
            return False
        folder = self.folder / f"same-{threading.get_ident()}"
        original = (ROOT / mutant.file).read_text()
        head = max((m.end() for m in re.finditer(r"^#include .*\n", original, flags=re.M)), default=0)
        folder.mkdir(exist_ok=True)

        def machine_code(text):
            (folder / "one.cpp").write_text('#include "head.h"\n' + text[head:])
            self.compile(folder / "one.cpp", ROOT / mutant.file, folder / "one.o", "-O2", "-g0")
            run(["strip", "--strip-unneeded", str(folder / "one.o")])
            return (folder / "one.o").read_bytes()

        place = (mutant.file, folder)
        if self.precompiled.get(folder) != mutant.file:
            (folder / "head.h").write_text(original[:head])
            self.compile(folder / "head.h", ROOT / mutant.file, folder / "head.h.gch", "-O2", "-g0")
            self.precompiled[folder] = mutant.file
            self.originals[place] = machine_code(original)
        text = original[:mutant.begin] + mutant.text + original[mutant.end:]
        return machine_code(text) == self.originals[place]
