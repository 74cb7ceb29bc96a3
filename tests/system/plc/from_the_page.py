"""A PLC's program as docs/plc.md, "A program of your own, in words", describes it, step by step; pymodbus talks to the
station. It shares nothing with the function blocks of deploy/plc."""
import time

from pymodbus.client import ModbusTcpClient


class Refused(Exception):
    def __init__(self, code):
        super().__init__(code)
        self.code = code


class Master:
    """`memory` (boot_id, taken, token) is what a PLC keeps over a power-down; None: it was lost."""

    def __init__(self, port, memory=None):
        self.client = ModbusTcpClient("127.0.0.1", port=port, timeout=20)
        self.memory = memory or {"boot": 0, "taken": 0, "token": 0}
        self.results, self.lost, self.beat, self.codes, self.state = [], 0, 0, [], 0
        self.ident()

    def read(self, address, count):
        reply = self.client.read_holding_registers(address, count=count, slave=1)
        if reply.isError():
            raise ConnectionError(str(reply))
        return reply.registers

    def write(self, address, words):
        reply = self.client.write_registers(address, words, slave=1)
        if reply.isError():
            if not hasattr(reply, "exception_code"):
                raise ConnectionError(str(reply))
            self.codes.append(reply.exception_code)
            raise Refused(reply.exception_code)

    @staticmethod
    def number(words, at):
        return words[at] << 16 | words[at + 1]

    def ident(self):
        ident = self.read(0, 12)                                    # 1
        assert (ident[2], ident[3]) == (0x484F, 0x5244)
        boot = self.number(ident, 7)
        self.acknowledged = self.number(self.read(8103, 2), 0)      # 2
        if boot != self.memory["boot"] or self.memory["taken"] < self.acknowledged:
            self.memory["taken"] = self.acknowledged
        self.memory["boot"] = boot
        self.asked = self.acknowledged
        if self.memory["token"] == 0:                               # 3
            self.memory["token"] = 16 * self.number(self.read(8402, 2), 0)

    def cycle(self):
        status = self.read(100, 40)                                 # 4
        if self.number(status, 21) != self.memory["boot"]:
            return self.ident()
        self.state = status[2]
        last, oldest = self.number(status, 6), self.number(status, 8)
        if oldest > self.memory["taken"] + 1:
            self.lost += oldest - self.memory["taken"] - 1
            self.memory["taken"] = oldest - 1
        self.beat = (self.beat + 1) % 65536                         # 5
        alone = self.acknowledged == 0 and 1 < oldest == self.memory["taken"] + 1
        if not alone and self.asked == self.acknowledged:
            self.asked = self.memory["taken"]
        try:
            self.write(8102, [self.beat] if alone else [self.beat, self.asked >> 16, self.asked & 0xFFFF])
            if not alone:
                self.acknowledged = self.asked
        except Refused as refused:
            if refused.code == 3:
                return self.ident()
            assert refused.code in (4, 6), refused.code
        while last > self.memory["taken"]:                          # 6
            slot = (self.memory["taken"] + 1) % 256
            n = min(last - self.memory["taken"], 5, 256 - slot)
            words = self.read(1000 + 24 * slot, 24 * n)
            for at in range(0, 24 * n, 24):
                expected = self.memory["taken"] + 1
                if self.number(words, at) != expected or self.number(words, at + 22) != expected:
                    return None
                self.results.append({"Boot": self.memory["boot"], "Sequence": expected, "Part": self.number(words, at + 2), "Verdict": words[at + 8]})
                self.memory["taken"] = expected
        return None

    def command(self, code, argument=0):
        """7; the error, 0: completed."""
        self.memory["token"] += 1
        token, boot = self.memory["token"], self.memory["boot"] & 0xFFFF
        written = False
        while True:
            if not written:
                try:
                    self.write(8002, [token >> 16, token & 0xFFFF, boot, code, argument >> 16, argument & 0xFFFF, 0, 0])
                    written = True
                except Refused as refused:
                    assert refused.code == 6, refused.code
            if written:
                reply = self.read(8022, 7)
                if self.number(reply, 0) != token:
                    written = False
                elif reply[3] >= 2:
                    return reply[4]
            self.cycle()
            time.sleep(0.02)

    def until(self, condition, seconds=120):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, (self.memory, self.acknowledged, self.state)
            self.cycle()
            time.sleep(0.02)  # quicker than the disk: acknowledgements are refused with 06 at first
