"""A simulated station and the page beside it, as processes."""
import atexit
import http.client
import json
import os
import pathlib
import re
import signal
import subprocess
import threading
import urllib.request

from webdriver import wait_for

# Long times, so that a slow machine is not late: the test is not about speed.
CONFIGURATION = """
[station]
max_failures_in_a_row = 0
[inspection]
macro = "9x9"
[line]
transport_ms = 2000
exposure_delay_ms = 200
min_gap_ms = 290
[timing]
trigger_lead_ms = 150
strobe_window_us = 5000
frame_window_us = 9000
frame_timeout_ms = 1000
[rejector]
lead_ms = 200
early_ms = 130
pulse_ms = 270
response_timeout_ms = 1000
confirm_timeout_ms = 3000
[store]
free_mb = 1
"""


class Process:
    """A program whose both streams are kept; its lines can be waited for."""

    def __init__(self, arguments, environment=None):
        self.process = subprocess.Popen([str(a) for a in arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ, **(environment or {})))
        atexit.register(self._kill)  # a failing test leaves no process running
        self.out, self.err = [], []
        self.readers = [threading.Thread(target=lambda s=s, k=k: k.extend(iter(s.readline, "")), daemon=True)
                        for s, k in ((self.process.stdout, self.out), (self.process.stderr, self.err))]
        for reader in self.readers:
            reader.start()

    def _kill(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

    def says(self, pattern):
        def look():
            found = re.search(pattern, "".join(self.err))
            if not found and self.process.poll() is not None:
                raise AssertionError(f"ended with {self.process.returncode}: {''.join(self.err)}")
            return found
        return wait_for(f"{pattern} from {self.process.args[0]}", look)

    def end(self, how=signal.SIGINT):
        if self.process.poll() is None:
            self.process.send_signal(how)
        self.wait()

    def wait(self):
        try:
            self.process.wait(timeout=120)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise
        for reader in self.readers:
            reader.join()


class Station(Process):
    """In real time, as the service runs; where that is refused, it says so and goes on."""

    def __init__(self, bin_dir, folder, port=0, parts=0, rate=3, seed=7, store="store"):
        configuration = pathlib.Path(folder) / "station.toml"
        configuration.write_text(CONFIGURATION)
        arguments = ["stdbuf", "-oL", f"{bin_dir}/hordctl", "run", "--simulate", "--config", configuration, "--modbus", f"127.0.0.1:{port}", "--rate", rate, "--good", 0.6, "--variety", 1, "--seed", seed,
                     "--realtime", 5, "--json", "--store", f"{folder}/{store}"]
        super().__init__(arguments + (["--parts", parts] if parts else []))
        self.port = int(self.says(r"registers at [^ ]*:(\d+)")[1])

    def results(self):
        """What the station itself said of each part so far, by part."""
        told = [json.loads(line) for line in list(self.out) if line.startswith("{") and line.endswith("}\n")]
        return {result["part"]: result for result in told}


class Page(Process):
    def __init__(self, bin_dir, folder, station_port, token=None, viewers=4):
        folder = pathlib.Path(folder)
        text = f'[page]\nport = 0\nviewers = {viewers}\n[station]\nmodbus = "127.0.0.1:{station_port}"\nstore = "store"\n'
        if token:
            tokens = folder / "tokens"
            tokens.write_text(f"anna {token}\n")
            tokens.chmod(0o600)
            text += '[actions]\ntokens = "tokens"\n'
        configuration = folder / "page.toml"
        configuration.write_text(text)
        super().__init__(["nice", "-n", "10", f"{bin_dir}/hord-page", "--config", configuration])  # as in its systemd unit
        self.address = self.says(r"(http://127\.0\.0\.1:\d+)/")[1]


class LineKeeper:
    """A person beside the line: resets it when a machine that is too slow for real time has stopped it."""

    def __init__(self, bin_dir, page, port):
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._keep, args=(bin_dir, page, port), daemon=True)
        self.thread.start()

    def _keep(self, bin_dir, page, port):
        while not self.ended.wait(1):
            try:
                with urllib.request.urlopen(page.address + "/api/state", timeout=120) as reply:
                    state = json.load(reply)["rows"].get("status", {}).get("state")
            except (OSError, http.client.HTTPException):
                continue  # the page is busy; try again
            if state == "Error":
                subprocess.run([f"{bin_dir}/hordctl", "command", "reset", "--modbus", f"127.0.0.1:{port}"], capture_output=True, check=False)

    def end(self):
        self.ended.set()
        self.thread.join()
