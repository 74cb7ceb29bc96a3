#!/usr/bin/env python3
"""A picture of a station's page as it is now, with its last reject: picture.py ADDRESS FILE. Exit status 77: no browser can be had."""
import sys
import tempfile

from webdriver import Browser, missing, wait_for


def main():
    if why := missing():
        print(f"no picture of the page: {why}")
        return 77
    with tempfile.TemporaryDirectory(prefix="hord-page-", ignore_cleanup_errors=True) as folder:
        browser = Browser(folder)
        try:
            browser.open(sys.argv[1])
            wait_for("the picture of a reject", lambda: browser.run("const m = document.getElementById('map'); return !!m && m.complete && m.naturalWidth > 0"), 30)
            browser.screenshot(sys.argv[2], 1024, 1366, False, whole=True)
        finally:
            browser.close()
    return 0


sys.exit(main())
