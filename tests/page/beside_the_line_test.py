"""What becomes of the page is nothing to the line: beside_the_line_test.py BIN_DIR

Two stations with the same parts at the same time, one with a page beside it that is asked without pause and then killed. The line
must not show it: the same verdicts, none of them late.
"""
import signal
import sys
import tempfile
import threading
import urllib.request

from line import Page, Station
from webdriver import wait_for

PARTS = 24


def main():
    bin_dir = sys.argv[1]
    with tempfile.TemporaryDirectory(prefix="hord-line-", ignore_cleanup_errors=True) as folder:
        watched = Station(bin_dir, folder, parts=PARTS)
        alone = Station(bin_dir, folder, parts=PARTS, store="other-store")
        page = Page(bin_dir, folder, watched.port)
        ended = threading.Event()

        def keep_asking(path):
            while not ended.is_set():
                try:
                    with urllib.request.urlopen(page.address + path, timeout=120) as reply:
                        reply.read()
                except OSError:
                    ended.wait(0.05)

        viewers = [threading.Thread(target=keep_asking, args=(path,), daemon=True) for path in ("/api/page", "/api/results?verdict=reject", "/metrics")]
        for viewer in viewers:
            viewer.start()
        wait_for("the page follows the line", lambda: len(watched.results()) > PARTS // 3)
        page.end(signal.SIGKILL)
        killed_at = len(watched.results())
        ended.set()
        watched.wait()
        alone.wait()
        with_page, without = watched.results(), alone.results()
        differ = [(part, with_page.get(part), result) for part, result in without.items() if (with_page.get(part) or {}).get("verdict") != result["verdict"]]
        late = [part for part, result in with_page.items() if result["reason"] == "verdict-late"]
        # A machine that stops the line of the one without a page, too, has shown nothing.
        if alone.process.returncode != 0:
            print(f"skipped: this machine is too slow for the line without a page: {''.join(alone.err)[-300:]}")
            return 77
        assert len(without) == PARTS and killed_at < PARTS, f"killed after {killed_at} parts of {len(without)}"
        assert watched.process.returncode == 0, "".join(watched.err)[-600:]
        assert not differ, f"other verdicts beside a page that was killed: {differ[:3]}"
        assert not late, f"late verdicts beside a page that was killed: {late}"
        print(f"{len(with_page)} parts, page killed after {killed_at}: the same verdicts as without one, none late")
    return 0


if __name__ == "__main__":
    sys.exit(main())
