// Small line charts as SVG, with at most three series. Dashes and colours tell the series apart. The caption below a
// chart gives the last, lowest and highest value of each series; screen readers read it.
"use strict";

const kCharts = [
  { title: "Pace, parts a minute", unit: "", series: [["parts_per_minute", "parts"]] },
  { title: "Verdicts, parts a minute", unit: "", series: [["pass_per_minute", "pass"], ["reject_per_minute", "reject"], ["unfit_per_minute", "unfit"]] },
  { title: "Latency from part sensor to verdict, ms", unit: "ms", series: [["latency_p50_ms", "median"], ["latency_p99_ms", "99th percentile"]] },
  { title: "Latency from part sensor to confirmed rejection, ms", unit: "ms", series: [["reject_p99_ms", "99th percentile"]] },
  { title: "Lenslet grid, px", unit: "px", series: [["drift_px", "drift"], ["residual_px", "calibration residual"]] },
  { title: "Brightest samples of kept frames, % of full scale", unit: "%", series: [["light_percent", "light"]] },
];

function svgElement(name, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return element;
}

function shortNumber(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  return size >= 100 ? value.toFixed(0) : size >= 10 ? value.toFixed(1) : size >= 1 ? value.toFixed(2) : size === 0 ? "0" : value.toFixed(3);
}

// A round number at or above `value`.
function roundUp(value) {
  if (!(value > 0)) return 1;
  const power = Math.pow(10, Math.floor(Math.log10(value)));
  for (const step of [1, 1.5, 2, 3, 5, 7.5, 10]) if (step * power >= value * 0.9999) return step * power;
  return 10 * power;
}

function drawChart(figure, chart, history, span_s) {
  const width = 320, height = 110, left = 34, right = 4, top = 6, bottom = 16;
  const column = (name) => history.fields.indexOf(name) + 1;
  const columns = chart.series.map(([name]) => column(name));
  let low = 0, high = 0;
  for (const row of history.rows) for (const k of columns) if (row[k] !== null) { high = Math.max(high, row[k]); low = Math.min(low, row[k]); }
  high = roundUp(high);
  if (low < 0) low = -roundUp(-low);
  const end = history.rows.length ? history.rows[history.rows.length - 1][0] : 0;
  const x = (time) => left + (width - left - right) * (1 - (end - time) / span_s);
  const y = (value) => top + (height - top - bottom) * (1 - (value - low) / (high - low));
  const svg = svgElement("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": chart.title });
  svg.append(svgElement("path", { class: "axis", d: `M${left} ${top}V${height - bottom}H${width - right}M${left} ${y(0)}H${width - right}` }));
  svg.append(svgElement("text", { x: left - 4, y: top + 8, "text-anchor": "end" }, shortNumber(high)));
  svg.append(svgElement("text", { x: left - 4, y: height - bottom, "text-anchor": "end" }, shortNumber(low)));
  svg.append(svgElement("text", { x: left, y: height - 3 }, span_s > 3600 ? "24 h ago" : "15 min ago"));
  svg.append(svgElement("text", { x: width - right, y: height - 3, "text-anchor": "end" }, "now"));
  const caption = document.createElement("figcaption");
  columns.forEach((k, number) => {
    let path = "", pen = false, least = Infinity, most = -Infinity, last = null;
    for (const row of history.rows) {
      const value = row[k];
      if (value === null || row[0] < end - span_s) { pen = false; continue; }
      path += `${pen ? "L" : "M"}${x(row[0]).toFixed(1)} ${y(value).toFixed(1)}`;
      if (!pen) path += "h0.1";  // a single sample is visible, too
      pen = true;
      least = Math.min(least, value); most = Math.max(most, value); last = value;
    }
    svg.append(svgElement("path", { class: `s${number}`, d: path || "M0 0" }));
    const key = document.createElement("i");
    key.className = `k${number}`;
    const words = last === null ? `${chart.series[number][1]}: not known` : `${chart.series[number][1]} ${shortNumber(last)} ${chart.unit} (${shortNumber(least)} to ${shortNumber(most)})`;
    caption.append(key, words);
  });
  const title = document.createElement("h3");
  title.textContent = chart.title;
  figure.replaceChildren(title, svg, caption);
}

function drawCharts(place, history, span_s) {
  kCharts.forEach((chart, k) => {
    let figure = place.children[k];
    if (!figure) { figure = document.createElement("figure"); figure.className = "chart"; place.append(figure); }
    drawChart(figure, chart, history, span_s);
  });
}
