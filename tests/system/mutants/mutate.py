#!/usr/bin/env python3
"""Mutation testing of one room: changes one place of its sources at a time and runs its tests on the result.

    ./dev mutants ROOM [--sample N] [--seed S] [--minutes M] [--skip K] [--survivors] [--list] [--jobs N]

Each mutant is one changed place: a deleted statement, another relational, arithmetic or logical operator, another
constant, a negated condition, a dropped member of max, min or clamp. All mutants of a file are compiled at once, each
beside the original text and chosen when the program runs, and kept in build/mutants for the next run; what cannot be
written so is not tried. Each unit test runs
once by itself and tells which mutants it reaches; a mutant then runs with these tests alone, fast ones first. It is
killed when one of them fails, crashes or takes too long. A survivor of the unit tests runs in the soak, if
the room is part of the soaked station. Not counted is a mutant that does not compile, one whose optimised machine code
is that of the original, and one that equivalent.txt lists with its reason. build/mutants/ROOM.survivors keeps the
survivors; --survivors runs these alone.

Exit status: 0 the room's goal is reached, 1 it is not, 2 it could not run.
"""

import argparse
import collections
import concurrent.futures
import dataclasses
import itertools
import json
import os
import pathlib
import random
import re
import resource
import shlex
import subprocess
import sys
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[3]
RELEASE = ROOT / "build/release"
OUT = ROOT / "build/mutants"
EQUIVALENT = pathlib.Path(__file__).with_name("equivalent.txt")
SOAK_SEEDS, SOAK_PARTS = (1, 2), 10000
FAST_TEST_MS = 30  # tests up to this time run first
MUTANTS_A_FILE = 2000  # more than any file has
# The store's tests on no disk, with a tenth of their crashes, flipped bits and damaged values.
QUICK = {"HORD_CRASHES": "15", "HORD_FLIPS": "40", "HORD_EDITS": "10",
         **({"TMPDIR": "/dev/shm"} if os.access("/dev/shm", os.W_OK) else {})}


@dataclasses.dataclass(frozen=True)
class Room:
    sources: tuple  # glob patterns
    tests: tuple  # test programs; one may be followed by a space and a filter of its tests
    goal: int  # per cent killed
    soak: bool = False
    helpers: tuple = ()  # programs that the tests start
    real_time: bool = False  # a test may fail on a machine that is held up: a mutant must fail twice

    def files(self):
        return sorted({str(p.relative_to(ROOT)) for g in self.sources for p in ROOT.glob(g)})


ROOMS = {
    "core": Room(("firmware/core/*.cpp", "firmware/core/core.h", "firmware/core/conveyor.h", "firmware/core/line.h",
                  "firmware/core/states.h", "firmware/core/actions.h"), ("test_firmware_core",), 95, True),
    "station": Room(("firmware/station/*.cpp",), ("test_firmware_station",), 85, True),
    "plc": Room(("firmware/plc/*.cpp",), ("test_firmware_plc",), 85, True),
    # Not register_rows.h: a mutant is chosen at run time, and the rows are constants of the compiler. The client is
    # tested against the server of modbus.
    "registers": Room(("firmware/registers/register_*.cpp",),
                      ("test_firmware_registers", "test_firmware_plc", "test_firmware_modbus"), 85),
    "modbus": Room(("firmware/modbus/*.cpp",), ("test_firmware_modbus",), 85),
    "store": Room(("firmware/store/*/*.cpp", "firmware/store/results/clock_days.h"),
                  ("test_firmware_store_results", "test_firmware_store_frames", "test_firmware_store_recorder"), 85),
    "drivers": Room(("drivers/gpio/edge_filter.cpp", "drivers/hal/camera_sensor.cpp", "drivers/hal/seam.cpp",
                     "drivers/hal/reject_ledger.h", "drivers/modbus/*.cpp"),
                    ("test_drivers_hal", "test_drivers_gpio", "test_drivers_modbus", "test_drivers_camera_process",
                     "test_contract *Rejector*"), 85,
                    real_time=True),
    "light": Room(("algo/light/*.cpp", "algo/light/*.h"), ("test_algo_light", "test_algo_inspection"), 85),
    "inspection": Room(("algo/inspection/*.cpp",), ("test_algo_inspection",), 85),
}


