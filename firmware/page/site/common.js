// What the page and the wall of stations share: small helpers, and a station's state in four levels.
"use strict";

const $ = (id) => document.getElementById(id);
function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}
// Text that has not changed is not written again: a screen reader would repeat it.
function say(id, text) { if ($(id).textContent !== text) $(id).textContent = text; }
const kPatience_ms = 15000;  // for an answer of this page's server: nothing says "loading" for ever
async function ask(address) {
  const reply = await fetch(address, { cache: "no-store", signal: AbortSignal.timeout(kPatience_ms) }).catch((error) => {
    throw new Error(error.name === "TimeoutError" ? `This page's server has not answered for ${kPatience_ms / 1000} s.` : "This page's server does not answer.");
  });
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
// A time of the station for people: UTC, and this browser's local time where it differs.
const kLocal = new Date().getTimezoneOffset() !== 0;
function clock(when_ms) {
  const utc = `${new Date(when_ms).toISOString().slice(11, 19)} UTC`;
  return kLocal ? `${utc} (${localTime(when_ms)} local)` : utc;
}
const two = (n) => String(n).padStart(2, "0");
function localTime(when_ms) { const t = new Date(when_ms); return `${two(t.getHours())}:${two(t.getMinutes())}:${two(t.getSeconds())}`; }
function localDate(when_ms) { const t = new Date(when_ms); return `${t.getFullYear()}-${two(t.getMonth() + 1)}-${two(t.getDate())}`; }

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
  if (!state.up && !state.trouble.cure) return ["note", "Waiting for the station's first data."];  // it was not asked yet
  if (!state.up) return ["alarm", `${state.trouble.what}. Cure: ${state.trouble.cure}.`];
  if (state.line_stop) return ["alarm", "LINE STOP: a bad part may have passed the ejector. Take the parts behind it off the line, then reset."];
  if (name === "Error") return ["alarm", kStates.Error];
  if (state.faults_active.length) return ["warning", `${kStates[name] || name} Fault: ${state.faults_active.map((f) => f.name).join(", ")}.`];
  if (state.plc_lost) return ["warning", `${kStates[name] || name} The PLC's heartbeat is missing.`];
  if (state.results_overrun) return ["warning", `${kStates[name] || name} The PLC has lost results: they were overwritten before it took them.`];
  if (name !== "ContinuousExecution" && name !== "SingleExecution") return ["note", kStates[name] || name];
  return ["good", kStates[name]];
}

// The state in one word, with the severity behind it unless all is good.
function headlineOf(state, degree) {
  const name = state.rows.status ? state.rows.status.state : "";
  const word = !state.up ? (state.trouble.cure ? "No answer" : "Not known") : state.line_stop ? "LINE STOP" : name.endsWith("Execution") ? "Inspecting" : name || "Not known";
  return degree === "good" ? word : `${word} – ${kSigns[degree][2]}`;
}

const kMarks = { pass: "●", reject: "✕", unfit: "?" };
