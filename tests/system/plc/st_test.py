#!/usr/bin/env python3
"""The interpreter refuses what compilers refuse; the library of deploy/plc against a station's registers in memory, in
virtual time."""
import random
import unittest

import plc
import st


def run(body, declarations="", cycles=1):
    library = st.Library(clock=lambda: 0)
    library.add(f"PROGRAM P VAR {declarations} END_VAR {body} END_PROGRAM", "test")
    program = library.instance("P")
    for _ in range(cycles):
        library.run(program)
    return program.memory


class Interpreter(unittest.TestCase):
    def test_computes_as_the_standard_says(self):
        memory = run("a := 7 - 2 - 1; b := 2 + 3 * 4; c := (7 MOD 4) * 10 / 4; d := NOT (1 = 2) AND 3 > 2; e := h AND 16#00FF; "
                     "CASE a OF 1, 4: f := 5; ELSE f := 6; END_CASE; FOR k := 1 TO 3 DO s[k] := k; END_FOR; g := s[1] + s[2] + s[3];",
                     "a : UINT; b : UINT; c : UINT; d : BOOL; e : WORD; f : UINT; g : UINT; k : UINT; s : ARRAY[1..3] OF UINT; h : WORD := 16#F0F0;")
        self.assertEqual([memory[x] for x in "abcdefg"], [4, 14, 7, True, 0xF0, 5, 6])

    def test_copies_structures(self):
        library = st.Library()
        library.add("TYPE T : STRUCT x : UINT; END_STRUCT; END_TYPE PROGRAM P VAR a : T; b : T; END_VAR b := a; a.x := 1; END_PROGRAM", "t")
        program = library.instance("P")
        library.run(program)
        self.assertEqual((program.memory["a"]["x"], program.memory["b"]["x"]), (1, 0))

    def test_refuses_what_some_compiler_refuses(self):
        for body, declarations in [
            ("a := b;", "a : UINT; b : WORD;"),                      # no silent conversion
            ("a := b + c;", "a : UDINT; b : UDINT; c : UINT;"),
            ("IF a THEN a := 1; END_IF;", "a : UINT;"),
            ("a := TRUE + 1;", "a : UINT;"),
            ("a := 16#1 < 16#2;", "a : WORD;"),
            ("c := c + 1;", "a : UINT;"),                            # not declared
            ("a := 1", "a : UINT;"),                                 # no ;
            ("c := 2;", "a : UINT; END_VAR VAR CONSTANT c : UINT := 1;"),
            ("FOR k := 0 TO 3 DO k := 2; END_FOR;", "k : UINT;"),
            ("Step := 1;", "Step : UINT;".upper()),                  # STEP is a keyword
            ("t(IN := TRUE, XX := T#1s);", "t : TON;"),
            ("t.Q := TRUE;", "t : TON;"),
        ]:
            with self.subTest(body), self.assertRaises(st.StError):
                run(body, declarations)

    def test_stops_at_what_would_differ_between_plcs(self):
        for body, declarations in [
            ("a := a - 1;", "a : UINT;"),
            ("a := 65535; a := a + 1;", "a : UINT;"),
            ("a := 4; b := s[a];", "a : UINT; b : UINT; s : ARRAY[0..3] OF UINT;"),
            ("a := UDINT_TO_UINT(b);", "a : UINT; b : UDINT := 65536;"),
            ("a := 1 / b;", "a : UINT; b : UINT;"),
            ("FOR k := 0 TO 3 DO a := k; END_FOR; a := k;", "k : UINT; a : UINT;"),
            ("WHILE TRUE DO a := 1; END_WHILE;", "a : UINT;"),
        ]:
            with self.subTest(body), self.assertRaises(st.StError):
                run(body, declarations)


