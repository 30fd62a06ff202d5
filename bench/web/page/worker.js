"use strict";
// Runs the bench and the base station, at the pace of the clock on the wall. The page says which flight it wants; its
// parts then ask for states, for the panel and for the wires.

const BUSY_MS = 30;            // the longest time for which no message is heard
const PUSH_MS = 50;            // the time from one state to the next
const LIST_MS = 500;           // base_station::live::page::LIST
const TELL_MS = 200;           // the time from one report of the pace to the next
const MEASURED_MS = 2000;      // the time over which the pace is measured
const START_MS = 1500;         // so much of the flight, in which the boards start, runs as fast as it can

let wasm = null;
let begun = null;              // resolved when the flight has begun
let said = "";                 // what the program wrote to standard error
let port = null;               // the way to the base station's page
let drone = "";
let fresh = true;              // whether the next state is the first one for the page
let pushed = -Infinity;
let listed = -Infinity;
let told = -Infinity;
let pace = 1;                  // virtual time for each of real time; 0 for as fast as possible
let step = { now_ms: 0, changed: false, outcome: null };
let started = 0;               // the instant of the start of the flight, as if all of it had kept its pace, ms
let ended = 0;
let busy = 0;                  // the time that the steps have taken, ms
let marks = [];                // earlier instants: real time, virtual time, time of the steps, ms
let tardy = 0;                 // the time by which the flight is late for good, ms

// What the program needs of WASI: standard error for the message of a panic, and no files.
const wasi = {
  fd_write(_, vectors, count, written) {
    const memory = new DataView(wasm.memory.buffer);
    let length = 0;
    for (let at = vectors; at < vectors + 8 * count; at += 8) {
      const bytes = new Uint8Array(wasm.memory.buffer, memory.getUint32(at, true), memory.getUint32(at + 4, true));
      said += new TextDecoder().decode(bytes);
      length += bytes.length;
    }
    memory.setUint32(written, length, true);
    return 0;
  },
  environ_sizes_get(count, size) {
    new DataView(wasm.memory.buffer).setUint32(count, 0, true);
    new DataView(wasm.memory.buffer).setUint32(size, 0, true);
    return 0;
  },
  environ_get: () => 0,
  random_get: () => 0,
  proc_exit() { throw new Error("the program has ended"); },
};
const NOT_THERE = 52;          // WASI's ENOSYS
const imports = { wasi_snapshot_preview1: new Proxy(wasi, { get: (all, name) => all[name] || (() => NOT_THERE) }) };

function answer(length) {
  const bytes = new Uint8Array(wasm.memory.buffer, wasm.answer(), Math.abs(length)).slice();
  if (length < 0) throw new Error(new TextDecoder().decode(bytes));
  return bytes;
}

function send(bytes) {
  const at = wasm.room(bytes.length);
  new Uint8Array(wasm.memory.buffer, at, bytes.length).set(bytes);
}

function bytes(request) {
  send(new TextEncoder().encode(JSON.stringify(request)));
  return answer(wasm.ask());
}

const text = (request) => new TextDecoder().decode(bytes(request));
const ask = (request) => JSON.parse(text(request));

async function file(name) {
  const response = await fetch(name);
  if (!response.ok) throw new Error(`${name}: ${response.status} ${response.statusText}`);
  return response;
}

async function begin(flight) {
  const dpr = flight.hold ? "dpr-hold" : "dpr";
  const boards = ["horus", dpr].concat(flight.hold ? ["hold"] : []);
  const images = boards.map(async (board) => new Uint8Array(await (await file(board + ".image")).arrayBuffer()));
  const program = WebAssembly.compileStreaming(file("bench.wasm"));
  wasm = (await WebAssembly.instantiate(await program, imports)).exports;
  for (const [board, image] of (await Promise.all(images)).entries()) {
    send(image);
    answer(wasm.load(board));
  }
  pace = flight.pace;
  ask({ what: "begin", flight, unix_ms: Date.now() });
  turn();
}

// Runs what is due, and then hears messages.
function turn() {
  try {
    const began = performance.now();
    const isStart = () => step.now_ms < START_MS;
    const due = () => (pace === 0 || isStart() ? Infinity : (performance.now() - started) * pace);
    while (!step.outcome && step.now_ms + 10 <= due() && performance.now() - began < BUSY_MS) {
      const before = performance.now();
      step = ask({ what: "step" });
      const now = performance.now();
      busy += now - before;
      if (isStart()) started = now - step.now_ms / (pace || 1);
      if (step.outcome) ended = now;
    }
    // Time that is lost for longer than a blink is not caught up with.
    const late = performance.now() - started - step.now_ms / (pace || 1);
    if (pace && !step.outcome && late > 250) {
      started += late;
      tardy += late;
    }
    push();
    tell();
    setTimeout(turn, step.outcome ? PUSH_MS : pace ? Math.max(0, 10 - late * pace) : 0);
  } catch (error) {
    failed(error);
  }
}

function push() {
  const now = performance.now();
  if (!port || now - pushed < PUSH_MS && !fresh) return;
  pushed = now;
  const list = fresh || now - listed >= LIST_MS;
  if (list) listed = now;
  const after_ms = step.outcome ? Math.round(now - ended) : 0;
  port.postMessage({ what: "state", data: text({ what: "state", drone, list, history: fresh, after_ms }) });
  fresh = false;
}

function tell() {
  const now = performance.now();
  if (now - told < TELL_MS && (!step.outcome || told > ended)) return;
  told = now;
  marks.push([now, step.now_ms, busy]);
  while (marks.length > 2 && marks[1][0] <= now - MEASURED_MS) marks.shift();
  const [[real, virtual, worked]] = marks;
  postMessage({ what: "step", ...step, tardy_ms: tardy,
    pace: (step.now_ms - virtual) / (now - real), speed: (step.now_ms - virtual) / (busy - worked) });
}

function failed(error) {
  postMessage({ what: "failed", why: said.trim() || error.message });
}

function hear({ data }) {
  if (data.what === "look") {
    drone = data.drone;
    fresh = true;
  }
}

onmessage = async ({ data, ports }) => {
  try {
    if (data.what === "begin") {
      [port] = ports;
      port.onmessage = hear;
      begun = begin(data.flight);
    }
    await begun;
    if (data.what === "begin" || !wasm) return;
    const answered = data.what === "wires" ? bytes({ what: "wires" }).buffer : ask(data.request);
    postMessage({ what: "answer", number: data.number, answered });
  } catch (error) {
    failed(error);
  }
};
