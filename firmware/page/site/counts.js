// Yield, and Pareto charts of reasons and kinds, from the store: by shift and recipe. Shifts are in local time.
"use strict";

let shifts = [], counts = null;

// The start of the shift that holds `when`, and the shift's end.
function shiftAt(when) {
  const starts = [];
  for (const day of [-1, 0, 1]) {
    for (const text of shifts) {
      const [hours, minutes] = text.split(":").map(Number), at = new Date(when);
      at.setDate(at.getDate() + day);
      at.setHours(hours, minutes, 0, 0);
      starts.push(at.getTime());
    }
  }
  starts.sort((a, b) => a - b);
  const next = starts.findIndex((start) => start > when);
  return [starts[next - 1], starts[next]];
}
const hours = (ms) => localTime(ms).slice(0, 5);
const shiftName = ([from, to]) => `${localDate(from)} ${hours(from)}–${hours(to)}`;

function periodChosen() {
  const now = Date.now(), period = $("counts-period").value;
  if (period === "7d") return [0, Infinity];
  if (period === "24h") return [now - 86400000, Infinity];
  const current = shiftAt(now);
  return period === "shift" ? current : shiftAt(current[0] - 1);
}

// [name, parts], the most frequent first.
function tally(rows, nameOf, partsOf) {
  const sums = new Map();
  for (const row of rows) sums.set(nameOf(row), (sums.get(nameOf(row)) || 0) + partsOf(row));
  return [...sums].sort((a, b) => b[1] - a[1]);
}
const percent = (part, all) => all > 0 ? `${(100 * part / all).toFixed(part === all || all < 1000 ? 1 : 2)} %` : "–";

// `cumulative`: each part is counted once.
function pareto(list, rows, all, cumulative) {
  let sum = 0;
  list.replaceChildren(...rows.map(([name, parts]) => {
    const item = element("li"), bar = element("span", undefined, "bar");
    sum += parts;
    bar.style.width = `${100 * parts / rows[0][1]}%`;
    item.append(bar, element("span", `${name}: ${parts} (${percent(parts, all)}${cumulative ? `; together ${percent(sum, all)}` : ""})`));
    return item;
  }));
  if (!rows.length) list.append(element("li", "none", "none"));
}

function drawCounts() {
  if (!counts) return;
  const [from, to] = periodChosen(), recipe = $("counts-recipe").value;
  const inPeriod = (row) => 1000 * row[0] >= from && 1000 * row[0] < to, ofRecipe = (row) => !recipe || row[1] === recipe;
  const rows = counts.rows.filter((row) => inPeriod(row) && ofRecipe(row));
  const of = (chosen, verdict) => chosen.filter((row) => !verdict || row[2] === verdict).reduce((sum, row) => sum + row[4], 0);
  const all = of(rows), bad = all - of(rows, "pass");
  figures("yield", [["yield", percent(of(rows, "pass"), all), ""], ["parts", all, ""], ["reject", of(rows, "reject"), ""], ["unfit", of(rows, "unfit"), ""]]);
  pareto($("pareto-reasons"), tally(rows.filter((row) => row[2] !== "pass"), (row) => row[3], (row) => row[4]), bad, true);
  pareto($("pareto-kinds"), tally(counts.kinds.filter((row) => inPeriod(row) && ofRecipe(row)), (row) => row[2] || "unknown", (row) => row[3]), bad, false);
  // A line a shift and a recipe, the newest first.
  const lines = new Map();
  for (const row of counts.rows.filter(ofRecipe)) {
    const shift = shiftAt(1000 * row[0]), key = `${shift[0]} ${row[1]}`;
    if (!lines.has(key)) lines.set(key, { shift, recipe: row[1], rows: [] });
    lines.get(key).rows.push(row);
  }
  const sorted = [...lines.values()].sort((a, b) => b.shift[0] - a.shift[0] || a.recipe.localeCompare(b.recipe));
  $("shifts").tBodies[0].replaceChildren(...sorted.map((line) => {
    const row = element("tr"), total = of(line.rows);
    row.append(element("td", shiftName(line.shift)), element("td", line.recipe || "not known"), ...[total, of(line.rows, "pass"), of(line.rows, "reject"), of(line.rows, "unfit"), percent(of(line.rows, "pass"), total)].map((value) => element("td", String(value), "n")));
    return row;
  }));
}

async function showCounts() {
  if (document.hidden || !shifts.length) return;
  try {
    counts = await ask(`/api/counts?span=${$("counts-period").value === "7d" ? "7d" : "24h"}`);
    say("counts-said", counts.note || "From the store; shifts are in local time.");
    counts.kinds = counts.kinds || [];
    const choice = $("counts-recipe"), names = [...new Set(counts.rows.map((row) => row[1]).filter(Boolean))].sort();
    for (const name of names) if (![...choice.options].some((option) => option.value === name)) choice.append(element("option", name));
    drawCounts();
  } catch (error) { say("counts-said", error.message); }
}
$("counts-period").addEventListener("change", showCounts);
$("counts-recipe").addEventListener("change", drawCounts);
setInterval(showCounts, 10000);
