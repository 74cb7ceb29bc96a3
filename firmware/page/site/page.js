// Shows the station's state. All data come from this page's own server: as events, or by polling while there are no events.
"use strict";

const kStripShown = 60;
const seen = { state: null, map: "", boot: null, reject: null, picture: null, results: new Map(), rejectsNotAnnounced: 0, lastRejectWords: "" };

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

function showState(state) {
  seen.state = state;
  showCommands(state);
  const [degree, words] = degreeOf(state);
  const [shape, letter, name] = kSigns[degree];
  const card = $("state-card");
  if (card.dataset.degree !== degree) {
    card.dataset.degree = degree;
    $("sign").setAttribute("d", shape);
    $("sign-text").textContent = letter;
    $("sign-text").setAttribute("y", degree === "warning" ? 40 : 33);
  }
  say("degree", headlineOf(state, degree));
  say("state-words", words);
  say("alarm", degree === "alarm" ? `Alarm. ${words}` : "");
  document.title = `${degree === "good" ? "" : name + " – "}HORD station`;
  const lamp = (text, on, bad) => `${text}|${on ? (bad ? "bad" : "on") : ""}`;
  document.documentElement.dataset.up = state.up;
  const lamps = !state.up ? [lamp("Signals: not known", false), ...(state.rows.ident ? [lamp("Values below: the last known ones", false)] : [])] : [lamp(state.run_permit ? "Run permit: given" : "Run permit: not given", state.run_permit), lamp(state.line_stop ? "LINE STOP" : "No line stop", state.line_stop, true)];
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
  say("strip-none", "No part has been inspected yet.");
  if (!seen.reject && !seen.wanted) say("reject-words", "No reject has been seen yet.");
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
  if (recipe.crc32 !== seen.recipe) { seen.recipe = recipe.crc32; if ($("recipe-details").open) showRecipe(); setTimeout(showReference, 1000); }  // the store writes it meanwhile
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
  $("strip-none").hidden = true;
  if (page.empty) { page.empty = false; setTimeout(search, 1000); }  // the store begins: it writes ten times a second
  if (result.verdict === "pass") return;
  seen.reject = result;
  seen.rejectsNotAnnounced += 1;
  seen.lastRejectWords = `part ${result.part}, ${result.verdict}, ${result.reason}`;
  showReject(result);
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

// A stored time ("2026-11-21T07:15:00.250Z") for people: UTC, and local where it differs.
function stamp(text) {
  const when = Date.parse(text);
  return Number.isNaN(when) || !kLocal ? text : `${text} (${localDate(when)} ${localTime(when)} local)`;
}

function links(place, key) {
  const link = (file, text) => { const a = element("a", text); a.href = `/parts/${key}/${file}`; a.download = ""; return a; };
  if (place.dataset.key === key) return;
  place.dataset.key = key;
  place.replaceChildren(link("record.tar", "Full record (archive)"), link("record.json", "Record (JSON)"), link("frame.png", "Frame (PNG)"));
}

const shownOf = (found) => found.defect_count > found.defects.length ? ` ${found.defects.length} of ${found.defect_count} defects shown.` : "";

// Where a defect is: in mm where the recipe knows the size of a lenslet, else in lenslets.
const placeOf = (d) => known(d.x_mm) ? `x ${d.x_mm.toFixed(2)} mm, y ${d.y_mm.toFixed(2)} mm` : `lenslet (${d.m.toFixed(0)}, ${d.n.toFixed(0)})`;

// The picture's whole, or a defect enlarged: so far that its circle and its label are seen whole.
const kZoom = 4, kZoomMargin = 4;  // px of the picture
function zoomTo(image, mark) {
  if (!mark) { image.style.transform = ""; return; }
  const [x, y, wide, tall] = mark, W = image.naturalWidth, H = image.naturalHeight;
  const zoom = Math.max(1, Math.min(kZoom, W / (wide + 2 * kZoomMargin), H / (tall + 2 * kZoomMargin)));
  const start = (middle) => Math.min(Math.max(middle - 0.5 / zoom, 0), 1 - 1 / zoom);
  image.style.transform = `translate(${-100 * zoom * start((x + wide / 2) / W)}%, ${-100 * zoom * start((y + tall / 2) / H)}%) scale(${zoom})`;
}
function defectList(list, found, image) {
  zoomTo(image, null);
  list.replaceChildren(...found.defects.map((d, k) => {
    const item = element("li"), button = element("button", `${d.words} at ${placeOf(d)}`, "plain");
    button.type = "button";
    button.title = "Enlarge it in the picture; again: the whole picture";
    button.setAttribute("aria-pressed", "false");
    button.addEventListener("click", () => {
      const on = button.getAttribute("aria-pressed") !== "true";
      for (const other of list.querySelectorAll("button")) other.setAttribute("aria-pressed", "false");
      button.setAttribute("aria-pressed", String(on));
      zoomTo(image, on ? d.mark : null);
      image.dataset.zoomed = on ? String(k + 1) : "";
    });
    item.append(button);
    return item;
  }));
  image.dataset.zoomed = "";
}
const kMapWords = { emd: "Neighbours", slope: "Slope", transmission: "Transmission", "z-score": "Reference", sums: "Light" };
function mapButtons(place, found, choose) {
  place.replaceChildren(...found.maps.map((map) => {
    const button = element("button", kMapWords[map.name] || map.name);
    button.type = "button";
    button.title = map.title;
    button.dataset.map = map.name;
    button.setAttribute("aria-pressed", String(map.name === found.map));
    button.addEventListener("click", () => choose(map.name));
    return button;
  }));
}
function setPicture(image, source, found) {
  image.src = source;
  image.width = found.width; image.height = found.height;
  image.style.setProperty("--ratio", found.width / found.height);
  image.alt = `Map of part ${found.part}. ${found.sentence} ${found.defects.map((d, k) => `${k + 1}: ${d.words} at ${placeOf(d)}.`).join(" ")}`;
  image.hidden = false;
}

let drawing = false;
async function showPicture(picture) {
  seen.wanted = picture;
  if (drawing) return;  // the loop below goes on to the newest one
  drawing = true;
  try {
    while (seen.wanted.key !== seen.picture || seen.map !== seen.mapShown) {
      const { key, part, verdict_ms } = seen.wanted, wantedMap = seen.map, again = key === seen.picture;
      let query = wantedMap ? `?map=${encodeURIComponent(wantedMap)}` : "";
      let found = await ask(`/parts/${key}/found.json`);
      if (query && found.maps.some((m) => m.name === wantedMap)) found = await ask(`/parts/${key}/found.json${query}`);
      else query = "";  // this part's recipe has no such map
      const map = new Image();
      map.src = `/parts/${key}/map.png${query}`;
      await map.decode();
      const shown = $("map");
      setPicture(shown, map.src, found);
      shown.classList.remove("earlier");
      shown.dataset.key = key;
      shown.dataset.verdictMs = verdict_ms;
      if (!again) shown.dataset.shownAfterMs = Date.now() - verdict_ms;
      seen.picture = key;
      seen.mapShown = wantedMap;
      $("reject-card").dataset.key = key;
      say("map-of", `Picture of part ${part}.`);
      say("reject-words", `Part ${part}. ${found.sentence}${shownOf(found)}`);
      defectList($("reject-defects"), found, shown);
      mapButtons($("map-choice"), found, (name) => { seen.map = name; showPicture(seen.wanted); });
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

// Value and unit of a figure.
function timeFigure(when_ms) {
  if (Number.isNaN(when_ms)) return [null, ""];
  const iso = new Date(when_ms).toISOString();
  return [`${iso.slice(11, 19)} UTC`, `${iso.slice(0, 10)}${kLocal ? `; ${localDate(when_ms)} ${localTime(when_ms)} local` : ""}`];
}
async function showPart(key, mapName = "") {
  const map = $("part-map");
  if (!mapName) {
    map.hidden = true;
    say("part-title", String(key).includes("-") ? "Part" : `Result ${key}`);
    say("part-words", "Loading its record ...");
    $("part-facts").replaceChildren();
    $("part-defects").replaceChildren();
    $("part-choice").replaceChildren();
    $("part-links").replaceChildren();
    delete $("part-links").dataset.key;
    if (!$("part").open) $("part").showModal();
  }
  try {
    const { result: stored, no_result, found, no_frame, key: part_key } = await ask(`/parts/${key}/part.json${mapName ? `?map=${encodeURIComponent(mapName)}` : ""}`);
    const r = stored || seen.results.get(String(key));
    if (r) {
      say("part-title", `Part ${r.part}`);
      figures("part-facts", [["verdict", r.verdict, ""], ["reason", r.reason, ""], ["score", scoreOf(r, 3), "of its limit"], ["time", ...timeFigure(r.time ? Date.parse(r.time) : r.verdict_ms)], ["verdict after", ms(r.latency_us), "ms"],
        ["rejection", r.reject, ""], ["recipe", r.recipe, ""], ["number in the store", r.number, ""], ...(r.damage ? [["damaged row", r.damage, ""]] : [])]);
    }
    if (found) {
      setPicture(map, `/parts/${part_key}/map.png${mapName ? `?map=${encodeURIComponent(mapName)}` : ""}`, found);
      say("part-words", found.sentence + shownOf(found) + (found.same_as_then ? "" : " (inspected again just now; the result differs from the first inspection)"));
      await map.decode();
      defectList($("part-defects"), found, map);
      mapButtons($("part-choice"), found, (name) => showPart(key, name));
    } else {
      say("part-words", [no_result, no_frame].filter(Boolean).join(" "));
    }
    if (stored) links($("part-links"), key);
  } catch (error) {
    say("part-words", error.message);
  }
}

// -- search, recipe, changes ---------------------------------------------------------------------------------------

function timeCell(text) {
  const cell = element("td", text), when = Date.parse(text);
  if (kLocal && !Number.isNaN(when)) cell.append(element("small", `${localDate(when)} ${localTime(when)} local`));
  return cell;
}

const kSearchHelp = "Empty fields do not filter.";
let page = { fields: "", oldest: null, search: 0, refused: false, empty: false };
// Beside a refusal, what was found before would be taken for the answer.
function clearFound() {
  $("found").tBodies[0].replaceChildren();
  $("found").hidden = $("csv").hidden = true;
  $("older").disabled = $("newest").disabled = true;
  $("csv").removeAttribute("href");
}
async function search(before) {
  const mine = ++page.search;
  page.refused = page.empty = false;
  $("csv").hidden = true;
  say("search-said", "Searching ...");
  try {
    const found = await ask(`/api/results?limit=50&${page.fields}${before ? `&before=${before}` : ""}`);
    if (mine !== page.search) return;  // a later search was asked meanwhile
    const rows = found.rows.map((r) => {
      const row = element("tr"), number = element("td"), open = element("button", String(r.number));
      open.type = "button";
      open.setAttribute("aria-label", `Show result ${r.number}`);
      open.addEventListener("click", () => showPart(r.number));
      number.append(open);
      const record = element("td"), a = element("a", "archive");
      a.href = `/parts/${r.number}/record.tar`; a.download = "";
      record.append(a);
      row.append(number, timeCell(r.time), element("td", String(r.part)), element("td", r.verdict, r.verdict), element("td", r.damage ? `damaged row: ${r.damage}` : r.reason === "none" ? "" : r.reason), element("td", scoreOf(r, 2) ?? "", "n"),
        element("td", String(r.defect_count ?? ""), "n"), element("td", ms(r.latency_us), "n"), element("td", (r.reject || "").replace("_", " ")), element("td", r.recipe || ""), record);
      return row;
    });
    $("found").tBodies[0].replaceChildren(...rows);
    $("found").hidden = rows.length === 0;
    page.oldest = found.rows.length ? found.rows[found.rows.length - 1].number : null;
    $("older").disabled = !found.more;
    $("newest").disabled = !before;
    say("search-said", rows.length ? `${rows.length} results${found.more ? ", and there are older ones" : ""}.` : found.note || "Nothing was found.");
    page.empty = $("csv").hidden = Boolean(found.note);
    $("csv").href = `/api/results.csv?${page.fields}`;
  } catch (error) {
    if (mine !== page.search) return;
    page.refused = true;
    clearFound();
    say("search-said", error.message);
  }
}
$("search").addEventListener("input", () => { if (page.refused) { page.refused = false; say("search-said", kSearchHelp); } });
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
    if (recipe.note) { say("recipe-text", recipe.note); return; }
    say("recipe-text", recipe.text);
    say("recipe-who", `In the store since ${stamp(recipe.time)}${recipe.peer ? ", by " + recipe.peer : ", by the station itself"}.`);
  } catch (error) { say("recipe-text", error.message); }
}
$("recipe-details").addEventListener("toggle", () => { if ($("recipe-details").open) showRecipe(); });

function sayInChanges(text) {
  const cell = element("td", text), row = element("tr");
  cell.colSpan = 5; row.append(cell);
  $("changes").tBodies[0].replaceChildren(row);
}
async function showChanges() {
  try {
    const changes = await ask("/api/changes");
    $("changes").tBodies[0].replaceChildren(...changes.rows.map((c) => {
      const row = element("tr");
      row.append(timeCell(c.time), element("td", c.what), element("td", c.name), element("td", c.peer || "the station itself"), element("td", c.after ? `${c.before}: ${c.after}` : ""));
      return row;
    }));
    if (changes.note) sayInChanges("Nothing is recorded yet.");
  } catch (error) { sayInChanges(error.message); }
}
$("changes-again").addEventListener("click", showChanges);

// -- charts --------------------------------------------------------------------------------------------------------

let span = "15m";
async function showCharts() {
  if (document.hidden) return;
  try {
    const [history, scores] = await Promise.all([ask(`/api/history?span=${span}`), ask(`/api/scores?span=${span}`).catch(() => ({ rows: [] }))]);
    drawCharts($("charts"), history, { fields: kScoreChart.series.map(([name]) => name), ...scores }, span === "24h" ? 86400 : 900);
  } catch { /* tried again in five seconds */ }
}
document.querySelectorAll("[data-span]").forEach((button) => button.addEventListener("click", () => {
  span = button.dataset.span;
  document.querySelectorAll("[data-span]").forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
  showCharts();
}));
setInterval(showCharts, 5000);

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
  const kinds = document.querySelector('[name="kind"]');
  if (kinds.options.length === 1) kinds.append(...all.kinds.map((kind) => element("option", kind)));
  if (!shifts.length) { shifts = all.shifts; showCounts(); }
  seen.actions = all.actions;
  $("actions").hidden = !all.actions;
  $("actions-none").hidden = all.actions;
  showCommands(all.state);
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
setTimeout(() => { if ($("link").textContent === "connecting") loadPage().then(() => say("link", "no events yet; the page was loaded once")).catch((error) => say("link", error.message)); }, 5000);
showCharts();
showChanges();
showReference();
search();
