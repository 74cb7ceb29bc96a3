"""What an operator does with the page, in a real browser: operator_test.py BIN_DIR OUTPUT_DIR

A page without station and store, then a simulated line: halt and bring up, the fold at 1280 by 800, yield and reasons,
charts, maps, zoom; then two stations side by side. Screenshots stay in OUTPUT_DIR. Exit status 77: no browser is installed.
"""
import csv
import io
import json
import re
import socket
import struct
import subprocess
import time
import urllib.request

from line import Page, Process, Station
from looking import TEXT, TOKEN, Line, check, check_console, check_screen, load, main
from webdriver import Browser, wait_for


def get(page, path):
    with urllib.request.urlopen(page.address + path, timeout=60) as reply:
        return reply.read().decode()


def empty(bin_dir, out, folder):
    """Nothing is there yet: no station, no store."""
    page = Page(bin_dir, folder, 1, TOKEN)
    browser = Browser(folder)
    try:
        before = get(page, "/")  # what is seen until the first data come
        check(before.count("Waiting for the station's first data.") == 5 and "No part" not in before and "tokens" not in before, "the page says what it does not know yet")
        load(browser, page)
        check(browser.run("return degreeOf({up: false, trouble: {what: 'waiting', cure: ''}, rows: {}})") == ["note", "Waiting for the station's first data."], "a station that was not asked yet is an alarm")
        headlines(browser)
        wait_for("the table says that there is no store", lambda: "No results are stored yet" in browser.run(TEXT, "search-said"))
        wait_for("the counts say so, too", lambda: "No results are stored yet" in browser.run(TEXT, "counts-said"))
        wait_for("the changes say so, too", lambda: "Nothing is recorded yet" in browser.run(TEXT, "changes"))
        browser.run("document.getElementById('recipe-details').open = true")
        wait_for("so does the reference", lambda: "No recipe is stored yet" in browser.run(TEXT, "reference-words"))
        wait_for("the recipe says so, too", lambda: "No recipe is stored yet" in browser.run(TEXT, "recipe-text"))
        words = browser.run("return document.body.innerText")
        check(str(folder) not in words and "store.sqlite" not in words, "the empty page shows paths of files")
        check(browser.run("return [...document.querySelectorAll('[data-command]')].every((b) => b.disabled)"), "commands are offered to a station that does not answer")
        check("No part" not in words and "No reject" not in words and "last known" not in words, "something is said of a station that has never answered")
        check_console(browser)
        browser.screenshot(out / "empty-1280.png", 1280, 800, False, whole=True)
    finally:
        browser.close()
        page.end()


def headlines(browser):
    """The headline says what the station does, and a warning hides none of it."""
    said = browser.run("""
        const of = (state, more) => {
          const all = { up: true, trouble: { what: "no answer", cure: "look" }, line_stop: false, faults_active: [], rows: { status: { state } }, ...more }, [degree, words] = degreeOf(all);
          return [headlineOf(all, degree), words];
        };
        const fault = { faults_active: [{ name: "dust" }] };
        return [of("ContinuousExecution"), of("SingleExecution", { plc_lost: true }), of("Ready", { plc_lost: true }), of("ContinuousExecution", { results_overrun: true }), of("Ready", fault), of("Ready"),
          of("Error", fault), of("ContinuousExecution", { line_stop: true }), of("ContinuousExecution", { up: false }), of("", { up: false, trouble: { what: "", cure: "" }, rows: {} })];""")
    wanted = [("Inspecting", "Inspecting every part."), ("Inspecting – Warning", "Inspecting one part. The PLC's heartbeat is missing."), ("Ready – Warning", "Ready, but not inspecting. The PLC's heartbeat is missing."),
              ("Inspecting – Warning", "Inspecting every part. The PLC has lost results"), ("Ready – Warning", "Ready, but not inspecting. Fault: dust."), ("Ready – Note", "Ready, but not inspecting."),
              ("Error – Alarm", "Error: the line must stand"), ("LINE STOP – Alarm", "LINE STOP: a bad part may have passed"), ("No answer – Alarm", "no answer. Cure: look."), ("Not known – Note", "Waiting for")]
    for (headline, words), (wanted_headline, wanted_words) in zip(said, wanted, strict=True):
        check(headline == wanted_headline and words.startswith(wanted_words), f"instead of {wanted_headline}, {wanted_words}: {headline}, {words}")


