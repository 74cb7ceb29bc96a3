"""More clients than may be, slow ones and broken ones: crowd_test.py BIN_DIR

The page has no station here and says so. It must go on answering, in bounded memory, and end when it is told to.
"""
import json
import re
import signal
import socket
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request

from line import Page
from webdriver import wait_for

VIEWERS = 4
HEAD = "GET {} HTTP/1.1\r\nHost: localhost\r\n"


def main():
    with tempfile.TemporaryDirectory(prefix="hord-crowd-", ignore_cleanup_errors=True) as folder:
        page = Page(sys.argv[1], folder, 1, viewers=VIEWERS)  # port 1 has no server
        port = int(page.address.rsplit(":", 1)[1])

        def connect(text=""):
            one = socket.create_connection(("127.0.0.1", port), timeout=120)
            one.sendall(text.encode())
            return one

        def state():
            try:
                with urllib.request.urlopen(page.address + "/api/state", timeout=120) as reply:
                    return json.load(reply)
            except (OSError, urllib.error.HTTPError):
                return None  # full at the moment

        told = wait_for("the page says that the station is away", lambda: (lambda s: s if s and s["trouble"]["cure"] else None)(state()))
        assert told["up"] is False and "127.0.0.1:1" in told["trouble"]["what"], told

        viewers = [connect(HEAD.format("/api/events") + "\r\n") for _ in range(VIEWERS)]
        for viewer in viewers:
            assert viewer.recv(4096).startswith(b"HTTP/1.1 200"), "a viewer is not taken"
        with connect(HEAD.format("/api/events") + "Connection: close\r\n\r\n") as one_too_many:
            assert one_too_many.recv(4096).startswith(b"HTTP/1.1 503"), "more viewers than may be"

        silent = [connect() for _ in range(60)]                                    # send nothing
        halves = [connect(HEAD.format("/")) for _ in range(20)]                    # never finish the request
        greedy = [connect((HEAD.format("/page.js") + "\r\n") * 50) for _ in range(10)]  # send requests and never read
        ended = threading.Event()
        drip = connect()

        def slowly():  # sends a byte from time to time, endlessly
            try:
                while not ended.wait(0.2):
                    drip.sendall(b"G")
            except OSError:
                pass

        dripping = threading.Thread(target=slowly, daemon=True)
        dripping.start()
        began = time.monotonic()
        assert wait_for("an answer beside them", state)["up"] is False
        answered_s = time.monotonic() - began
        for viewer in viewers:  # earlier viewers still receive updates
            viewer.settimeout(120)
            assert viewer.recv(4096), "a viewer was dropped"
        dripping.join(120)
        assert not dripping.is_alive(), "a client that sends a byte now and then is kept for ever"

        for one in silent + halves + greedy + viewers + [drip]:
            one.close()
        wait_for("the viewers' places are free again", lambda: viewers_now(page) == 0)
        with urllib.request.urlopen(page.address + "/metrics", timeout=120) as reply:
            resident = float(re.search(r"\nprocess_resident_memory_bytes (\S+)", reply.read().decode())[1])
        assert resident < 128e6, f"{resident} bytes"
        page.end(signal.SIGTERM)
        assert page.process.returncode == 0, "".join(page.err)
        print(f"{len(silent) + len(halves) + len(greedy)} idle, broken and greedy clients: an answer beside them after {answered_s:.1f} s; afterwards {resident / 1e6:.0f} MB")


def viewers_now(page):
    try:
        with urllib.request.urlopen(page.address + "/metrics", timeout=120) as reply:
            return float(re.search(r"\nhord_page_viewers (\S+)", reply.read().decode())[1])
    except (OSError, urllib.error.HTTPError):
        return None


if __name__ == "__main__":
    main()
