// Shows the station's state. All data come from this page's own server: as events, or by polling while there are no events.
"use strict";

const $ = (id) => document.getElementById(id);
const kStripShown = 60;
const seen = { boot: null, reject: null, picture: null, results: new Map(), rejectsNotAnnounced: 0, lastRejectWords: "" };

function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}
// Text that has not changed is not written again: a screen reader would repeat it.
function say(id, text) { if ($(id).textContent !== text) $(id).textContent = text; }
async function ask(address) {
  const reply = await fetch(address, { cache: "no-store" });
  const body = await reply.json();
  if (!reply.ok) throw new Error(body.cure ? `${body.error}: ${body.cure}` : body.error);
  return body;
}
const known = (value) => value !== null && value !== undefined;
const ms = (us) => known(us) ? (us / 1000).toFixed(1) : "–";
function ago(s) {
  if (!known(s)) return "–";
  return s < 120 ? `${s} s` : s < 7200 ? `${Math.round(s / 60)} min` : s < 172800 ? `${Math.round(s / 3600)} h` : `${Math.round(s / 86400)} days`;
}
const round = (value, digits = 3) => known(value) ? Number(value.toFixed(digits)) : null;
function figures(id, rows) {
  const list = $(id);
  if (list.children.length !== rows.length) list.replaceChildren(...rows.map(() => { const row = element("div"); row.append(element("dt"), element("dd")); return row; }));
  rows.forEach(([name, value, unit], k) => {
    const [dt, dd] = list.children[k].children;
    const text = known(value) ? String(value) : "–";
    if (dt.textContent !== name) dt.textContent = name;
    if (dd.dataset.text !== text + unit) { dd.dataset.text = text + unit; dd.replaceChildren(text, ...(unit && known(value) ? [" ", element("small", unit)] : [])); }
  });
}

// -- state and faults ----------------------------------------------------------------------------------------------

const kSigns = {  // shape, letter and word of each severity: colour is never the only sign
  good: ["M24 4a20 20 0 1 0 .01 0z", "✓", "Good"],
  note: ["M24 2 46 24 24 46 2 24z", "i", "Note"],
  warning: ["M24 3 47 45H1z", "!", "Warning"],
  alarm: ["M15 2h18l13 13v18L33 46H15L2 33V15z", "✕", "Alarm"],
};
const kStates = {
  Preoperational: "The devices are not open yet.", Halted: "Halted: devices closed, lights and run permit off.", Error: "Error: the line must stand until somebody has checked it and reset the station.",
  Initialized: "Initialized: devices open, not armed.", Ready: "Ready, but not inspecting.", SingleExecution: "Inspecting one part.", ContinuousExecution: "Inspecting every part.",
};

function degreeOf(state) {
  const name = state.rows.status ? state.rows.status.state : "";
  if (!state.up) return ["alarm", `${state.trouble.what}. ${state.trouble.cure ? "Cure: " + state.trouble.cure + "." : ""}`];
  if (state.line_stop) return ["alarm", "LINE STOP: a bad part may have passed the ejector. Take the parts behind it off the line, then reset."];
  if (name === "Error") return ["alarm", kStates.Error];
  if (state.faults_active.length) return ["warning", `${kStates[name] || name} Fault: ${state.faults_active.map((f) => f.name).join(", ")}.`];
  if (state.plc_lost) return ["warning", "The PLC's heartbeat is missing."];
  if (state.results_overrun) return ["warning", "The PLC has lost results: they were overwritten before it took them."];
  if (name !== "ContinuousExecution" && name !== "SingleExecution") return ["note", kStates[name] || name];
  return ["good", kStates[name]];
}

