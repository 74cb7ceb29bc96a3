#!/usr/bin/env python3
"""Mutation testing of one room: changes one place of its sources at a time and runs its tests on the result.

    ./dev mutants ROOM [--sample N] [--seed S] [--minutes M] [--skip K] [--survivors] [--list] [--jobs N]

Each mutant is one changed place: a deleted statement, another relational, arithmetic or logical operator, another
constant, a negated condition, a dropped member of max, min or clamp. All mutants of a file are compiled at once, each
beside the original text and chosen when the program runs, and kept in build/mutants for the next run; what cannot be
written so is not tried. Each unit test runs once by itself and tells which mutants it reaches; a mutant then runs with
these tests alone, fast ones first. It is killed when one of them fails, crashes or takes too long. A survivor of the
unit tests runs in the soak, if the room is part of the soaked station. Not counted is a mutant that does not compile, one whose optimised machine code
is that of the original, and one that equivalent.txt lists with its reason. build/mutants/ROOM.survivors keeps the
survivors; --survivors runs these alone.

Exit status: 0 the room's goal is reached, 1 it is not, 2 it could not run.
"""

import argparse
import concurrent.futures
import dataclasses
import pathlib
import random
import sys
import time

from mutations import ROOT, mutants_of
from workshop import MUTANTS_A_FILE, OUT, Workshop

EQUIVALENT = pathlib.Path(__file__).with_name("equivalent.txt")


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
