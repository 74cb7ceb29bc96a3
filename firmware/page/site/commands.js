// Commands: only those that the station's state allows, and the way from closed devices to a running line.
"use strict";

const kWhat = {
  initialise: "Initialise: the devices are opened.", arm: "Arm: the station is ready to inspect.", disarm: "Disarm: the station is no longer ready to inspect.",
  start_continuous: "Start: the station inspects every part, and the run permit is given.", start_single: "One part: the next part is inspected, and the run permit is given for it.",
  stop: "Stop: the parts on the line are finished, then no part is inspected.",
  reset: "Acknowledge and reset: latched faults are cleared. Only after somebody has checked the line.", self_test: "Self-test: one flash and one frame of the empty line are judged.",
  abort: "Abort: everything on the line is rejected.", halt: "Halt: devices are closed, lights and run permit go off.",
  bring_up: "Bring up: the devices are opened, the station is armed and started, and the run permit is given: the belt may move. Only when nobody is at the line, and no part is left on it: the station rejects what it does not know, and stops the line if it cannot.",
};
const kBringUp = { initialise: "the devices are opened", arm: "the station is armed", start_continuous: "the station is started" };
const kBringUpPatience_ms = 60000;
let bringingUp = false;

// What was said of the last command, and whether it did not succeed. A failure is out of date as soon as the line runs.
let failureSaid = false;
function sayOfCommand(words, failed) {
  failureSaid = failed;
  say("actions-said", words);
}

function showCommands(state) {
  const runs = state.up && !state.next;
  if (runs && failureSaid && !bringingUp) sayOfCommand("The line runs again.", false);
  const allowed = new Set(state.commands || []);
  if (kBringUp[state.next] && !bringingUp) allowed.add("bring_up");
  document.querySelectorAll("[data-command]").forEach((button) => {
    const name = button.dataset.command;
    button.disabled = !allowed.has(name);
    button.classList.toggle("next", name === state.next || (name === "bring_up" && allowed.has(name)));
  });
  const waits = state.devices_down ? ` The station waits for ${state.devices_down}.` : "";
  const next = { reset: "Check the line, then Acknowledge and reset. Bring up comes after it.", initialise: "Next: Bring up (initialise, arm, start), or Initialise alone.", arm: waits ? `Next: Bring up (arm, start).${waits}` : "Next: Bring up (arm, start), or Arm alone.", start_continuous: "Next: Start." }[state.next];
  if (seen.actions === false) say("actions-none", elsewhere(state));
  say("actions-next", !state.up ? "No command is possible: the station does not answer." : next || "The station inspects. It can be stopped.");
}

// A page without tokens has nothing to press: where the next command is given.
function elsewhere(state) {
  const next = state.up && state.next ? `Next is ${state.next}${state.next === "reset" ? ", when somebody has checked the line" : ""}: at the PLC's panel, or at the station with hordctl command ${state.next}. ` : "";
  return `This page only shows. ${next}To allow commands here, name a file of tokens in page.toml.`;
}

// Sends one command: {ok, reason, words}.
async function send(name) {
  try {
    const reply = await fetch("/api/command", { method: "POST", headers: { "Content-Type": "application/json", Authorization: `Bearer ${$("token").value}` }, body: JSON.stringify({ command: name }), signal: AbortSignal.timeout(kPatience_ms) });
    const body = await reply.json();
    return { ok: reply.ok, reason: body.reason || "", words: reply.ok ? `Done: ${body.done}.` : `Refused: ${body.error}${body.cure ? ". " + body.cure : ""}` };
  } catch (error) { return { ok: false, reason: "", words: `Not sent: ${error.message}` }; }
}
async function command(name) {
  sayOfCommand(`${name} ...`, false);
  const answer = await send(name);
  // A refusal while the line runs (a start that is already given) stays.
  const ran = seen.state && seen.state.up && !seen.state.next;
  sayOfCommand(answer.words, !answer.ok && !ran);
  setTimeout(showChanges, 500);  // the store writes ten times a second
}

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

// One command after the other, as the state asks for them; each waits until the station can take it.
async function bringUp() {
  const until = Date.now() + kBringUpPatience_ms;
  bringingUp = true;
  let words = "";
  try {
    while (Date.now() < until) {
      const now = await ask("/api/state"), next = now.next;
      if (!now.up) { words = "Stopped: the station does not answer."; break; }
      if (!next) { words = "Done: the station inspects every part."; break; }
      if (!kBringUp[next]) { words = `Stopped: ${now.possible}.`; break; }
      if (next === "arm" && now.devices_down) {
        sayOfCommand(`Bring up: waits for the devices: ${now.devices_down}.`, false);
        await pause(500);
        continue;
      }
      sayOfCommand(`Bring up: ${kBringUp[next]} ...`, false);
      const answer = await send(next);
      words = `Stopped: ${answer.words}`;
      if (!answer.ok && !["not_yet", "device_down", "not_in_this_state"].includes(answer.reason)) break;
      if (!answer.ok) sayOfCommand(`Bring up: ${next} waits: ${answer.words}`, false);
      await pause(answer.ok ? 300 : 1000);  // the page reads the state ten times a second
    }
    if (Date.now() >= until) words = `Stopped after ${kBringUpPatience_ms / 1000} s. ${words.replace("Stopped: ", "")}`;
  } catch (error) { words = `Stopped: ${error.message}`; }
  bringingUp = false;
  sayOfCommand(words, !words.startsWith("Done"));
  if (seen.state) showCommands(seen.state);
  setTimeout(showChanges, 500);
}

document.querySelectorAll("[data-command]").forEach((button) => button.addEventListener("click", () => {
  if (!$("token").value) { sayOfCommand("Enter your token first.", false); $("token").focus(); return; }
  const name = button.dataset.command;
  say("sure-words", kWhat[name]);
  const sure = $("sure");
  sure.returnValue = "no";
  sure.onclose = () => { if (sure.returnValue === "yes") { if (name === "bring_up") bringUp(); else command(name); } };
  sure.showModal();
}));
$("actions").addEventListener("submit", (event) => event.preventDefault());