function showState(state) {
  const [degree, words] = degreeOf(state);
  const [shape, letter, name] = kSigns[degree];
  const card = $("state-card");
  if (card.dataset.degree !== degree) {
    card.dataset.degree = degree;
    $("sign").setAttribute("d", shape);
    $("sign-text").textContent = letter;
    $("sign-text").setAttribute("y", degree === "warning" ? 40 : 33);
  }
  say("degree", name);
  say("state-words", words);
  say("alarm", degree === "alarm" ? `Alarm. ${words}` : "");
  document.title = `${degree === "good" ? "" : name + " – "}HORD station`;
  const lamp = (text, on, bad) => `${text}|${on ? (bad ? "bad" : "on") : ""}`;
  document.documentElement.dataset.up = state.up;
  const lamps = !state.up ? [lamp("Signals: not known", false), lamp("Values below: the last known ones", false)] : [lamp(state.run_permit ? "Run permit: given" : "Run permit: not given", state.run_permit), lamp(state.line_stop ? "LINE STOP" : "No line stop", state.line_stop, true)];
  if (state.simulated) lamps.push(lamp(`SIMULATED: ${state.simulated}`, true, true));
  if (state.plc_lost) lamps.push(lamp("PLC lost", true, true));
  if (state.results_overrun) lamps.push(lamp("Results lost", true, true));
  if (state.up && state.rows.status) lamps.push(lamp(`State: ${state.rows.status.state}`, true), lamp(`${state.rows.status.parts_on_line ?? 0} on the line`, false));
  if ($("lamps").dataset.text !== lamps.join()) {
    $("lamps").dataset.text = lamps.join();
    $("lamps").replaceChildren(...lamps.map((l) => element("li", ...l.split("|"))));
  }
  showFaults(state);
  if (!state.rows.ident) return;
  const r = state.rows, counters = r.counters || {}, health = r.health || {}, calibration = r.calibration || {}, recipe = r.recipe || {};
  say("serial", `${r.ident.serial && r.ident.serial !== "-" ? r.ident.serial + " " : ""}${r.ident.firmware || ""}`);
  figures("counts", [["seen", counters.seen, ""], ["pass", counters.pass, ""], ["reject", counters.reject, ""], ["unfit", counters.unfit, ""], ["passed without a verdict", counters.missed, ""],
    ["rejections confirmed", counters.reject_confirmed, ""], ["not confirmed", counters.reject_failed, ""], ["confirmed too late", counters.reject_late, ""]]);
  figures("times", [["pace", round(health.parts_per_minute, 1), "parts a minute"], ["verdict, median", ms(health.latency_p50), "ms"], ["verdict, 99th percentile", ms(health.latency_p99), "ms"], ["verdict, longest", ms(health.latency_max), "ms"],
    ["rejection, 99th percentile", ms(health.reject_p99), "ms"], ["frames waiting", health.frames_waiting, ""]]);
  figures("health", [["calibration age", calibration.id ? ago(calibration.age) : "no grid file", ""], ["residual", known(calibration.residual) ? calibration.residual.toFixed(3) : null, "px"],
    ["grid drift", known(calibration.drift) ? calibration.drift.toFixed(3) : null, "px"], ["brightest samples", known(state.light_share) ? (100 * state.light_share).toFixed(0) : null, "% of full scale"],
    ["light output", round(health.light_output, 1), "% of the reference or the start"], ["dust on the optics", known(health.dust) ? (health.dust === 0 ? "none" : `${health.dust} at (${health.dust_m}, ${health.dust_n})`) : null, known(health.dust) && health.dust > 0 ? "lenslets" : ""],
    ["frames lost", health.frames_lost, ""], ["frames corrupt", health.frames_corrupt, ""], ["processor", round(health.processor, 1), "°C"], ["disk free", round(health.disk_free, 1), "%"], ["uptime", ago(health.uptime), ""]]);
  figures("recipe", [["number", recipe.number, ""], ["name", recipe.name, ""], ["checksum", known(recipe.crc32) ? (recipe.crc32 >>> 0).toString(16).toUpperCase().padStart(8, "0") : null, ""],
    ["limit: distance of neighbours", round(recipe.staged_emd_limit), "bin pitches"], ["limit: gradient of the deflection", round(recipe.staged_frobenius_limit), "bin pitches a lenslet"], ["limit: transmission", round(recipe.staged_transmission_limit), "of a typical lenslet"],
    ["smallest defect", recipe.staged_min_area, "lenslets"]]);
  if (recipe.crc32 !== seen.recipe) { seen.recipe = recipe.crc32; if ($("recipe-details").open) showRecipe(); }
}

