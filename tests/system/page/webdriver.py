"""A headless Chromium over W3C WebDriver, with Python's standard library alone."""
import base64
import json
import os
import re
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request

PATIENCE_S = 120


def missing():
    """What is not installed, or does not start, as one line; None when a browser can be had."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        return "chromium and chromedriver are not installed (packages chromium, chromium-driver)"
    try:
        socket.gethostbyname("localhost")
    except OSError:
        return "localhost is not known here, and chromedriver asks for it: add 127.0.0.1 localhost to /etc/hosts"
    try:
        said = subprocess.run(["chromium", "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--dump-dom", "about:blank"], capture_output=True, text=True,
                              timeout=PATIENCE_S)
    except subprocess.TimeoutExpired:
        return f"chromium is installed and does not show an empty page within {PATIENCE_S} s here"
    if "<html" not in said.stdout:
        return "chromium is installed and cannot show an empty page here (it wants /proc, /sys and /dev/shm): " + said.stderr[-200:].strip().replace("\n", " ")
    return None


def wait_for(what, is_so, patience_s=PATIENCE_S):
    """Asks until is_so() gives something; an error that names `what` when it never does."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        got = is_so()
        if got:
            return got
        time.sleep(0.05)
    raise AssertionError(f"not within {patience_s} s: {what}")


class Browser:
    """What it does is of less weight than the simulated line beside it, which runs in real time: it is nice."""

    def __init__(self, folder):
        self.driver = subprocess.Popen(["nice", "-n", "15", "chromedriver", "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                       env=dict(os.environ, HOME=str(folder), XDG_CONFIG_HOME=str(folder), XDG_CACHE_HOME=str(folder)))
        port = None
        for line in self.driver.stdout:
            found = re.search(r"started successfully on port (\d+)", line)
            if found:
                port = found[1]
                break
        if port is None:
            raise AssertionError("chromedriver did not start")
        self.base = f"http://127.0.0.1:{port}"
        arguments = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-extensions", "--no-first-run", "--disable-background-networking",
                     "--disable-component-update", "--disable-sync", f"--user-data-dir={folder}/profile", "--window-size=1024,1366"]
        made = self._call("POST", "/session", {"capabilities": {"alwaysMatch": {
            "browserName": "chrome", "goog:chromeOptions": {"args": arguments, "binary": shutil.which("chromium")}, "goog:loggingPrefs": {"browser": "ALL"}}}})
        self.session = f"/session/{made['sessionId']}"

    def _call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.base + path, data=data, method=method, headers={"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_S) as reply:
                return json.load(reply)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(f"{method} {path}: {error.read().decode()[:600]}") from None

    def open(self, address):
        self._call("POST", self.session + "/url", {"url": address})

    def run(self, script, *arguments):
        return self._call("POST", self.session + "/execute/sync", {"script": script, "args": list(arguments)})

    def run_async(self, script, *arguments):
        return self._call("POST", self.session + "/execute/async", {"script": script, "args": list(arguments)})

    def cdp(self, command, **parameters):
        return self._call("POST", self.session + "/goog/cdp/execute", {"cmd": command, "params": parameters})

    def keys(self, *names):
        codes = {"Tab": "\ue004", "Enter": "\ue007", "Escape": "\ue00c", "Left": "\ue012", "Home": "\ue011", "End": "\ue010"}
        actions = [step for name in names for step in ({"type": "keyDown", "value": codes[name]}, {"type": "keyUp", "value": codes[name]})]
        self._call("POST", self.session + "/actions", {"actions": [{"type": "key", "id": "keyboard", "actions": actions}]})

    def log(self):
        return self._call("POST", self.session + "/se/log", {"type": "browser"})

    def screenshot(self, file, width, height, dark, whole=False):
        self.cdp("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.cdp("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        self.run("window.scrollTo(0, 0)")
        data = self.cdp("Page.captureScreenshot", format="png", captureBeyondViewport=whole)["data"]
        with open(file, "wb") as out:
            out.write(base64.b64decode(data))

    def close(self):
        try:
            self._call("DELETE", self.session)
        except (AssertionError, OSError):
            pass
        self.driver.terminate()
        self.driver.wait(timeout=30)
        self.driver.stdout.close()
