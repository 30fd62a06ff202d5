"use strict";
// Shows the active hold of the drone that is shown, and sends commands to it where the station allows that. What the
// hold says is beside HORUS's data: it changes no alarm. The functions for numbers, tables and plots are page.js's.

const HOLD_SHOWN = {
  never: "NEVER RECEIVED: nothing of a hold has arrived from this drone",
  expired: "EXPIRED: these are the last values, not the present ones",
  valid: "present",
};

const COMMAND_STATES = {
  pending: "PENDING: the hold has not acknowledged it yet",
  done: "DONE",
  refused: "REFUSED: the hold's own limits forbid it",
  unknown: "UNKNOWN to this hold",
  "too-old": "TOO OLD when it reached the hold",
  lost: "LOST: it was executed once or not at all",
};

const COMMAND_NAMES = {
  "set-point": "set-point", lock: "lock", unlock: "unlock", "clear-shock": "clear the greatest shock",
};

let holdHistory = [];          // the hold's samples of the drone that is shown
let holdOf = null;             // that drone
let holdClock = -Infinity;     // the station's time of the last state
let notCommanded = null;       // the reason why the station did not send the last command

const finite = (value) => (value === undefined ? null : value);

function keepHold() {
  const drone = state.drone, now = state.now_us / 1000;
  const id = drone ? drone.id : null;
  if (id !== holdOf || now < holdClock - 1) {
    holdOf = id;
    holdHistory = [];
    notCommanded = null;
  }
  holdClock = now;
  if (state.hold_history) {
    // The station's samples fill the time before the page was opened.
    const before = state.hold_history.filter(([at]) => !holdHistory.length || at < holdHistory[0].at);
    holdHistory = before.map(([at, temperature, setPoint, output, vibration]) =>
      ({ at, temperature, setPoint, output, vibration })).concat(holdHistory);
    state.hold_history = null;
  }
  const values = drone && drone.hold.values;
  const last = holdHistory[holdHistory.length - 1];
  if (!values || (last && now - last.at < SAMPLE_MS)) return;
  const present = drone.hold.shown === "valid";
  const known = (value) => (present ? finite(value) : null);
  holdHistory.push({
    at: now, temperature: known(values.temperature), setPoint: known(values.set_point), output: known(values.output),
    vibration: values.vibration.map(known),
  });
  while (holdHistory.length && holdHistory[0].at < now - KEPT_MS) holdHistory.shift();
}

function outputWords(output) {
  if (output === null) return "–";
  const percent = Math.abs(output * 100).toFixed(0) + " %";
  return output > 0 ? "heating, " + percent : output < 0 ? "cooling, " + percent : "off";
}

function drawHold() {
  const section = element("hold-section"), drone = state.drone;
  section.hidden = !drone;
  if (!drone) return;
  const { shown, values, notices, commands, damaged, restarts } = drone.hold;
  // Green is for a hold without a notice, live and now.
  section.dataset.hold = shown === "valid" && !notices.length && !state.playback ? "well" : shown;
  element("hold-known").hidden = !values;
  const age = values ? values.age_ms + since() : 0;
  put("hold-state", HOLD_SHOWN[shown] + (values ? `, ${seconds(age)} old` : ""));
  const list = element("hold-notices");
  if (list.dataset.key !== notices.join()) {
    list.dataset.key = notices.join();
    list.replaceChildren(...notices.map((words) => {
      const line = document.createElement("li");
      line.textContent = "Notice: " + words;
      return line;
    }));
  }
  if (values) {
    const told = ({ number: last, outcome }) => (outcome === "none yet" ? outcome : `number ${last}: ${outcome}`);
    rows("hold", [
      ["Temperature", number(values.temperature, 1, " °C")],
      ["Set-point", number(values.set_point, 1, " °C")],
      ["Output", outputWords(values.output)],
      ["Relative humidity", number(values.humidity, 1, " %")],
      ["Vibration x, y, z", values.vibration.map((axis) => number(axis, 2, "")).join(", ") + " m/s² RMS"],
      ["Greatest shock", number(values.shock, 1, " m/s²")],
      ["Supply", number(values.supply, 2, " V")],
      ["Lock", values.locked ? "locked" : "unlocked"],
      ["Values", values.valid ? "valid" : "NOT VALID", !values.valid],
      ["Within the hold's limits", values.within_limits ? "yes" : "NO", !values.within_limits],
      ["Sensors", values.sensor_fault ? "FAULT" : "no fault", values.sensor_fault],
      ["Hold's memory", values.memory_fault ? "FAULT FOUND" : "no fault found", values.memory_fault],
      ["Safe state", values.safe_state ? "SAFE STATE: the output is off" : "no", values.safe_state],
      ["Hold's last reset", values.reset, values.reset_unasked],
      ["Hold running for", values.seconds + " s"],
      ["Acknowledged to the base station", told(values.acknowledged[0])],
      ["Acknowledged to the flight controller", told(values.acknowledged[1])],
      ["Damaged, restarts", `${damaged}, ${restarts}`, damaged > 0],
      ["Age of this", seconds(age) + (shown === "valid" ? "" : ", EXPIRED"), shown !== "valid"],
    ]);
  }
  drawCommands(shown, commands);
}