function showFaults(state) {
  const line = (fault, kind) => {
    const item = element("li", undefined, kind === "Active" ? "active" : "");
    item.append(element("strong", `${fault.name} (${kind === "Active" ? "active" : "no longer active, latched until reset"})`), element("div", fault.meaning), element("div", `Cure: ${fault.cure}`), element("code", `journalctl -u hordd -x HORD_FAULT=${fault.name}`));
    return item;
  };
  const text = JSON.stringify([state.up, state.faults_active, state.faults_latched]);
  if ($("faults").dataset.text === text) return;
  $("faults").dataset.text = text;
  const items = [...state.faults_active.map((f) => line(f, "Active")), ...state.faults_latched.map((f) => line(f, "Latched"))];
  $("faults").replaceChildren(...(items.length ? items : [element("li", state.up ? "No fault is active or latched." : "Not known while the station does not answer.", "none")]));
}

// -- verdicts ------------------------------------------------------------------------------------------------------

const kMarks = { pass: "●", reject: "✕", unfit: "?" };

function addToStrip(result) {
  const item = element("li", kMarks[result.verdict] || "·", result.verdict);
  item.dataset.key = result.key;
  item.tabIndex = -1;
  item.setAttribute("aria-label", `Part ${result.part}: ${result.verdict}${result.reason !== "none" ? ", " + result.reason : ""}`);
  item.title = `part ${result.part}, ${result.verdict}, ${result.reason}, ${ms(result.latency_us)} ms`;
  const strip = $("strip");
  strip.append(item);
  while (strip.children.length > kStripShown) {
    const first = strip.firstChild;
    seen.results.delete(first.dataset.key);
    if (first === document.activeElement) strip.children[1].focus();
    first.remove();
  }
  if (!strip.querySelector('[tabindex="0"]')) strip.lastChild.tabIndex = 0;
}

function takeResult(result) {
  if (seen.results.has(result.key)) return;
  seen.results.set(result.key, result);
  addToStrip(result);
  if (result.verdict === "pass") return;
  seen.reject = result;
  seen.rejectsNotAnnounced += 1;
  seen.lastRejectWords = `part ${result.part}, ${result.verdict}, ${result.reason}`;
  showReject(result);
}

// The format of the search below.
function clock(when_ms) {
  return `${new Date(when_ms).toISOString().slice(11, 19)} UTC`;
}

// A score; with "≤" if it may be an upper bound.
function scoreOf(result, digits) {
  return known(result.score) ? (result.bounded ? "≤ " : "") + Number(result.score).toFixed(digits) : null;
}

function factsOf(result) {
  return `Part ${result.part} at ${clock(result.verdict_ms)}, score ${scoreOf(result, 2) ?? "–"} of its limit, verdict after ${ms(result.latency_us)} ms, rejection ${result.reject.replace("_", " ")}.`;
}

// A part that did not pass. Its picture usually came before its result. A part that was not inspected has none: the older
// picture is then dimmed and labelled with its own part number.
function showReject(result) {
  const newest = seen.wanted && seen.wanted.key.slice(0, 8) === result.key.slice(0, 8) ? seen.wanted.part : 0;
  if (result.part < newest) return;  // a later part is shown already
  say("reject-facts", factsOf(result));
  if (result.part === newest) return;
  $("reject-card").dataset.key = result.key;
  $("map").classList.add("earlier");
  say("map-of", seen.picture ? `Picture of the earlier part ${seen.picture.split("-")[1]}. There is none of part ${result.part}.` : "");
  say("reject-words", result.verdict === "unfit" ? `Part ${result.part} could not be judged: ${result.reason}.` : `Part ${result.part}: ${result.reason}.`);
  $("reject-defects").replaceChildren();
  links($("reject-links"), result.key);
}

function links(place, key) {
  const link = (file, text) => { const a = element("a", text); a.href = `/parts/${key}/${file}`; a.download = ""; return a; };
  if (place.dataset.key === key) return;
  place.dataset.key = key;
  place.replaceChildren(link("record.tar", "Full record (archive)"), link("record.json", "Record (JSON)"), link("frame.png", "Frame (PNG)"));
}

