"""Hostile clients against the real page: hostile_test.py BIN_DIR

They drip bytes, take large frames slowly, send refused commands and malformed requests. Beside them the page must answer
at once, in bounded memory, with few lines in its log.
"""
import pathlib
import re
import socket
import struct
import sys
import tempfile
import threading
import time
import zlib

from line import Page, Station
from webdriver import wait_for

TOKEN = "a-token-of-the-test-0123456789"
HEAD = "GET {} HTTP/1.1\r\nHost: localhost\r\n"
COMMAND = f"POST /api/command HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nAuthorization: Bearer {'x' * 30}\r\n"
DRIPPING, READERS, FRAME_MB = 60, 40, 28


def store_with_a_large_frame(bin_dir, folder):
    """A store of a simulated run, and the key of a part whose frame has FRAME_MB more in chunks that a reader skips."""
    Station(bin_dir, folder, parts=8).wait()
    file = sorted(pathlib.Path(folder, "store").rglob("*-reject.png"))[0]
    png = file.read_bytes()
    body = b"zzZz" + bytes(7 << 20)
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    file.write_bytes(png[:-12] + chunk * (FRAME_MB // 7) + png[-12:])
    boot = re.search(rb'"boot":\s*"?([0-9a-f]+)', png)[1]
    part = re.search(r"-p(\d+)-", file.name)[1]
    return f"{int(boot):08x}-{part}"


def main():
    with tempfile.TemporaryDirectory(prefix="hord-hostile-", ignore_cleanup_errors=True) as folder:
        key = store_with_a_large_frame(sys.argv[1], folder)
        page = Page(sys.argv[1], folder, 1, TOKEN)  # port 1 has no server
        address = ("127.0.0.1", int(page.address.rsplit(":", 1)[1]))

        def connect(text="", buffer=None):
            one = socket.socket()
            one.settimeout(60)
            if buffer:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
            one.connect(address)
            one.sendall(text.encode())
            return one

        def ask(text, seconds=60):
            with connect(text) as one:
                one.settimeout(seconds)
                got = b""
                while data := one.recv(65536):
                    got += data
                return got

        def slowest_answer(times=20):
            slowest = 0
            for _ in range(times):
                began = time.monotonic()
                answer = ask(HEAD.format("/api/state") + "Connection: close\r\n\r\n", 30)
                assert answer.startswith(b"HTTP/1.1 200"), answer[:80]
                slowest = max(slowest, time.monotonic() - began)
            return slowest

        def memory_mb(what):
            return int(re.search(rf"{what}:\s+(\d+) kB", pathlib.Path(f"/proc/{page.process.pid}/status").read_text())[1]) / 1024

        # Bytes that drip: in heads, and in bodies of commands.
        ended = threading.Event()
        lives = []

        def drip(text):
            began = time.monotonic()
            try:
                with connect(text) as one:
                    while not ended.wait(0.2):
                        one.sendall(b"G")
                        one.setblocking(False)
                        try:
                            if not one.recv(4096):
                                break
                        except BlockingIOError:
                            pass
                        one.setblocking(True)
            except OSError:
                pass
            lives.append(time.monotonic() - began)

        dripping = [threading.Thread(target=drip, args=(text,), daemon=True) for text in ["GET /"] * DRIPPING + [COMMAND + "Content-Length: 4000\r\n\r\n"] * DRIPPING]
        for thread in dripping:
            thread.start()
        time.sleep(1)
        drip_s = slowest_answer()
        ended.wait(9)
        kept = sum(thread.is_alive() for thread in dripping)
        ended.set()

        # Slow readers of a large frame: each takes one buffer and then nothing.
        before_mb = memory_mb("VmHWM")
        readers = [connect(HEAD.format(f"/parts/{key}/frame.png") + "\r\n", buffer=65536) for _ in range(READERS)]
        for one in readers:
            answer = one.recv(400)
            assert answer.startswith(b"HTTP/1.1 200"), answer
        peak_mb, reader_s = memory_mb("VmHWM"), slowest_answer()
        for one in readers:
            one.close()
        whole = ask(HEAD.format(f"/parts/{key}/frame.png") + "Connection: close\r\n\r\n")

        # Compressed replies cost the processor more than they save.
        packed = ask(HEAD.format("/api/results?limit=200") + "Accept-Encoding: gzip, br\r\nConnection: close\r\n\r\n")

        lines = len(page.err)
        for _ in range(300):
            ask(COMMAND + "Content-Length: 2\r\nConnection: close\r\n\r\n{}")
        time.sleep(0.5)
        lines = len(page.err) - lines
        malformed = ask("GARBAGE" + "\r\nA: b" * 50 + "\r\n\r\n")
        hosts = [ask(f"GET / HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")[:12] for host in ("[::1].evil", "127.0.0.1:x@evil")]

        print(f"{2 * DRIPPING} dripping clients: an answer beside them within {drip_s:.3f} s, {kept} kept after 10 s, the longest {max(lives):.1f} s")
        print(f"{READERS} slow readers of {len(whole) / 1e6:.0f} MB: {before_mb:.0f} MB before, {peak_mb:.0f} MB at the peak, an answer beside them within {reader_s:.3f} s")
        print(f"{lines} lines in the log of 300 refused commands; {malformed.count(b'HTTP/1.')} answers to a malformed request; foreign hosts: {hosts}")
        assert drip_s < 2 and kept == 0, "dripping clients silence the page, or are kept"
        assert peak_mb < 192 and reader_s < 2, "slow readers cost the page its memory, or silence it"
        assert whole.startswith(b"HTTP/1.1 200") and len(whole) > FRAME_MB << 20, "the frame is not whole"
        assert b"Content-Encoding" not in packed and packed.startswith(b"HTTP/1.1 200"), packed[:200]
        assert lines <= 6 and malformed.count(b"HTTP/1.") <= 1 and all(host == b"HTTP/1.1 421" for host in hosts)
        wait_for("the page ends", lambda: page.end() is None)


if __name__ == "__main__":
    main()
