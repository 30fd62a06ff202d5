"use strict";
// Shows the possible faults, the present ones, and the boards' logs. It requests them four times a second.

const EVERY_MS = 250;
const LINES = 1000;

// Where there is no server, the page around this one has the bench (bench/web/page).
const request = parent.askPanel || fetch;

const element = (id) => document.getElementById(id);
let next = 0;
let shown = "";

async function command(what) {
  try {
    const answer = await request(what, { method: "POST" });
    element("answer").textContent = answer.ok ? "" : await answer.text();
  } catch {
    element("answer").textContent = "the bench does not answer";
  }
}

function button(words, act) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = words;
  made.addEventListener("click", act);
  return made;
}

async function things() {
  const all = await (await request("/things")).json();
  element("things").replaceChildren(...all.map((thing) => button(thing.words, () => {
    const lasts = thing.how === "lasting" && element("until").checked;
    const long = lasts || thing.how === "once" ? "" : "&seconds=" + element("seconds").value;
    command(`/break?what=${thing.code}${long}`);
  })));
}

function showBroken(broken) {
  const key = JSON.stringify(broken);
  if (key === shown) return;
  shown = key;
  const line = (words, kind) => {
    const made = document.createElement("li");
    made.className = kind;
    made.textContent = words;
    return made;
  };
  element("broken").replaceChildren(...(broken.length ? broken.map((thing) => line(thing.words +
    (thing.until_s === null ? ", until you say so" : `, until ${thing.until_s.toFixed(1)} s`), "broken"))
    : [line("nothing", "none")]));
}

async function look() {
  try {
    const state = await (await request("/state?from=" + next)).json();
    next = state.next;
    element("now").textContent = state.now_s.toFixed(1) + " s";
    showBroken(state.broken);
    if (state.lines.length) {
      const log = element("log");
      const ended = log.scrollTop + log.clientHeight >= log.scrollHeight - 4;
      const lines = state.lines.map(([at, board, text]) => `${at.toFixed(2)} s  ${board.padEnd(5)}  ${text}`);
      log.textContent = log.textContent.split("\n").filter(Boolean).concat(lines).slice(-LINES).join("\n") + "\n";
      if (ended) log.scrollTop = log.scrollHeight;
    }
  } catch {
    element("now").textContent = "the bench does not answer: it has ended";
  }
  setTimeout(look, EVERY_MS);
}

element("well").addEventListener("click", () => command("/well"));
things();
look();
