// Several stations side by side: one cell each, asked for once a second.
"use strict";

const kWallEvery_ms = 1000, kUnanswered_ms = 5000;
let answered_ms = 0;

function makeCell(station) {
  const cell = element("li", undefined, "card state cell");
  const sign = document.createElementNS("http://www.w3.org/2000/svg", "svg"), path = document.createElementNS("http://www.w3.org/2000/svg", "path"), letter = document.createElementNS("http://www.w3.org/2000/svg", "text");
  sign.setAttribute("viewBox", "0 0 48 48");
  sign.setAttribute("class", "sign");
  sign.setAttribute("aria-hidden", "true");
  letter.setAttribute("x", 24);
  letter.setAttribute("text-anchor", "middle");
  sign.append(path, letter);
  const name = element("h3"), degree = element("p", "", "degree"), words = element("p", "", "words"), numbers = element("p", "", "numbers"), strip = element("ol", undefined, "strip");
  strip.setAttribute("aria-label", `Verdicts of ${station.name}, the newest last`);
  const title = station.page ? element("a", station.name) : element("span", station.name);
  if (station.page) title.href = station.page;
  name.append(title);
  cell.append(sign, name, degree, words, numbers, strip);
  return cell;
}

function setText(place, text) { if (place.textContent !== text) place.textContent = text; }

function showCell(cell, station) {
  const [degree, words] = degreeOf(station.state), [shape, letter] = kSigns[degree];
  cell.dataset.degree = degree;
  cell.querySelector("path").setAttribute("d", shape);
  cell.querySelector("text").setAttribute("y", degree === "warning" ? 40 : 33);
  setText(cell.querySelector("text"), letter);
  setText(cell.querySelector(".degree"), headlineOf(station.state, degree));
  setText(cell.querySelector(".words"), words + (station.state.simulated ? " Simulated devices." : ""));
  const counters = station.state.rows.counters || {}, health = station.state.rows.health || {}, recipe = station.state.rows.recipe || {};
  const all = (counters.pass || 0) + (counters.reject || 0) + (counters.unfit || 0);
  setText(cell.querySelector(".numbers"), !station.state.rows.counters ? "No answer yet: whether parts came is not known." : all === 0 ? "No part since the start." :
    `${known(health.parts_per_minute) ? health.parts_per_minute.toFixed(0) + " parts a minute, y" : "Y"}ield ${(100 * counters.pass / all).toFixed(1)} % of ${all}, ${counters.reject} reject, ${counters.unfit} unfit; recipe ${recipe.name || "not known"}${station.state.up ? "" : " (the last known values)"}`);
  const strip = cell.querySelector(".strip"), text = station.results.map((r) => `${r.part}${r.verdict}`).join();
  if (strip.dataset.text === text) return;
  strip.dataset.text = text;
  strip.replaceChildren(...station.results.map((r) => {
    const item = element("li", kMarks[r.verdict] || "·", r.verdict);
    item.title = `part ${r.part}, ${r.verdict}`;
    item.setAttribute("aria-label", item.title);
    return item;
  }));
}

async function showWall() {
  if (document.hidden) return;
  try {
    const { stations } = await ask("/api/stations");
    const wall = $("wall");
    if (wall.children.length !== stations.length) wall.replaceChildren(...stations.map(makeCell));
    stations.forEach((station, k) => showCell(wall.children[k], station));
    const of = (degree) => stations.filter((station) => degreeOf(station.state)[0] === degree).length;
    say("summary", `${stations.length} stations: ${["good", "note", "warning", "alarm"].filter(of).map((degree) => `${of(degree)} ${kSigns[degree][2].toLowerCase()}`).join(", ")}`);
    document.title = of("alarm") ? `Alarm – HORD stations` : "HORD stations";
    answered_ms = Date.now();
    say("link", "live");
  } catch {
    if (Date.now() - answered_ms > kUnanswered_ms) say("link", "This page's server does not answer. The values shown are old.");
  }
}

showWall();
setInterval(showWall, kWallEvery_ms);