# -- mutants of a text


@dataclasses.dataclass(frozen=True)
class Mutant:
    file: str  # below ROOT
    line: int
    begin: int  # characters that `text` replaces
    end: int
    text: str
    operator: str
    before: str  # the lines that change, white space collapsed
    after: str
    number: int = 0  # when it runs

    @property
    def key(self):
        return f"{self.file}\n  {self.before}\n  {self.after}"


COMMENT_OR_STRING = r"//[^\n]*|/\*.*?\*/|\"(?:\\.|[^\"\\\n])*\"|(?<!\w)'(?:\\.|[^'\\\n])+'"


def masked(text):
    """The text with comments, strings, preprocessor lines and static_asserts blanked, of the same length."""
    blank = lambda m: re.sub(r"[^\n]", " ", m.group())
    text = re.sub(COMMENT_OR_STRING, blank, text, flags=re.S)
    text = re.sub(r"^[ \t]*#[^\n]*", blank, text, flags=re.M)
    return re.sub(r"\bstatic_assert\(.*?\);", blank, text, flags=re.S)


def closing(code, at):
    """Index of the bracket that closes the one at `at`."""
    depth = 0
    for k in range(at, len(code)):
        depth += code[k] in "([{"
        depth -= code[k] in ")]}"
        if depth == 0:
            return k
    return len(code) - 1


def members(code, begin, end):
    """The ranges between the commas of an argument list."""
    found, depth, start = [], 0, begin
    for k in range(begin, end):
        depth += code[k] in "([{"
        depth -= code[k] in ")]}"
        if code[k] == "," and depth == 0:
            found.append((start, k))
            start = k + 1
    return found + [(start, end)]


