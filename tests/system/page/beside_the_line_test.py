"""What becomes of the page is nothing to the line: beside_the_line_test.py BIN_DIR

Two stations with the same parts, one with a page beside it that is asked without pause and then killed. The line must not show it:
the same verdicts, none of them late.
"""
import http.client
import signal
import sys
import tempfile
import threading
import urllib.request

from line import Page, Station
from webdriver import wait_for

PARTS = 30


def compare(bin_dir, folder):
    """True, or what went wrong on the line beside the page; None where the line without one went wrong, too."""
    alone = Station(bin_dir, folder, parts=PARTS, store="other-store")
    watched = Station(bin_dir, folder, parts=PARTS)
    page = Page(bin_dir, folder, watched.port)
    ended = threading.Event()

    def keep_asking(path):
        while not ended.wait(0.02):
            try:
                with urllib.request.urlopen(page.address + path, timeout=120) as reply:
                    reply.read()
            except (OSError, http.client.HTTPException):
                pass  # it was killed

    viewers = [threading.Thread(target=keep_asking, args=(path,), daemon=True) for path in ("/api/page", "/api/results?verdict=reject", "/metrics")]
    for viewer in viewers:
        viewer.start()
    wait_for("the page sees the line run", lambda: len(watched.results()) > PARTS // 3)
    page.end(signal.SIGKILL)
    killed_at = len(watched.results())
    ended.set()
    watched.wait()
    alone.wait()
    with_page, without = watched.results(), alone.results()
    if alone.process.returncode != 0 or any(result["reason"] == "verdict-late" for result in without.values()):
        return None
    assert len(without) == PARTS and killed_at < PARTS, f"killed after {killed_at} parts of {len(without)}"
    if watched.process.returncode != 0:
        return "".join(watched.err)[-600:]
    late = [part for part, result in with_page.items() if result["reason"] == "verdict-late"]
    differ = [(part, with_page.get(part), result) for part, result in without.items() if (with_page.get(part) or {}).get("verdict") != result["verdict"]]
    if late or differ:
        return f"late: {late}, different: {differ[:3]}"
    print(f"{len(with_page)} parts, page killed after {killed_at}: the same verdicts as without one, none late")
    return True


def main():
    # The line runs in real time, and a busy machine can stop it without a page as well. A page that stops the line would do so
    # every time.
    said = []
    for _ in range(3):
        with tempfile.TemporaryDirectory(prefix="hord-line-", ignore_cleanup_errors=True) as folder:
            said.append(compare(sys.argv[1], folder))
        if said[-1] is True:
            return 0
    wrong = [what for what in said if what]
    if not wrong:
        print("skipped: this machine is too slow for the line even without a page")
        return 77
    print("\n".join(wrong))
    return 1


if __name__ == "__main__":
    sys.exit(main())
