"""A PLC that runs Structured Text, its Modbus client, and a station: what the tests of this folder share."""
import json
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

import st

ROOT = Path(__file__).resolve().parents[3]
LIBRARY = ROOT / "deploy/plc"
PARTS_OF_IT = ["hord_types.st", "hord_in_order.st", "hord_station.st"]


class NoAnswer(Exception):
    pass


class Refused(Exception):
    def __init__(self, code):
        super().__init__(f"exception {code:02}")
        self.code = code


class Wire:
    """One Modbus TCP connection, opened when it is needed."""

    def __init__(self, port):
        self.port, self.socket, self.number = port, None, 0
        self.exceptions = {}  # code: how often

    def close(self):
        if self.socket:
            self.socket.close()
        self.socket = None

    def request(self, pdu, lose_answer=False):
        try:
            if not self.socket:
                self.socket = socket.create_connection(("127.0.0.1", self.port), timeout=20)
            self.number = (self.number + 1) % 65536
            self.socket.sendall(struct.pack(">HHHB", self.number, 0, len(pdu) + 1, 1) + pdu)
            header = self.take(7)
            answer = self.take(struct.unpack(">H", header[4:6])[0] - 1)
        except OSError as error:
            self.close()
            raise NoAnswer(str(error)) from None
        if lose_answer:
            self.close()
            raise NoAnswer("lost")
        if answer[0] & 0x80:
            self.exceptions[answer[1]] = self.exceptions.get(answer[1], 0) + 1
            raise Refused(answer[1])
        return answer[1:]

    def take(self, size):
        out = b""
        while len(out) < size:
            more = self.socket.recv(size - len(out))
            if not more:
                raise ConnectionResetError("closed")
            out += more
        return out

    def read(self, address, count, lose_answer=False):
        answer = self.request(struct.pack(">BHH", 3, address, count), lose_answer)
        return list(struct.unpack(f">{count}H", answer[1:]))

    def write(self, address, words, lose_answer=False):
        self.request(struct.pack(">BHHB", 16, address, len(words), 2 * len(words)) + struct.pack(f">{len(words)}H", *words), lose_answer)

    def number_at(self, address):
        high, low = self.read(address, 2)
        return high << 16 | low


class Plc:
    """Runs the program Line of deploy/plc in cycles. `lose`: of (write, address), whether its answer is lost."""

    def __init__(self, port, kept=None, lose=None):
        self.library = st.Library()
        for name in PARTS_OF_IT + ["hord_example.st"]:
            self.library.add((LIBRARY / name).read_text(), name)
        self.library.native("ModbusClient", self.modbus)
        self.wire, self.lose = Wire(port), lose or (lambda write, address: False)
        self.line = self.library.instance("Line", kept.line if kept else None)
        self.results, self.in_order, self.lost_answers = [], [], 0
        self.library.watchers["HordInOrder"] = lambda memory: memory["Ready"] and self.in_order.append(dict(memory["Next"]))

    @property
    def station(self):
        return self.line.memory["Station"].memory

    def modbus(self, memory):
        """The body of ModbusClient: an answer comes one cycle after its request."""
        if not memory["Execute"]:
            memory["Done"] = memory["Failed"] = False
        elif not memory["Done"] and not memory["Failed"]:
            lost = self.lose(memory["Write"], memory["Address"])
            self.lost_answers += lost
            memory["Exception"] = 0
            try:
                if memory["Write"]:
                    self.wire.write(memory["Address"], memory["Registers"][:memory["Count"]], lost)
                else:
                    memory["Registers"][:memory["Count"]] = self.wire.read(memory["Address"], memory["Count"], lost)
                memory["Done"] = True
            except Refused as refused:
                memory["Failed"], memory["Exception"] = True, refused.code
            except NoAnswer:
                memory["Failed"] = True

    def cycle(self):
        self.library.run(self.line)
        self.results += [dict(r) for r in self.station["Results"][:self.station["ResultCount"]]]
        time.sleep(0.005)

    def until(self, condition, seconds=120):
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise AssertionError(f"not within {seconds} s: {self.outputs()}")
            self.cycle()

    def command(self, code, argument=0):
        """The reply's error; 0: completed."""
        instance = self.line.memory["Station"].memory
        instance.update(Send=True, Command=code, Argument=argument)
        self.cycle()
        instance["Send"] = False
        self.until(lambda: not instance["CommandBusy"])
        assert instance["CommandDone"] != instance["CommandFailed"]
        return instance["CommandError"]

    def outputs(self):
        return {v.name: self.station[v.name] for v in self.library.units["HordStation"].variables.values()
                if v.section == "VAR_OUTPUT" and v.name != "Results"}


class Station:
    """`hordctl run --simulate` with a store."""

    def __init__(self, programs, folder, port=0, rate=2, more=()):
        self.log = []
        self.process = subprocess.Popen(
            [f"{programs}/hordctl", "run", "--simulate", "--variety", "1", "--good", "0.6", "--rate", str(rate), "--modbus", f"127.0.0.1:{port}",
             "--store", f"{folder}/store", "--reset-after", "1", *more], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.reader = threading.Thread(target=self.read_log)
        self.reader.start()
        end = time.monotonic() + 120
        while not (found := re.search(r"registers at 127\.0\.0\.1:(\d+)", "".join(self.log))):
            if self.process.poll() is not None or time.monotonic() > end:
                sys.exit("the station did not start: " + "".join(self.log))
            time.sleep(0.05)
        self.port = int(found[1])

    def read_log(self):
        for line in self.process.stderr:
            self.log.append(line)

    def stop(self, how=signal.SIGINT):
        if self.process.poll() is None:
            self.process.send_signal(how)
        self.process.wait(60)
        self.reader.join()
        self.process.stderr.close()


def stored(programs, folder):
    """Results as the store has them, the oldest first."""
    said = subprocess.run([f"{programs}/hordctl", "results", "--store", f"{folder}/store", "--format", "json"], capture_output=True, text=True,
                          check=True)
    return sorted((json.loads(line) for line in said.stdout.splitlines()), key=lambda row: row["number"])
