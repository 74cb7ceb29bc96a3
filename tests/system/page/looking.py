"""What the tests with a browser share: a line with its page and somebody who looks at it, checks, and how they end."""
import pathlib
import sys
import tempfile

from line import LineKeeper, Page, Station
from webdriver import Browser, missing, wait_for

TOKEN = "a-token-of-the-test-0123456789"
TEXT = "return document.getElementById(arguments[0]).textContent"
# Contrast of every text with its background: WCAG's ratio of the computed colours.
LOW_CONTRAST = """
const parts = (c) => c.match(/[\\d.]+/g).map(Number);
const light = (c) => { const [r, g, b] = parts(c).map((v) => { v /= 255; return v <= 0.04045 ? v / 12.92 : Math.pow((v + 0.055) / 1.055, 2.4); }); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
const behind = (e) => { for (; e; e = e.parentElement) { const c = getComputedStyle(e).backgroundColor; if (!(parts(c).length === 4 && parts(c)[3] === 0)) return c; } return 'rgb(255,255,255)'; };
const low = [];
for (const e of document.querySelectorAll('main *, header *, footer *')) {
  if (![...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim()) || e.closest('svg') || !e.checkVisibility() || e.closest('button:disabled')) continue;
  const a = light(getComputedStyle(e).color), b = light(behind(e)), ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
  if (ratio < 4.5) low.push(e.tagName + ' ' + e.className + ' ' + e.textContent.trim().slice(0, 30) + ' ' + ratio.toFixed(2));
}
return low;
"""


def check(is_so, what):
    if not is_so:
        raise AssertionError(what)


def check_screen(browser, file, width, height, dark, whole=False):
    """A screenshot; nothing is wider than the screen, every text can be read."""
    browser.screenshot(file, width, height, dark, whole=whole)
    check(browser.run("return document.documentElement.scrollWidth <= innerWidth"), f"{file.stem}: wider than {width} pixels")
    check(not browser.run(LOW_CONTRAST), f"{file.stem}: hard to read: {browser.run(LOW_CONTRAST)}")


def check_console(browser):
    complaints = [entry for entry in browser.log() if entry["level"] in ("SEVERE", "WARNING")]
    check(not complaints, f"the console complains: {complaints[:5]}")


def load(browser, page):
    browser.open(page.address + "/")
    wait_for("the page is loaded", lambda: browser.run("return document.documentElement.dataset.loaded === 'yes'"))


class Line:
    """A simulated station, its page, somebody who resets it, and a browser. All end together; of a failure a screenshot
    stays in `out`."""

    def __init__(self, bin_dir, out, folder):
        self.bin_dir, self.out, self.folder = bin_dir, out, folder

    def __enter__(self):
        self.station = Station(self.bin_dir, self.folder)
        self.page = Page(self.bin_dir, self.folder, self.station.port, TOKEN)
        self.keeper = LineKeeper(self.bin_dir, self.page, self.station.port)
        self.browser = Browser(self.folder)
        return self

    def __exit__(self, kind, error, trace):
        try:
            if kind is not None:
                print("the page says:", [self.browser.run(TEXT, name) for name in ("lamps", "actions-said", "actions-next")], file=sys.stderr)
                self.browser.screenshot(self.out / "failed.png", 1280, 800, False, whole=True)
        finally:
            self.keeper.end()
            self.browser.close()
            self.page.end()
            self.station.end()


def main(*parts):
    """Each part is called with BIN_DIR, OUTPUT_DIR and an empty folder of its own. Status 77: no browser is installed."""
    if why := missing():
        print(f"skipped: {why}")
        sys.exit(77)
    out = pathlib.Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    for part in parts:
        with tempfile.TemporaryDirectory(prefix="hord-page-", ignore_cleanup_errors=True) as folder:
            part(sys.argv[1], out, pathlib.Path(folder))
    print(f"screenshots in {out}")
