// Small charts as SVG, with at most three series of one unit: one labelled axis each. Dashes and colours tell the series
// apart. The pointer, or the arrow keys, show the values of a time; the caption gives the last, lowest and highest value
// of each series, which screen readers read.
"use strict";

const kCharts = [
  { title: "Pace", axis: "parts a minute", series: [["parts_per_minute", "parts"]] },
  { title: "Verdicts", axis: "parts a minute", series: [["pass_per_minute", "pass"], ["reject_per_minute", "reject"], ["unfit_per_minute", "unfit"]] },
  { title: "Part sensor to verdict", axis: "ms", series: [["latency_p50_ms", "median"], ["latency_p99_ms", "99th percentile"]] },
  { title: "Part sensor to confirmed rejection", axis: "ms", series: [["reject_p99_ms", "99th percentile"]] },
  { title: "Lenslet grid", axis: "px", series: [["drift_px", "drift"], ["residual_px", "calibration residual"]], limit: 0.08, limitWords: "grid-drift fault" },
  { title: "Brightest samples of kept frames", axis: "% of full scale", series: [["light_percent", "light"]] },
];
// From the store, by steps of 5 s or 5 minutes: a part at or above its limit does not pass.
const kScoreChart = { title: "Scores against their limit", axis: "score, of its limit", series: [["passed_mean", "mean of passed"], ["passed_highest", "highest of passed"], ["other_highest", "highest of others"]], points: ["other_highest"], limit: 1 };
const kChart = { width: 340, height: 150, left: 52, right: 6, top: 8, bottom: 18 };

function svgElement(name, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

function shortNumber(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  return size >= 100 ? value.toFixed(0) : size >= 10 ? value.toFixed(1) : size >= 1 ? value.toFixed(2) : size === 0 ? "0" : String(Number(value.toPrecision(2)));
}

// A round number at or above `value`.
function roundUp(value) {
  if (!(value > 0)) return 1;
  const power = Math.pow(10, Math.floor(Math.log10(value)));
  for (const step of [1, 1.5, 2, 3, 5, 7.5, 10]) if (step * power >= value * 0.9999) return step * power;
  return 10 * power;
}

const clockOf = (time_s, span_s) => localTime(1000 * time_s).slice(0, span_s > 3600 ? 5 : 8);

// What an axis spans: values with 0, and the limit.
function rangeOf(chart, rows, columns) {
  let low = 0, high = 1.25 * (chart.limit || 0);
  for (const row of rows) for (const k of columns) if (row[k] !== null) { high = Math.max(high, row[k]); low = Math.min(low, row[k]); }
  return [low < 0 ? -roundUp(-low) : 0, roundUp(high)];
}

function drawAxes(svg, chart, low, high, y, from_s, end, span_s, known_values) {
  const { width, height, left, right, top, bottom } = kChart, middle = (low + high) / 2, foot = height - bottom;
  for (const value of [low, middle, high]) {
    svg.append(svgElement("path", { class: "axis", d: `M${left} ${y(value)}H${width - right}` }));
    if (known_values) svg.append(svgElement("text", { x: left - 4, y: y(value) + (value === high ? 8 : 3), "text-anchor": "end" }, shortNumber(value)));
  }
  svg.append(svgElement("path", { class: "axis", d: `M${left} ${top}V${foot}` }));
  svg.append(svgElement("text", { class: "label", transform: `translate(10 ${(top + foot) / 2}) rotate(-90)`, "text-anchor": "middle" }, chart.axis));
  if (chart.limit) {
    svg.append(svgElement("path", { class: "limit", d: `M${left} ${y(chart.limit)}H${width - right}` }));
    svg.append(svgElement("text", { class: "limit-text", x: width - right, y: y(chart.limit) - 3, "text-anchor": "end" }, chart.limitWords || "limit"));
  }
  if (!known_values) { svg.append(svgElement("text", { x: (left + width) / 2, y: foot - 30, "text-anchor": "middle" }, "no data yet")); }
  if (!end) return;
  svg.append(svgElement("text", { x: left, y: height - 4 }, clockOf(from_s, span_s)));
  svg.append(svgElement("text", { x: width - right, y: height - 4, "text-anchor": "end" }, `${clockOf(end, span_s)} local`));
}

// The pointer or an arrow key chooses a row; its values are written below the title.
function addCursor(figure, svg, said, chart, rows, columns, x, span_s) {
  const line = svgElement("path", { class: "cursor", d: "" });
  svg.append(line);
  const show = (k) => {
    if (!rows.length) return;
    figure.at_s = rows[k][0];
    line.setAttribute("d", `M${x(rows[k][0])} ${kChart.top}V${kChart.height - kChart.bottom}`);
    said.textContent = `${clockOf(rows[k][0], span_s)}: ` + columns.map((c, n) => `${chart.series[n][1]} ${shortNumber(rows[k][c])}`).join(", ") + ` ${chart.axis.replace("score, ", "")}`;
  };
  const nearest = (time) => rows.reduce((best, row, k) => Math.abs(row[0] - time) < Math.abs(rows[best][0] - time) ? k : best, 0);
  const hide = () => { figure.at_s = null; line.setAttribute("d", ""); said.textContent = "\u00a0"; };
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect(), at = (event.clientX - box.left) / box.width * kChart.width;
    if (rows.length) show(rows.reduce((best, row, k) => Math.abs(x(row[0]) - at) < Math.abs(x(rows[best][0]) - at) ? k : best, 0));
  });
  svg.addEventListener("pointerleave", hide);
  svg.addEventListener("blur", hide);
  svg.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!step || !rows.length) return;
    event.preventDefault();
    show(figure.at_s ? Math.min(rows.length - 1, Math.max(0, nearest(figure.at_s) + step)) : rows.length - 1);
  });
  if (figure.at_s && rows.length) show(nearest(figure.at_s));  // drawn again while it is looked at
}