class Registers:
    """A station's registers in memory, as docs/plc.md describes them."""

    def __init__(self):
        self.boot, self.results, self.acknowledged, self.stored = 0x10002, [], 0, 1 << 30
        self.beat, self.uptime, self.token, self.reply, self.done = 0, 100, 0, (0, 0, 0), {}
        self.magic, self.version, self.disk_full, self.may_write, self.answers = (0x484F, 0x5244), 5, False, True, True
        self.executing_for, self.writes, self.executed = 0, [], []
        self.bits, self.torn, self.foreign = 2, 0, False
        self.overruns, self.counted = 0, None  # counted up to this result; None: nothing was acknowledged yet

    def add(self, count):
        for _ in range(count):
            self.results.append(len(self.results) + 1)
            gone = len(self.results) - 256
            if self.counted is not None and gone > max(self.counted, self.acknowledged):
                self.overruns += gone - max(self.counted, self.acknowledged)
                self.counted = gone

    def words(self, address, count):
        def pair(value):
            return [value >> 16, value & 0xFFFF]
        if address == 0:
            return [1, 98, *self.magic, self.version, 0, 0, *pair(self.boot), 0, 0, 0][:count]
        if address == 100:
            self.beat = (self.beat + 1) % 65536
            last = len(self.results)
            oldest = max(last - 255, 1) if last else 0
            return ([2, 38, 8, self.bits, self.beat, 0] + pair(last) + pair(oldest) + [1, 0, 0] + [0] * 8 + pair(self.boot) + [0xFFFF] * 17)[:count]
        if address == 8103:
            return pair(self.acknowledged)
        if address == 8402:
            return pair(self.uptime)
        if address == 8022:
            if self.executing_for:
                self.executing_for -= 1
            elif self.reply[1] == 1:
                self.reply = (self.reply[0], 2, 0)
            if self.foreign:  # another master has written since
                return pair(self.token + 999) + [5, 2, 0, 0, 0]
            return pair(self.token) + [self.reply[0], self.reply[1], self.reply[2], 0, 77]
        assert 1000 <= address and address + count <= 1000 + 256 * 24, address
        out = []
        for slot in range((address - 1000) // 24, (address - 1000 + count) // 24):
            numbers = [s for s in self.results if s % 256 == slot]
            sequence = numbers[-1] if numbers else 0
            part = sequence + 1 if sequence % 3 == 1 else sequence - 1 if sequence % 3 == 2 else sequence  # 2 1 3 5 4 6 ...
            part = 4242 if sequence == self.torn else part
            out += pair(sequence) + pair(part) + [0] * 4 + [1, 0, 0] + [0, 500] + [0] * 9 + pair(sequence + 256 * (sequence == self.torn))
        self.torn = 0
        return out

    def write(self, address, words):
        self.writes.append((address, list(words)))
        if not self.may_write:
            raise plc.Refused(1)
        if address == 8102 and len(words) > 1:
            if self.counted is None:
                self.counted = max(len(self.results) - 256, 0)
            taken = words[1] << 16 | words[2]
            if taken < self.acknowledged or taken > len(self.results):
                raise plc.Refused(3)
            if taken > self.acknowledged and self.disk_full:
                raise plc.Refused(4)
            if taken > self.stored:
                raise plc.Refused(6)
            self.acknowledged = taken
        elif address != 8102:
            assert address == 8002 and len(words) == 8
            token, boot, code = words[0] << 16 | words[1], words[2], words[3]
            if token not in self.done:
                self.done[token] = code
                self.executed.append(code)
                self.reply = (code, 1 if self.executing_for else 2, 0) if boot == self.boot & 0xFFFF else (code, 3, 7)
            self.token, self.foreign = token, False


class MemoryPlc(plc.Plc):
    """10 ms a cycle, in virtual time. `lose`: an answer is lost after the station has executed its request."""

    def __init__(self, registers, kept=None, lose=None):
        super().__init__(0, kept, lose)
        self.registers, self.now = registers, 0.0
        self.library.clock = lambda: self.now
        self.wire = self

    def read(self, address, count, lost):
        return self.answer(lambda: self.registers.words(address, count), lost)

    def write(self, address, words, lost):
        return self.answer(lambda: self.registers.write(address, words), lost)

    def answer(self, execute, lost):
        if not self.registers.answers:
            raise plc.NoAnswer("nobody")
        words = execute()
        if lost:
            raise plc.NoAnswer("lost")
        return words

    def cycles(self, count):
        for _ in range(count):
            self.cycle()

    def cycle(self):
        self.now += 0.01
        self.library.run(self.line)
        self.results += [dict(r) for r in self.station["Results"][:self.station["ResultCount"]]]

    def until(self, condition, seconds=60):
        end = self.now + seconds
        while not condition():
            assert self.now < end, self.outputs()
            self.cycle()

    def sequences(self):
        return [r["Sequence"] for r in self.results]


class Block(unittest.TestCase):
    def test_takes_every_result_once_and_acknowledges_it(self):
        registers = Registers()
        registers.add(600)  # the first 344 were overwritten before the PLC came
        line = MemoryPlc(registers)
        line.until(lambda: registers.acknowledged == 600)
        self.assertEqual(line.sequences(), list(range(345, 601)))
        self.assertEqual(line.station["ResultsLost"], 344)
        registers.add(3)
        line.until(lambda: registers.acknowledged == 603)
        self.assertEqual(line.sequences()[-3:], [601, 602, 603])
        self.assertTrue(line.line.memory["Conveyor"])

    def test_results_that_are_overwritten_behind_the_plc_s_back_are_no_overruns(self):
        for poll, phase in [(20, 9), (20, 11), (20, 13), (20, 15), (100, 0), (100, 10)]:
            registers = Registers()
            registers.add(600)  # the PLC comes when the ring is full
            line = MemoryPlc(registers)
            line.station["PollInterval"] = poll
            for cycle in range(100):
                line.cycle()
                if cycle % 25 == phase:
                    registers.add(1)  # 4 parts/s
            line.until(lambda: registers.acknowledged == len(registers.results))
            self.assertEqual(line.station["ResultsLost"] + len(line.results), len(registers.results), (poll, phase))
            self.assertEqual(registers.overruns, 0, (poll, phase))

    def test_an_acknowledgement_that_was_busy_is_repeated_before_a_newer_one(self):
        registers = Registers()
        registers.add(5)
        registers.stored = 0
        line = MemoryPlc(registers)
        line.cycles(100)
        asked = [words[2] for address, words in registers.writes if words[2]]
        self.assertGreater(len(asked), 3)
        registers.add(5)
        line.cycles(100)
        self.assertEqual({words[2] for address, words in registers.writes if words[2]}, {asked[0]})  # the line runs, the same number
        self.assertEqual(line.sequences(), list(range(1, 11)))
        registers.stored = 10
        line.until(lambda: line.station["Acknowledged"] == 10)
        self.assertFalse(line.station["StoreFault"])

    def test_a_full_disk_is_told_and_results_are_not_acknowledged(self):
        registers = Registers()
        registers.add(5)
        registers.disk_full = True
        line = MemoryPlc(registers)
        line.until(lambda: line.station["StoreFault"])
        self.assertTrue(line.line.memory["Alarm"])
        self.assertEqual(line.station["Acknowledged"], 0)
        registers.disk_full = False
        line.until(lambda: line.station["Acknowledged"] == 5)
        self.assertFalse(line.station["StoreFault"])

    def test_a_plc_that_forgot_everything_goes_on_behind_what_it_acknowledged(self):
        registers = Registers()
        registers.add(10)
        first = MemoryPlc(registers)
        first.until(lambda: registers.acknowledged == 10)
        registers.add(4)
        cold = MemoryPlc(registers)
        cold.until(lambda: registers.acknowledged == 14)
        self.assertEqual(cold.sequences(), [11, 12, 13, 14])

    def test_a_plc_that_remembers_takes_none_twice(self):
        registers = Registers()
        registers.add(10)
        registers.disk_full = True  # taken, never acknowledged
        first = MemoryPlc(registers)
        first.until(lambda: len(first.results) == 10)
        registers.disk_full = False
        registers.add(2)
        warm = MemoryPlc(registers, kept=first)
        warm.until(lambda: registers.acknowledged == 12)
        self.assertEqual(warm.sequences(), [11, 12])

    def test_a_restarted_station_begins_at_one_again(self):
        registers = Registers()
        registers.add(10)
        line = MemoryPlc(registers)
        line.until(lambda: registers.acknowledged == 10)
        registers.boot, registers.results, registers.acknowledged = 0x20009, [], 0
        registers.add(12)
        line.until(lambda: registers.acknowledged == 12)
        self.assertEqual(line.sequences(), [*range(1, 11), *range(1, 13)])
        self.assertEqual(line.station["ResultsLost"], 0)

    def test_results_are_given_in_the_order_of_parts(self):
        registers = Registers()
        registers.add(90)
        line = MemoryPlc(registers)
        line.until(lambda: registers.acknowledged == 90)
        self.assertNotEqual([r["Part"] for r in line.results], list(range(1, 91)))
        self.assertEqual([r["Part"] for r in line.in_order], list(range(1, 91)))

    def test_the_order_goes_on_after_a_loss_and_after_a_restart(self):
        registers = Registers()
        registers.add(301)  # 45 are lost; of part 302, only its place in the order is known
        line = MemoryPlc(registers)
        line.until(lambda: registers.acknowledged == 301)
        parts = [r["Part"] for r in line.in_order]
        self.assertEqual(parts, sorted(parts))
        registers.boot, registers.results, registers.acknowledged = 0x30001, [], 0
        registers.add(6)
        line.until(lambda: registers.acknowledged == 6)
        parts = [r["Part"] for r in line.in_order]
        self.assertEqual(parts[-6:], [1, 2, 3, 4, 5, 6])
        self.assertEqual(len(parts), len(line.results))  # what waited in vain was given before

    def test_a_command_is_executed_once_whatever_is_lost(self):
        registers, chance = Registers(), random.Random(1)
        line = MemoryPlc(registers, lose=lambda write, address: chance.random() < 0.25)
        line.until(lambda: line.station["Connected"])
        for code in (5, 6, 5, 6, 2, 3, 2, 5):
            registers.executing_for = 2
            self.assertEqual(line.command(code), 0)
        self.assertEqual(registers.executed, [5, 6, 5, 6, 2, 3, 2, 5])
        self.assertGreater(line.lost_answers, 8)
        self.assertEqual(line.station["CommandResult"], 77)

    def test_a_token_stays_while_its_command_is_not_answered(self):
        registers = Registers()

        def lose(write, address):
            lost = write and address == 8002 and not registers.executed
            registers.uptime += 1000 * lost  # enough to go on from another token
            return lost
        line = MemoryPlc(registers, lose=lose)
        line.until(lambda: line.station["Connected"])
        self.assertEqual(line.command(5), 0)
        self.assertEqual((registers.executed, line.lost_answers), ([5], 1))

    def test_a_reply_to_another_master_is_not_taken(self):
        registers = Registers()
        line = MemoryPlc(registers)
        line.until(lambda: line.station["Connected"])
        line.station.update(Send=True, Command=6)
        line.until(lambda: registers.executed == [6])
        registers.foreign = True
        line.until(lambda: not line.station["CommandBusy"])
        self.assertEqual((line.station["CommandDone"], line.station["CommandResult"], registers.executed), (True, 77, [6]))

    def test_a_slot_that_is_overwritten_while_it_is_read_is_read_again(self):
        registers = Registers()
        registers.add(9)
        registers.torn = 3
        line = MemoryPlc(registers)
        line.until(lambda: len(line.results) == 9)
        self.assertEqual(line.sequences(), list(range(1, 10)))
        self.assertNotIn(4242, [r["Part"] for r in line.results])

    def test_the_conveyor_stops_at_a_line_stop_and_without_the_run_permit(self):
        registers = Registers()
        line = MemoryPlc(registers)
        for bits, runs in [(2, True), (6, False), (4, False), (0, False), (3, True)]:
            registers.bits = bits
            line.cycles(60)
            self.assertEqual(line.line.memory["Conveyor"], runs, bits)

    def test_a_command_of_before_a_restart_is_not_executed_after_it(self):
        registers = Registers()
        line = MemoryPlc(registers)
        line.until(lambda: line.station["Connected"])
        registers.answers = False
        line.station.update(Send=True, Command=5)
        line.cycles(50)
        registers.answers, registers.boot = True, 0x50005
        line.until(lambda: not line.station["CommandBusy"])
        self.assertEqual((line.station["CommandFailed"], line.station["CommandError"]), (True, 7))

    def test_a_plc_that_forgot_its_token_uses_a_larger_one(self):
        registers = Registers()
        first = MemoryPlc(registers)
        first.until(lambda: first.station["Connected"])
        first.command(5)
        registers.uptime += 60
        cold = MemoryPlc(registers)
        cold.until(lambda: cold.station["Connected"])
        self.assertEqual(cold.command(6), 0)
        self.assertEqual(registers.executed, [5, 6])

    def test_a_command_without_a_reply_ends(self):
        registers = Registers()
        line = MemoryPlc(registers)
        line.until(lambda: line.station["Connected"])
        registers.answers = False
        self.assertEqual(line.command(5), 101)
        self.assertEqual(MemoryPlc(registers).command(5), 100)

    def test_a_plc_that_may_not_write_reads_on_and_says_so(self):
        registers = Registers()
        registers.may_write = False
        line = MemoryPlc(registers)
        registers.add(20)
        line.until(lambda: len(line.results) == 20)
        self.assertEqual((line.station["Refused"], line.station["Connected"]), (1, True))
        self.assertEqual(line.command(5), 102)

    def test_the_conveyor_stops_when_the_station_is_silent(self):
        registers = Registers()
        line = MemoryPlc(registers)
        line.until(lambda: line.line.memory["Conveyor"])
        registers.answers = False
        line.cycles(90)
        self.assertTrue(line.station["Alive"])  # a lost answer alone stops nothing
        line.cycles(40)
        self.assertFalse(line.line.memory["Conveyor"])
        registers.answers = True
        line.until(lambda: line.line.memory["Conveyor"])

    def test_a_wrong_device_a_wrong_byte_order_and_an_old_map_are_named(self):
        for change, error in [({"magic": (0x4F48, 0x4452)}, 2), ({"version": 4}, 3), ({"answers": False}, 1)]:
            registers = Registers()
            registers.__dict__.update(change)
            line = MemoryPlc(registers)
            line.until(lambda: line.station["ErrorId"] != 0)
            self.assertEqual(line.station["ErrorId"], error)
            self.assertFalse(line.station["Connected"] or line.line.memory["Conveyor"])

    def test_a_client_that_never_answers_is_given_up(self):
        registers = Registers()
        line = MemoryPlc(registers)
        line.library.native("ModbusClient", lambda memory: None)
        line.until(lambda: line.station["ErrorId"] == 1)
        self.assertFalse(line.station["Execute"])

    def test_held_results_wait(self):
        registers = Registers()
        registers.add(7)
        line = MemoryPlc(registers)
        line.station["Hold"] = True
        line.cycles(200)
        self.assertEqual((line.results, registers.acknowledged), ([], 0))
        line.station["Hold"] = False
        line.until(lambda: registers.acknowledged == 7)

    def test_the_heartbeat_changes_in_every_poll(self):
        registers = Registers()
        MemoryPlc(registers).cycles(1000)
        beats = [words[0] for address, words in registers.writes if address == 8102]
        self.assertGreater(len(beats), 60)  # ten seconds
        self.assertTrue(all(a != b for a, b in zip(beats, beats[1:])))


if __name__ == "__main__":
    unittest.main()