def enabled(browser):
    return set(browser.run("return [...document.querySelectorAll('[data-command]')].filter((b) => !b.disabled).map((b) => b.dataset.command)"))


def give(browser, name):
    """A click on a command, and the confirmation."""
    wait_for(f"{name} is offered", lambda: name in enabled(browser))
    browser.run("document.querySelector(`[data-command='${arguments[0]}']`).click(); document.querySelector('#sure [value=yes]').click()", name)


def give_if_offered(browser, name):
    """The same where the command is offered at this moment; the state may change between two looks."""
    browser.run("const button = document.querySelector(`[data-command='${arguments[0]}']`); if (!button.disabled) { button.click(); document.querySelector('#sure [value=yes]').click(); }", name)


def commands(browser, keeper, out):
    """Halt, reset, bring up: never a dead end."""
    running = lambda: "ContinuousExecution" in browser.run(TEXT, "lamps")
    wait_for("the line runs", running)
    check({"stop", "abort", "halt"} <= enabled(browser) and not {"bring_up", "arm", "reset"} & enabled(browser), f"a running line offers {enabled(browser)}")
    keeper.end()  # its resets would disturb what follows
    browser.run("document.getElementById('token').value = arguments[0]", TOKEN)
    give(browser, "halt")
    wait_for("halted", lambda: "State: Halted" in browser.run(TEXT, "lamps"))
    wait_for("only the reset leads on", lambda: enabled(browser) == {"reset"})
    check("reset" in browser.run(TEXT, "actions-next"), "nobody says what is next")
    browser.screenshot(out / "halted-1280.png", 1280, 800, False)
    # A refusal names the next command, here of a client that does not look at the state.
    answer = browser.run_async("const done = arguments[1]; fetch('/api/command', {method: 'POST', headers: {'Content-Type': 'application/json', Authorization: `Bearer ${arguments[0]}`}, body: '{\"command\":\"start_continuous\"}'}).then((r) => r.json()).then(done)", TOKEN)
    check("next is reset" in answer["cure"] and answer["reason"] == "not_in_this_state", f"refused without a way on: {answer}")
    # Parts that were flushed cannot be ejected any more: that stops the line a moment after the halt, and a reset is
    # refused while a line stop is too new to have been seen. The operator reads "try again in a moment", and does.
    def is_reset():
        if "State: Preoperational" in browser.run(TEXT, "lamps"):
            return True
        if (said := browser.run(TEXT, "actions-said")) not in ("", "reset ..."):
            check(not said.startswith("Refused") or "try again" in said or "next is reset" in said, f"of the reset: {said}")
            give_if_offered(browser, "reset")
            time.sleep(0.5)
        return False
    give(browser, "reset")
    wait_for("reset", is_reset)
    wait_for("the way up is offered", lambda: {"bring_up", "initialise", "halt"} == enabled(browser))
    # Parts were on the line at the halt: the station may find them at its start and stop the line. Then the operator
    # checks, resets and brings it up again.
    def brought_up():
        if running():
            return True  # by "Bring up", or by itself after a reset
        for name in ("reset", "bring_up"):
            give_if_offered(browser, name)
        return False
    wait_for("the line is brought up", brought_up)
    # What was said of a command that failed does not stay when the line runs: "Stopped: the station is Error".
    wait_for("no failure is said of a line that runs", lambda: running() and not re.match("Stopped|Refused|Not sent", browser.run(TEXT, "actions-said")))
    wait_for("nothing is brought up any more", lambda: browser.run("return !bringingUp"))
    browser.run("""
        sayOfCommand("Stopped: the station is Error.", true);
        const real = seen.state, stopped = { ...real, up: true, next: "reset", commands: ["reset"] };
        showCommands(stopped);
        document.documentElement.dataset.whileStopped = document.getElementById("actions-said").textContent;
        showCommands({ ...real, up: true, next: "", commands: ["stop"] });
        document.documentElement.dataset.whenRunning = document.getElementById("actions-said").textContent;
        showCommands(real);
        seen.actions = false;  // a page without tokens has nothing to press: it says where the reset is given
        showCommands(stopped);
        document.documentElement.dataset.readOnly = document.getElementById("actions-none").textContent;
        seen.actions = true;
        showCommands(real);
    """)
    words = browser.run("return document.documentElement.dataset.readOnly")
    check("Next is reset" in words and "hordctl command reset" in words and "page.toml" in words, f"a page that only shows says: {words}")
    said = browser.run("return [document.documentElement.dataset.whileStopped, document.documentElement.dataset.whenRunning]")
    check(said == ["Stopped: the station is Error.", "The line runs again."], f"of the last command: {said}")