function drawCommands(shown, commands) {
  const allowed = state.station.commands;
  if (allowed && !element("hold-form")) makeHoldForm();
  const last = commands[0];
  const pending = last && last.state === "pending";
  if (pending) notCommanded = null;
  if (allowed) {
    for (const button of element("hold-form").querySelectorAll("button")) {
      button.disabled = pending || shown !== "valid";
    }
  }
  const words = ({ name, value }) => COMMAND_NAMES[name] + (value === null ? "" : ` ${value} °C`);
  put("hold-command", notCommanded !== null ? "NOT SENT: " + notCommanded
    : last ? `Command ${last.number}, ${words(last)}: ${COMMAND_STATES[last.state]}` : allowed ? "no command sent" : "");
  element("hold-command").dataset.state = notCommanded !== null ? "lost" : last ? last.state : "";
  rows("hold-commands", commands.map((command) => [
    `Command ${command.number}, ${words(command)}`,
    `${COMMAND_STATES[command.state]}, after ${seconds(command.after_ms)}, given ${seconds(command.ago_ms)} ago`,
    !["pending", "done"].includes(command.state),
  ]));
}

// The buttons exist only where the station allows commands.
function makeHoldForm() {
  element("hold-command").before(element("hold-template").content.cloneNode(true));
  element("hold-form").addEventListener("submit", (event) => {
    event.preventDefault();
    commandHold("set-point", element("hold-set-point").value);
  });
  element("hold-form").querySelectorAll("[data-command]").forEach((button) => {
    button.addEventListener("click", () => commandHold(button.dataset.command));
  });
}

async function commandHold(name, value) {
  if (!state || !state.drone) return;
  const query = new URLSearchParams({ drone: state.drone.id, command: name });
  if (value !== undefined) query.set("value", value);
  try {
    const answer = await fetch("/hold?" + query, { method: "POST" });
    notCommanded = answer.ok ? null : await answer.text();
  } catch {
    notCommanded = "the base station is not reached";
  }
  requestDraw();
}

function drawHoldPlots() {
  if (element("hold-section").hidden || element("hold-known").hidden) return;
  const measured = [(point) => point.temperature, "--r1", "measured"];
  const wanted = [(point) => point.setPoint, "--r2", "set-point"];
  drawPlot("plot-hold-temperature", "Temperature", " °C", [measured, wanted], 2, holdHistory);
  const outputs = [[(point) => point.output, "--r1", "1 heating, −1 cooling"]];
  drawPlot("plot-hold-output", "Output", "", outputs, 0.5, holdHistory);
  drawPlot("plot-hold-vibration", "Vibration", " m/s²", ["x", "y", "z"].map((axis, index) =>
    [(point) => point.vibration[index], "--r" + (index + 1), axis]), 0.5, holdHistory);
}