function drawChart(figure, chart, history, span_s) {
  const { width, height, left, right, top, bottom } = kChart;
  const end = history.rows.length ? history.rows[history.rows.length - 1][0] : 0;
  const rows = history.rows.filter((row) => row[0] >= end - span_s);
  const columns = chart.series.map(([name]) => history.fields.indexOf(name) + 1);
  const [low, high] = rangeOf(chart, rows, columns);
  const x = (time) => left + (width - left - right) * (1 - (end - time) / span_s);
  const y = (value) => top + (height - top - bottom) * (1 - (value - low) / (high - low));
  const focused = figure.querySelector("svg") === document.activeElement && document.activeElement !== null;
  const svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", tabindex: 0, "aria-label": `${chart.title}, ${chart.axis}; arrow keys show values` });
  drawAxes(svg, chart, low, high, y, end - span_s, end, span_s, rows.some((row) => columns.some((k) => row[k] !== null)));
  const caption = document.createElement("figcaption");
  columns.forEach((k, number) => {
    const points = (chart.points || []).includes(chart.series[number][0]);
    let path = "", pen = false, least = Infinity, most = -Infinity, last = null;
    for (const row of rows) {
      const value = row[k];
      if (value === null) { pen = false; continue; }
      path += `${pen && !points ? "L" : "M"}${x(row[0]).toFixed(1)} ${y(value).toFixed(1)}`;
      if (!pen || points) path += "h0.1";  // a single sample is visible, too
      pen = true;
      least = Math.min(least, value); most = Math.max(most, value); last = value;
    }
    svg.append(svgElement("path", { class: `s${number}${points ? " points" : ""}`, d: path || "M0 0" }));
    const key = document.createElement("i");
    key.className = `k${number}`;
    caption.append(key, last === null ? `${chart.series[number][1]}: not known` : `${chart.series[number][1]} ${shortNumber(last)} (${shortNumber(least)} to ${shortNumber(most)})`);
  });
  const title = element("h3", chart.title), said = element("p", "\u00a0", "said");
  figure.replaceChildren(title, svg, said, caption);
  addCursor(figure, svg, said, chart, rows, columns, x, span_s);
  if (focused) svg.focus({ preventScroll: true });
}

function drawCharts(place, history, scores, span_s) {
  [[kScoreChart, scores], ...kCharts.map((chart) => [chart, history])].forEach(([chart, rows], k) => {
    let figure = place.children[k];
    if (!figure) { figure = document.createElement("figure"); figure.className = "chart"; place.append(figure); }
    drawChart(figure, chart, rows, span_s);
  });
}