SWAPS = {
    "relational": {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="},
    "arithmetic": {"+": "-", "-": "+", "*": "/", "/": "*", "%": "*", "+=": "-=", "-=": "+="},
    "logical": {"&&": "||", "||": "&&", "&": "|", "|": "&", "<<": ">>", ">>": "<<", "|=": "&=", "&=": "|="},
}
DECLARATION = re.compile(r"(?:[^;=]*= default;|"
                         r"(?:const|static|constexpr|inline|explicit|virtual|friend|using|typedef|struct|class|enum|"
                         r"template|namespace|public|private|protected|goto|case|default|delete|throw)\b|"
                         r"\[\[|~|std::function<|"
                         r"[\w:]+<[^;=]*> \w+;|"
                         r"return\s*[^;\s]|(?!return\b|continue\b|break\b|else\b|co_)[\w:<>,*& ]+[\w>&*] [&*]?\w+\s*"
                         r"(?:=|;|\{|\(|,|:|$)|"
                         r"\w+\((?:const )?(?!new\b|const\b)[\w:<>]+[&*]? \w+[,)])")  # last: a constructor


def for_headers(code):
    return [(m.end() - 1, closing(code, m.end() - 1)) for m in re.finditer(r"\bfor \(", code)]


def statements(code, all_of_them=False):
    """The range of every simple statement, without its semicolon and without the if, else or for before it.

    Without all_of_them those after an if without else are left out: in another mutant this if is never true."""
    brackets, start = [], 0  # a bracket is True if it is the brace of a block
    for k, c in enumerate(code):
        block = True
        if c in "([":
            brackets.append(False)
        elif c == "{":
            opens = code[k - 1].isspace() and not re.search(r"(?:[=(,?:]|\breturn)\s*$", code[max(0, k - 90):k])
            brackets.append(opens and all(brackets))
        elif c in ")]}" and brackets:
            block = brackets.pop()
        elif c != ";":
            continue
        if not all(brackets) or c not in "{};" or not block:
            continue
        if c == ";":
            begin, alone = start, False
            while head := re.match(r"\s*(?:else\b|case [\w:]+:(?!:)|default:|(?:if|for|while) (?:constexpr )?\()",
                                   code[begin:k]):
                begin += head.end()
                alone = head.group().lstrip().startswith("if") and not code[k + 1:].lstrip().startswith("else")
                if head.group().endswith("("):
                    begin = closing(code, begin - 1) + 1
            begin += len(code[begin:k]) - len(code[begin:k].lstrip())
            if not alone or all_of_them:
                yield begin, begin + len(code[begin:k].rstrip())
        start = k + 1


def mutations(code):
    """(begin, end, text, operator) of every mutant of a masked text."""
    headers = for_headers(code)
    in_header = lambda at: any(b < at < e for b, e in headers)
    for kind, swaps in SWAPS.items():
        for m in re.finditer(r"(?<=\s)(<<|>>|<=|>=|==|!=|&&|\|\||\+=|-=|\|=|&=|[<>+\-*/%&|])(?=\s)", code):
            if m.group() in swaps:
                yield m.start(), m.end(), swaps[m.group()], kind
    for m in re.finditer(r"\+\+(?=[\w(])|--(?=[\w(])|(?<=\w)\+\+|(?<=\w)--", code):
        if not in_header(m.start()):
            yield m.start(), m.end(), "--" if m.group() == "++" else "++", "arithmetic"
    for m in re.finditer(r"(?<![\w.'])(?:0x[0-9A-Fa-f]+|\d+)(?=[uUlLzZ]*\b)(?![.'eE\d])", code):
        value = int(m.group(), 16 if m.group().startswith("0x") else 8 if m.group().startswith("0") else 10)
        for other in (value + 1, 0) if value == 1 else (value + 1,):
            yield m.start(), m.end(), str(other), "constant"
    for m in re.finditer(r"\b(true|false)\b", code):
        yield m.start(), m.end(), "false" if m.group() == "true" else "true", "constant"
    for m in re.finditer(r"\b(if|while) (?:constexpr )?\(", code):
        begin = m.end()
        end = closing(code, begin - 1)
        condition = code[begin:end]
        if re.match(r"[^()]*[^=!<>]=[^=]", condition) or ";" in condition:
            continue  # declares a variable
        same = re.fullmatch(r"!?[\w.:>()-]+(?<! -)(?: [!=]= [\w.:>()-]+)?", condition) and re.search(r"!|==", condition)
        if not same:  # as another mutant
            yield begin, begin, "!(", "negated condition:" + str(end)
        yield begin, begin, "false && (", "condition never true:" + str(end)
    for m in re.finditer(r"(?<=\s)\?(?=\s)", code):
        begin, depth = m.start(), 0
        while begin > 0:
            c = code[begin - 1]
            depth += c in ")]}"
            depth -= c in "([{"
            before = r"(?:\breturn|[^=!<>]=|\s:)\s$"
            if depth < 0 or (depth == 0 and (c in ";,?" or re.search(before, code[:begin][-8:]))):
                break
            begin -= 1
        while code[begin].isspace():
            begin += 1
        yield begin, begin, "!(", "negated condition:" + str(m.start())
    for m in re.finditer(r"(?<![\w)!])!(?=[\w(])", code):
        yield m.start(), m.end(), "", "negated condition"
    for m in re.finditer(r"\bstd::(max|min|clamp)(?:<[\w: ]+>)?\(", code):
        end = closing(code, m.end() - 1)
        parts = members(code, m.end(), end)
        if len(parts) < 2:
            continue
        for b, e in parts if m.group(1) != "clamp" else parts[:1]:
            yield m.start(), end + 1, f"<{b}:{e}>", "dropped member"
    for begin, end in statements(code):
        if end > begin and not DECLARATION.match(code[begin:end] + ";"):
            yield begin, end, "", "deleted statement"


def units(code):
    """Texts beside which a mutant can be compiled: (begin, end, form, rest); form and rest have a {} for each text."""
    condition, statement = "HORD_MUTANT({k}) ? bool({new}) : {rest}", "if (HORD_MUTANT({k})) {{ {new}; }} else {rest}"
    choice = "HORD_MUTANT({k}) ? ({new}) : {rest}"
    for m in re.finditer(r"\b(?:if|while) \(", code):
        end = closing(code, m.end() - 1)
        if ";" not in code[m.end():end] and not re.match(r"[^()]*[^=!<>]=[^=]", code[m.end():end]):
            yield m.end(), end, condition, "bool({})"
    for begin, end in for_headers(code):
        parts = code[begin + 1:end].split(";")
        if len(parts) == 3 and "=" in parts[0]:
            middle = begin + 1 + len(parts[0]) + 1
            yield begin + 1 + parts[0].rindex("=") + 1, middle - 1, choice, "({})"
            yield middle, middle + len(parts[1]), condition, "bool({})"
    for begin, end in statements(code, True):
        text = code[begin:end]
        if value := re.match(r"return\s+(?!\{)", text) or (DECLARATION.match(text + ";") and
                                                          re.match(r"[^()={}]*[^=!<>({]=\s(?!\{)", text)):
            yield begin + value.end(), end, choice, "({})"
        elif not DECLARATION.match(text + ";"):
            yield begin, end + 1, statement, "{{ {}; }}"


SCHEMA_HEAD = """extern int hord_mutant;
extern unsigned char* hord_reached;
#define HORD_MUTANT(k) (hord_reached[k] = 1, hord_mutant == (k))
#line 1
"""


def schema(file, mutants):
    """The file's text with these mutants beside the original; the lines of each; those that cannot be written so."""
    text = (ROOT / file).read_text()
    code = masked(text)
    # Without comments: one would end the line of a mutant.
    blank = lambda m: m.group() if m.group()[0] in "\"'" else re.sub(r"[^\n]", " ", m.group())
    plain = re.sub(COMMENT_OR_STRING, blank, text, flags=re.S)
    found = sorted(set(units(code)))
    of_unit, alone = collections.defaultdict(list), []
    for m in mutants:
        of = [u for u in found if u[0] <= m.begin and m.end <= u[1] and not (m.begin == m.end == u[1])]
        of_unit[min(of, key=lambda u: u[1] - u[0])].append(m) if of else alone.append(m)
    out, at, lines = SCHEMA_HEAD, 0, {}
    for (begin, end, form, rest), members_ in sorted(of_unit.items()):
        if begin < at:
            alone += members_
            continue
        out += plain[at:begin]
        semicolon = end if rest[0] != "{" else end - 1
        new = "\n"
        for m in members_:
            changed = (plain[begin:m.begin] + m.text + plain[m.end:semicolon]).replace("\n", " ")
            head, tail = form.split("{rest}")[0].format(k=m.number, new=changed), ""
            lines[(out + new).count("\n") - SCHEMA_HEAD.count("\n") + 1] = m
            new += head + "\n"
        new += rest.format(plain[begin:semicolon].replace("\n", " ")) + "\n"
        out += "{" + new + "}" if rest[0] == "{" else "(" + new + ")"
        at = end
    return out + plain[at:], lines, alone


def mutants_of(file):
    text = (ROOT / file).read_text()
    code = masked(text)
    seen = {}
    for begin, end, new, operator in mutations(code):
        if ":" in operator:  # closes a bracket, too
            operator, close = operator.split(":")
            end, new = int(close), new + text[begin:int(close)].rstrip() + ") "
        if member := re.fullmatch(r"<(\d+):(\d+)>", new):
            new = "(" + text[int(member[1]):int(member[2])].strip() + ")"
        first, last = text.rfind("\n", 0, begin) + 1, text.find("\n", end)
        flat = lambda s: re.sub(r"\s+", " ", s).strip()
        before, after = flat(text[first:last]), flat(text[first:begin] + new + text[end:last])
        if before == after or after in ("};",):
            continue
        count = seen[(before, after)] = seen.get((before, after), 0) + 1
        if count > 1:
            after += f"  // {count}"
        yield Mutant(file, text.count("\n", 0, begin) + 1, begin, end, new, operator, before, after)


# -- compiling and running


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


def equivalents():
    """The listed mutants: file, before, after; a fourth line gives the reason."""
    found = {}
    blocks = EQUIVALENT.read_text().split("\n\n") if EQUIVALENT.exists() else []
    for block in blocks:
        lines = [line for line in block.splitlines() if not line.startswith("#")]
        if len(lines) >= 4:
            found["\n".join(lines[:3])] = " ".join(line.strip() for line in lines[3:])
    return found


def main():
    parser = argparse.ArgumentParser(prog="./dev mutants", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("room", choices=sorted(ROOMS))
    parser.add_argument("--sample", type=int, help="so many of the room's mutants, chosen by --seed; default: all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, help="begin no mutant later than this; they run in an order drawn by "
                        "--seed, and the score is of those that ran")
    parser.add_argument("--skip", type=int, default=0, help="with --minutes: so many of that order ran before")
    parser.add_argument("--survivors", action="store_true", help="only those that survived the last run")
    parser.add_argument("--unit-tests-only", action="store_true", help="no soak")
    parser.add_argument("--list", action="store_true", help="print the mutants and run none")
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()

    room = ROOMS[arguments.room]
    if arguments.unit_tests_only:
        room = dataclasses.replace(room, soak=False)
    listed = equivalents()
    files = room.files()
    everything = mutants = [dataclasses.replace(m, number=MUTANTS_A_FILE * k + n)
                            for k, f in enumerate(files) for n, m in enumerate(mutants_of(f), 1)]
    known = [m for m in mutants if m.key in listed]
    stale = [k for k in listed if k.split("\n")[0] in files and k not in {m.key for m in mutants}]
    mutants = [m for m in mutants if m.key not in listed]
    survivors = OUT / f"{arguments.room}.survivors"
    if arguments.survivors:
        wanted = set(survivors.read_text().split("\n\n"))
        mutants = [m for m in mutants if m.key in wanted]
    elif arguments.sample and arguments.sample < len(mutants):
        mutants = sorted(random.Random(arguments.seed).sample(mutants, arguments.sample),
                         key=lambda m: (m.file, m.begin))
    if arguments.list:
        for m in mutants:
            print(f"{m.file}:{m.line} {m.operator}\n  {m.before}\n  {m.after}")
        return 0

    began, fates = time.monotonic(), {}
    workshop = Workshop(arguments.room, room, everything, arguments.jobs)
    print(f"{len(mutants)} mutants, compiled after {time.monotonic() - began:.0f} s", flush=True)
    if arguments.minutes:
        random.Random(arguments.seed).shuffle(mutants)
        mutants = mutants[arguments.skip:]

    def judge(mutant):
        late = arguments.minutes and time.monotonic() - began > 60 * arguments.minutes
        return "not run" if late else workshop.judge(mutant)

    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        for m, fate in zip(mutants, pool.map(judge, mutants)):
            fates.setdefault(fate, []).append(m)
            if fate == "survived":
                print(f"SURVIVED {m.file}:{m.line} {m.operator}\n  {m.before}\n  {m.after}", flush=True)
    count = {fate: len(of) for fate, of in fates.items()}
    survivors.write_text("\n\n".join(m.key for m in fates.get("survived", [])))
    killed = count.get("tests", 0) + count.get("soak", 0)
    counted = killed + count.get("survived", 0)
    share = 100 * killed / max(counted, 1)
    print(f"{arguments.room}: {len(mutants)} mutants in {time.monotonic() - began:.0f} s; {killed} of {counted} killed "
          f"({share:.1f} %, goal {room.goal} %): "
          f"{count.get('tests', 0)} by unit tests, {count.get('soak', 0)} by the soak; "
          f"{count.get('survived', 0)} survived; not counted: {count.get('invalid', 0)} that do not compile, "
          f"{count.get('same code', 0)} with the same machine code, {len(known)} listed as equivalent; "
          f"not tried: {count.get('alone', 0)} that are not in a function's statement, "
          f"{count.get('not run', 0)} for lack of time")
    for key in stale:
        print(f"equivalent.txt lists a mutant that there is no more:\n{key}")
    return 0 if share >= room.goal and not stale else 1


if __name__ == "__main__":
    sys.exit(main())