const shownOf = (found) => found.defect_count > found.defects.length ? ` ${found.defects.length} of ${found.defect_count} defects shown.` : "";

let drawing = false;
async function showPicture(picture) {
  seen.wanted = picture;
  if (drawing) return;  // the loop below goes on to the newest one
  drawing = true;
  try {
    while (seen.wanted.key !== seen.picture) {
      const { key, part, verdict_ms } = seen.wanted;
      const found = await ask(`/parts/${key}/found.json`);
      const map = new Image();
      map.src = `/parts/${key}/map.png`;
      await map.decode();
      const shown = $("map");
      shown.src = map.src;
      shown.alt = `Feature map of part ${part}. ${found.sentence} ${found.defects.map((d, k) => `${k + 1}: ${d.words} at lenslet ${d.m.toFixed(0)}, ${d.n.toFixed(0)}.`).join(" ")}`;
      shown.width = found.width; shown.height = found.height;
      shown.hidden = false;
      shown.classList.remove("earlier");
      shown.dataset.key = key;
      shown.dataset.verdictMs = verdict_ms;
      shown.dataset.shownAfterMs = Date.now() - verdict_ms;
      seen.picture = key;
      $("reject-card").dataset.key = key;
      say("map-of", `Picture of part ${part}.`);
      say("reject-words", `Part ${part}. ${found.sentence}${shownOf(found)}`);
      $("reject-defects").replaceChildren(...found.defects.map((d) => element("li", `${d.words} at lenslet (${d.m.toFixed(0)}, ${d.n.toFixed(0)})`)));
      links($("reject-links"), key);
      const result = seen.results.get(key);
      say("reject-facts", result ? factsOf(result) : `Part ${part}, verdict at ${clock(verdict_ms)}; it is on its way to the ejector.`);
    }
  } catch (error) {
    say("map-of", `No picture: ${error.message}`);
  } finally {
    drawing = false;
  }
}

setInterval(() => {  // at most every ten seconds, however fast the line is
  if (seen.rejectsNotAnnounced > 0) say("announce", `${seen.rejectsNotAnnounced} rejected; the last: ${seen.lastRejectWords}`);
  seen.rejectsNotAnnounced = 0;
}, 10000);

$("strip").addEventListener("keydown", (event) => {
  const at = document.activeElement, list = $("strip").children;
  const to = { ArrowLeft: at.previousElementSibling, ArrowRight: at.nextElementSibling, Home: list[0], End: list[list.length - 1] }[event.key];
  if (to) { at.tabIndex = -1; to.tabIndex = 0; to.focus(); event.preventDefault(); }
  if (event.key === "Enter" || event.key === " ") { showPart(at.dataset.key); event.preventDefault(); }
});
$("strip").addEventListener("click", (event) => { if (event.target.dataset.key) showPart(event.target.dataset.key); });

// -- one part ------------------------------------------------------------------------------------------------------

async function showPart(key) {
  const map = $("part-map");
  map.hidden = true;
  say("part-title", `Part ${key}`);
  say("part-words", "Loading its record ...");
  $("part-facts").replaceChildren();
  $("part").showModal();
  try {
    const record = await ask(`/parts/${key}/record.json`), r = record.result;
    say("part-title", `Part ${r.part}`);
    figures("part-facts", [["verdict", r.verdict, ""], ["reason", r.reason, ""], ["score", scoreOf(r, 3), "of its limit"], ["time (UTC)", r.time, ""], ["verdict after", ms(r.latency_us), "ms"],
      ["rejection", r.reject, ""], ["recipe", r.recipe, ""], ["number in the store", r.number, ""], ...(r.damage ? [["damaged row", r.damage, ""]] : [])]);
    if (!record.frame) { say("part-words", record.no_frame); return; }
    const found = await ask(`/parts/${key}/found.json`);
    map.alt = `Feature map of part ${found.part}. ${found.sentence}`;
    map.src = `/parts/${key}/map.png`;
    map.hidden = false;
    say("part-words", found.sentence + shownOf(found) + (found.same_as_then ? "" : " (inspected again just now; the result differs from the first inspection)"));
  } catch (error) {
    say("part-words", error.message);
  }
  links($("part-links"), key);
}