def fold(browser, out):
    """1280 by 800: state, verdicts and the last reject are seen without scrolling."""
    wait_for("a reject with its picture", lambda: browser.run("return !document.getElementById('map').hidden"))
    for width, height, name in ((1280, 800, "1280"), (1024, 1366, "tablet"), (420, 900, "phone")):
        browser.screenshot(out / f"{name}.png", width, height, False)
        browser.screenshot(out / f"{name}-whole.png", width, height, width == 1024, whole=True)
        check(browser.run("return document.documentElement.scrollWidth <= innerWidth"), f"wider than {width} pixels")
        check(browser.run("const card = document.getElementById('state-card'); return card.scrollWidth <= card.clientWidth"), f"the state is wider than its card at {width} pixels")
        if width == 1280:
            bottoms = browser.run("return ['state-card', 'strip-card', 'map', 'reject-words'].map((id) => document.getElementById(id).getBoundingClientRect().bottom)")
            check(max(bottoms) <= 800, f"below the fold of 1280 by 800: {bottoms}")
    browser.cdp("Emulation.setDeviceMetricsOverride", width=1280, height=800, deviceScaleFactor=1, mobile=False)


def figures(browser, page, out):
    """Yield, reasons, kinds, shifts; CSV; local time; kinds of the filter."""
    wait_for("yield and reasons", lambda: "%" in browser.run(TEXT, "yield") and browser.run("return document.querySelectorAll('#pareto-reasons .bar').length > 0"))
    wait_for("kinds", lambda: browser.run("return document.querySelectorAll('#pareto-kinds .bar').length > 0"))
    counts = json.loads(get(page, "/api/counts"))
    check(browser.run("return document.querySelectorAll('#shifts tbody tr').length") >= 1, "no line of a shift")
    rows = list(csv.DictReader(io.StringIO(get(page, "/api/results.csv?verdict=reject"))))
    check(rows and all(row["verdict"] == "reject" for row in rows), "the CSV is not what was asked for")
    check(sum(r[4] for r in counts["rows"] if r[2] == "reject") <= len(rows), "the counts and the CSV differ")
    kinds = browser.run("return [...document.querySelector('[name=kind]').options].map((o) => o.value)")
    check(set(kinds) == {"", "scattering", "absorbing", "surface", "scratch", "unknown"}, f"kinds: {kinds}")
    # The search that comes with the page may have been answered before the first result was stored.
    wait_for("results with local time", lambda: browser.run("document.getElementById('search').requestSubmit(); return /Z\\d{4}-.* local/.test(document.querySelector('#found tbody td:nth-child(2)')?.textContent || '')"))
    check("local)" in browser.run(TEXT, "reject-facts"), "the last reject has no local time")
    wait_for("charts", lambda: browser.run("return document.querySelectorAll('.chart svg path.s0').length") == 7)
    drift = browser.run("""
        const figure = document.createElement('figure'), now = Date.now() / 1000, chart = kCharts.find((c) => c.title === 'Lenslet grid');
        drawChart(figure, chart, { fields: ['drift_px', 'residual_px'], rows: [[now - 5, 0.0004, null], [now, 0.0007, null]] }, 900);
        const small = [...figure.querySelectorAll('text[text-anchor=end]')].map((t) => t.textContent);
        drawChart(figure, chart, { fields: ['drift_px', 'residual_px'], rows: [[now, null, null]] }, 900);
        return [small, [...figure.querySelectorAll('svg text')].map((t) => t.textContent)];""")
    check({"0", "0.05", "0.1", "grid-drift fault"} <= set(drift[0]), f"the axis of the drift: {drift[0]}")
    check("no data yet" in drift[1] and "0" not in drift[1], f"the axis without values: {drift[1]}")
    axes = browser.run("return [...document.querySelectorAll('.chart svg')].map((s) => s.querySelectorAll('.label').length)")
    check(axes == [1] * 7, f"axes with a label: {axes}")
    check(browser.run("return document.querySelectorAll('.chart .limit').length") == 2, "the scores and the drift have no limit")
    browser.run("document.querySelector('.chart svg').scrollIntoView({block: 'center'})")
    trend = "return document.querySelector('.chart path.s0')?.getAttribute('d').length || 0"
    before = wait_for("a trend of scores", lambda: browser.run(trend) if browser.run(trend) > 30 else None)
    load(browser, page)  # the trend comes from the store: a browser that was just opened shows it, too
    wait_for("the scores of before", lambda: browser.run(trend) >= before)
    wait_for("a value under the pointer", lambda: re.search(r"\d\d:\d\d:\d\d: mean of passed \S+, highest of passed \S+, highest of others \S+ of its limit", browser.run("const s = document.querySelector('.chart svg'), b = s.getBoundingClientRect(); s.dispatchEvent(new PointerEvent('pointermove', {clientX: b.right - 20, clientY: b.top + 20})); return document.querySelector('.chart .said').textContent")))
    browser.run("document.querySelectorAll('.chart svg')[2].focus()")
    def by_key():
        browser.keys("Left")
        return re.search(r": pass .*, reject .*, unfit .* parts a minute", browser.run("return document.querySelectorAll('.chart .said')[2].textContent"))
    wait_for("a value by the arrow keys", by_key)
    browser.run("document.getElementById('charts-card').scrollIntoView()")


def searches(browser):
    """A refusal stands alone: without rows, link and buttons of the search before it, and no longer than its reason."""
    seen = lambda: browser.run("return [document.getElementById('search-said').textContent, document.querySelectorAll('#found tbody tr').length, document.getElementById('found').hidden, document.getElementById('csv').checkVisibility(), document.getElementById('csv').getAttribute('href')]")
    ask = lambda since: browser.run("const since = document.querySelector('[name=since]'); since.value = arguments[0]; since.dispatchEvent(new Event('input', {bubbles: true})); document.getElementById('search').requestSubmit()", since)
    ask("12h")
    wait_for("results of the last hours", lambda: seen()[1] > 0 and seen()[3:] == [True, "/api/results.csv?since=12h"])
    check_console(browser)
    ask("never")
    wait_for("the refusal alone", lambda: "never" in seen()[0] and seen()[1:] == [0, True, False, None])
    browser.run("document.querySelector('[name=since]').dispatchEvent(new Event('input', {bubbles: true}))")
    check(seen()[0] == "Empty fields do not filter.", f"of a field that is being corrected: {seen()[0]}")
    # The answer to a search that is out of date is not shown, whenever it comes.
    ask("never")
    ask("24h")
    wait_for("the later search", lambda: seen()[1] > 0 and seen()[3:] == [True, "/api/results.csv?since=24h"])
    complaints = [entry["message"] for entry in browser.log() if entry["level"] in ("SEVERE", "WARNING")]
    check(complaints and all("400" in text for text in complaints), f"the console complains: {complaints}")  # of the refusals
    ask("")


def pictures(browser, out):
    """Another map, the light, a defect enlarged."""
    part = wait_for("a part with a defect in the table", lambda: browser.run("document.querySelector('[name=verdict]').value = 'reject'; document.getElementById('search').requestSubmit(); const r = [...document.querySelectorAll('#found tbody tr')].find((r) => r.cells[3].textContent === 'reject' && Number(r.cells[6].textContent) > 0); if (r) r.querySelector('button').click(); return r ? r.cells[0].textContent : null"))
    wait_for(f"the picture of result {part}", lambda: browser.run("const m = document.getElementById('part-map'); return !m.hidden && m.naturalWidth > 0 && document.querySelectorAll('#part-defects button').length > 0"))
    browser.run("document.querySelector('#part-defects button').click()")
    check("scale(" in browser.run("return document.getElementById('part-map').style.transform"), "a defect is not enlarged")
    # Circle and label are inside the frame whole.
    inside = browser.run_async("""
        const image = document.getElementById('part-map'), frame = image.parentElement.getBoundingClientRect(), box = image.getBoundingClientRect(), done = arguments[1];
        ask(`/parts/${arguments[0]}/part.json`).then(({ found }) => {
          const [x, y, w, h] = found.defects[0].mark, scale = box.width / image.naturalWidth;
          const left = box.left + scale * x, top = box.top + scale * y;
          done([left >= frame.left - 1, top >= frame.top - 1, left + scale * w <= frame.right + 1, top + scale * h <= frame.bottom + 1]);
        });""", part)
    check(all(inside), f"the enlarged defect's label is cut: {inside}")
    browser.screenshot(out / "zoom.png", 1280, 800, False)
    browser.run("document.querySelector('#part-defects button').click()")
    check(browser.run("return document.getElementById('part-map').style.transform") == "", "the whole picture does not come back")
    browser.run("document.querySelector('#part-choice [data-map=sums]').click()")
    wait_for("the light", lambda: browser.run("const m = document.getElementById('part-map'); return m.src.endsWith('?map=sums') && m.complete && m.naturalWidth > 0"))
    browser.screenshot(out / "light.png", 1280, 800, False)
    browser.keys("Escape")
    wait_for("maps of the last reject", lambda: browser.run("const b = document.querySelector('#map-choice [data-map=sums]'); if (b) b.click(); return Boolean(b)"))
    wait_for("the light of the last reject", lambda: browser.run("return document.getElementById('map').src.endsWith('?map=sums')"))