// -- search, recipe, changes ---------------------------------------------------------------------------------------

let page = { fields: "", oldest: null };
async function search(before) {
  say("search-said", "Searching ...");
  try {
    const found = await ask(`/api/results?limit=50&${page.fields}${before ? `&before=${before}` : ""}`);
    const rows = found.rows.map((r) => {
      const row = element("tr"), number = element("td"), open = element("button", String(r.number));
      open.type = "button";
      open.setAttribute("aria-label", `Show result ${r.number}`);
      open.addEventListener("click", () => showPart(r.number));
      number.append(open);
      const record = element("td"), a = element("a", "archive");
      a.href = `/parts/${r.number}/record.tar`; a.download = "";
      record.append(a);
      row.append(number, element("td", r.time), element("td", String(r.part)), element("td", r.verdict, r.verdict), element("td", r.damage ? `damaged row: ${r.damage}` : r.reason === "none" ? "" : r.reason), element("td", scoreOf(r, 2) ?? "", "n"),
        element("td", String(r.defect_count ?? ""), "n"), element("td", ms(r.latency_us), "n"), element("td", (r.reject || "").replace("_", " ")), element("td", r.recipe || ""), record);
      return row;
    });
    $("found").tBodies[0].replaceChildren(...rows);
    $("found").hidden = rows.length === 0;
    page.oldest = found.rows.length ? found.rows[found.rows.length - 1].number : null;
    $("older").disabled = !found.more;
    $("newest").disabled = !before;
    say("search-said", rows.length ? `${rows.length} results${found.more ? ", and there are older ones" : ""}.` : "Nothing was found.");
  } catch (error) {
    say("search-said", error.message);
  }
}
$("search").addEventListener("submit", (event) => {
  event.preventDefault();
  page.fields = new URLSearchParams([...new FormData(event.target)].filter(([, value]) => value.trim() !== "").map(([name, value]) => [name, value.trim()])).toString();
  search();
});
$("older").addEventListener("click", () => search(page.oldest));
$("newest").addEventListener("click", () => search());

async function showRecipe() {
  try {
    const recipe = await ask("/api/recipe");
    say("recipe-text", recipe.text);
    say("recipe-who", `In the store since ${recipe.time}${recipe.peer ? ", by " + recipe.peer : ", by the station itself"}.`);
  } catch (error) { say("recipe-text", error.message); }
}
$("recipe-details").addEventListener("toggle", () => { if ($("recipe-details").open) showRecipe(); });

async function showChanges() {
  try {
    const changes = await ask("/api/changes");
    $("changes").tBodies[0].replaceChildren(...changes.rows.map((c) => {
      const row = element("tr");
      row.append(element("td", c.time), element("td", c.what), element("td", c.name), element("td", c.peer || "the station itself"), element("td", c.after ? `${c.before}: ${c.after}` : ""));
      return row;
    }));
  } catch (error) {
    const cell = element("td", error.message), row = element("tr");
    cell.colSpan = 5; row.append(cell);
    $("changes").tBodies[0].replaceChildren(row);
  }
}
$("changes-again").addEventListener("click", showChanges);

// -- charts --------------------------------------------------------------------------------------------------------

let span = "15m";
async function showCharts() {
  if (document.hidden) return;
  try { drawCharts($("charts"), await ask(`/api/history?span=${span}`), span === "24h" ? 86400 : 900); } catch { /* tried again in five seconds */ }
}
document.querySelectorAll("[data-span]").forEach((button) => button.addEventListener("click", () => {
  span = button.dataset.span;
  document.querySelectorAll("[data-span]").forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
  showCharts();
}));
setInterval(showCharts, 5000);

// -- commands ------------------------------------------------------------------------------------------------------