def work(bin_dir, out, folder):
    with Line(bin_dir, out, folder) as line:
        browser = line.browser
        browser.cdp("Emulation.setTimezoneOverride", timezoneId="Asia/Kolkata")
        load(browser, line.page)
        fold(browser, out)
        figures(browser, line.page, out)
        searches(browser)
        browser.screenshot(out / "figures-1280.png", 1280, 800, False, whole=True)
        pictures(browser, out)
        check_console(browser)
        commands(browser, line.keeper, out)


def lose_plc(port):
    """A PLC that writes its heartbeat (register 8102) once, and no more."""
    with socket.create_connection(("127.0.0.1", port), timeout=60) as plc:
        plc.sendall(struct.pack(">HHHBBHH", 1, 0, 6, 1, 6, 8102, 1))
        check(plc.recv(12)[7:8] == b"\x06", "the heartbeat is not taken")


def wall(bin_dir, out, folder):
    """Two stations and one that does not answer, side by side."""
    stations = [Station(bin_dir, folder, rate=2, seed=seed, store=f"store-{seed}") for seed in (11, 12)]
    file = folder / "stations.toml"
    file.write_text("".join(f'[[station]]\nname = "Cell {k + 1}"\nmodbus = "127.0.0.1:{port}"\npage = "http://cell{k + 1}.example:8070/"\n' for k, port in enumerate([s.port for s in stations] + [1])))
    configuration = folder / "wall.toml"
    configuration.write_text("[page]\nport = 0\n")
    page = Process(["nice", "-n", "10", f"{bin_dir}/hord-page", "--config", configuration, "--stations", file])
    browser = Browser(folder)
    try:
        address = page.says(r"(http://127\.0\.0\.1:\d+)/ shows 3 stations")[1]
        browser.open(address + "/")
        cell = "return [...document.querySelectorAll('.cell')].map((c) => c.querySelector('h3').textContent + '|' + c.dataset.degree + '|' + c.querySelectorAll('.strip li').length + '|' + (c.querySelector('a')?.href || ''))"
        def seen():
            cells = [text.split("|") for text in browser.run(cell)]
            return cells if len(cells) == 3 and all(int(c[2]) > 0 for c in cells[:2]) and cells[2][1] == "alarm" else None
        cells = wait_for("two stations with parts, and one that is away", seen)
        check([c[0] for c in cells] == ["Cell 1", "Cell 2", "Cell 3"] and cells[1][3] == "http://cell2.example:8070/", f"cells: {cells}")
        check(browser.run("return document.querySelectorAll('.cell')[2].querySelector('.numbers').textContent") == "No answer yet: whether parts came is not known.", "a station that never answered has no parts")
        check("1 alarm" in browser.run(TEXT, "summary") or "2 alarm" in browser.run(TEXT, "summary"), "the summary counts no alarm")
        lose_plc(stations[0].port)
        def warned():
            headline, words = browser.run("return ['degree', 'words'].map((name) => document.querySelector('.cell .' + name).textContent)")
            if "Alarm" in headline:  # a machine that is too slow for real time has stopped the line
                subprocess.run([f"{bin_dir}/hordctl", "command", "reset", "--modbus", f"127.0.0.1:{stations[0].port}"], capture_output=True, check=False)
            return headline == "Inspecting – Warning" and words.startswith("Inspecting every part. The PLC's heartbeat is missing.")
        wait_for("the state beside the warning", warned)
        for width, height, name in ((1280, 800, "wall-1280"), (420, 900, "wall-phone"), (3840, 2160, "wall-4k-dark")):
            check_screen(browser, out / f"{name}.png", width, height, name.endswith("dark"))
        check_console(browser)
    finally:
        browser.close()
        page.end()
        for station in stations:
            station.end()


if __name__ == "__main__":
    main(empty, work, wall)