const kWhat = {
  start_continuous: "Start: the station inspects every part, and the run permit is given.", stop: "Stop: the parts on the line are finished, then no part is inspected.",
  reset: "Acknowledge and reset: latched faults are cleared. Only after somebody has checked the line.", self_test: "Self-test: one flash and one frame of the empty line are judged.",
  abort: "Abort: everything on the line is rejected.", halt: "Halt: devices are closed, lights and run permit go off.",
};
async function command(name) {
  say("actions-said", `${name} ...`);
  try {
    const reply = await fetch("/api/command", { method: "POST", headers: { "Content-Type": "application/json", Authorization: `Bearer ${$("token").value}` }, body: JSON.stringify({ command: name }) });
    const body = await reply.json();
    say("actions-said", reply.ok ? `Done: ${body.done}` : `Refused: ${body.error}${body.cure ? ". Cure: " + body.cure : ""}`);
  } catch (error) { say("actions-said", `Not sent: ${error.message}`); }
  setTimeout(showChanges, 500);  // the store writes ten times a second
}
document.querySelectorAll("[data-command]").forEach((button) => button.addEventListener("click", () => {
  if (!$("token").value) { say("actions-said", "Enter your token first."); $("token").focus(); return; }
  say("sure-words", kWhat[button.dataset.command]);
  const sure = $("sure");
  sure.returnValue = "no";
  sure.onclose = () => { if (sure.returnValue === "yes") command(button.dataset.command); };
  sure.showModal();
}));
$("actions").addEventListener("submit", (event) => event.preventDefault());

// -- light and dark ------------------------------------------------------------------------------------------------

const kThemes = ["system", "light", "dark"];
function setTheme(theme) {
  if (theme === "system") delete document.documentElement.dataset.theme; else document.documentElement.dataset.theme = theme;
  say("theme", `Light or dark: ${theme === "system" ? "as the system" : theme}`);
  $("theme").setAttribute("aria-pressed", theme === "system" ? "mixed" : String(theme === "dark"));
  $("theme").dataset.theme = theme;
  try { localStorage.setItem("theme", theme); } catch { /* private windows forget */ }
}
let stored = "system";
try { stored = localStorage.getItem("theme") || "system"; } catch { /* private windows forget */ }
setTheme(kThemes.includes(stored) ? stored : "system");
$("theme").addEventListener("click", () => setTheme(kThemes[(kThemes.indexOf($("theme").dataset.theme) + 1) % kThemes.length]));

// -- connection to this page's server --------------------------------------------------------------------------------

async function loadPage() {
  const all = await ask("/api/page");
  showState(all.state);
  if (all.results.length && seen.boot !== all.results[all.results.length - 1].key.slice(0, 8)) {
    seen.boot = all.results[all.results.length - 1].key.slice(0, 8);
  }
  all.results.slice(-kStripShown).forEach(takeResult);
  seen.rejectsNotAnnounced = 0;
  if (all.picture) showPicture(all.picture);
  const reasons = document.querySelector('[name="reason"]');
  if (reasons.options.length === 1) reasons.append(...all.reasons.map((reason) => element("option", reason)));
  $("actions").hidden = !all.actions;
  $("actions-none").hidden = all.actions;
  say("version", `hord-page ${all.version}`);
  document.documentElement.dataset.loaded = "yes";
}
function follow() {
  const events = new EventSource("/api/events");
  let polling = null;
  const poll = () => loadPage().then(() => say("link", "polling every two seconds")).catch(() => say("link", "This page's server does not answer. The values shown are old."));
  events.addEventListener("page", () => { clearInterval(polling); polling = null; loadPage().then(() => say("link", "live")).catch(() => {}); });
  events.addEventListener("overrun", () => loadPage().catch(() => {}));
  events.addEventListener("state", (event) => showState(JSON.parse(event.data)));
  events.addEventListener("result", (event) => takeResult(JSON.parse(event.data)));
  events.addEventListener("picture", (event) => showPicture(JSON.parse(event.data)));
  events.onerror = () => {
    say("link", "This page's server does not answer. The values shown are old.");
    if (!polling) { polling = setInterval(poll, 2000); poll(); }
    if (events.readyState === EventSource.CLOSED) { events.close(); setTimeout(() => { clearInterval(polling); follow(); }, 15000); }
  };
}

follow();
showCharts();
showChanges();
search();
