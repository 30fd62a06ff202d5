"use strict";
// Shows the states that the base station pushes. The ages of the last state grow here, so the screen never shows data
// without their present age, whether the drone, the base station or the way between is silent.

const STALE_MS = 400;          // base_station::drone::STALE_US
const OLD_MS = 1000;           // base_station::drone::OLD_US
const FASTEST = 150;           // the highest speed of a drone here, m/s
const NEAR = 10000;            // the distance within which other drones are on the map, m
const LOST_MS = 350;           // the time without a state after which the base station counts as lost
const KEPT_MS = 10 * 60 * 1000;
const SAMPLE_MS = 100;         // the interval of the history
const MAP_POINTS = 6000;

const element = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

let state = null;              // the last state
let heard = -Infinity;         // the instant of its arrival, ms
let ahead = 0;                 // the lead of the station's clock over this page's, ms
let opened = true;             // whether no state has come since the connection was opened: its clock may differ
let staling = 0;               // the timer of the instant at which it will be old
let source = null;
let wanted = new URLSearchParams(location.search).get("drone"); // the selected drone
let listed = 0;                // the instant at which the list of all drones came, ms
let shown = null;              // the drone of the history
let origin = null;             // the map's origin in degrees, and metres per degree
let start = null;              // the drone's first position and height
let history = [];
let clock = -Infinity;         // the station's time of the last state, which shows a playback's jump

function connect() {
  const ask = wanted === null ? "" : wanted;
  // Where there is no server, the station is in a worker, and its states come through a port (bench/web/page).
  if (window.stationPort || window.SharedWorker) {
    if (!source) {
      source = window.stationPort || new SharedWorker("/stream.js").port;
      source.onmessage = ({ data }) => {
        if (data.what === "state") take(data.data);
        else if (data.what === "open") opened = true;
        else lose();
      };
      addEventListener("pagehide", () => source.postMessage({ what: "bye" }));
      addEventListener("pageshow", ({ persisted }) => { if (persisted) connect(); });
      setInterval(() => source.postMessage({ what: "here" }), 2000);
    }
    source.postMessage({ what: "look", drone: ask });
    return;
  }
  if (source) source.close();
  const mine = source = new EventSource("/events?drone=" + encodeURIComponent(ask));
  mine.onmessage = (event) => take(event.data);
  // The station may have been restarted, and its clock begins anew then.
  mine.onopen = () => { opened = true; };
  mine.onerror = () => {
    lose();
    // The browser tries again by itself, unless it was refused.
    if (mine === source && mine.readyState === EventSource.CLOSED) setTimeout(connect, 1000);
  };
}

// The station is lost: the next one may have another clock.
function lose() {
  changes = gone = 0;
}

function take(data) {
  const next = JSON.parse(data);
  // The list of all drones comes less often.
  const now = performance.now();
  if (next.drones) listed = now;
  next.drones = next.drones || (state ? state.drones : []);
  next.log = next.log || (state ? state.log : []);
  state = next;
  // The shown drone stays, also after a reconnection or a reload of the page.
  if (state.drone && wanted === null) {
    want(state.drone.id);
    connect();
  }
  // The offset is taken from the state with the shortest delay, so a delayed state cannot make data look younger. It
  // decays by 1 ms a second, which is more than two clocks drift apart.
  ahead = Math.max(state.now_us / 1000 - now, opened ? -Infinity : ahead - (now - heard) / 1000);
  opened = false;
  heard = now;
  keep();
  keepHold();
  requestDraw();
  // The display changes at the instant at which the data are old, whatever comes.
  clearTimeout(staling);
  const reported = state.drone && state.drone.reported;
  if (reported) staling = setTimeout(drawAge, Math.max(0, STALE_MS - reported.age_ms - since()) + 1);
}

// Stores the selected drone, in the address too.
function want(id) {
  wanted = id;
  const here = new URL(location.href);
  here.searchParams.set("drone", id);
  window.history.replaceState(null, "", here);
}

// The time since the station took the last state, ms. In a playback the station's clock is the recording's.
function since() {
  if (state.playback) return state.playback.speed === 0 ? 0 : performance.now() - heard;
  return performance.now() + ahead - state.now_us / 1000;
}

// ---- history

function metres(latitude) {
  const a = 6378137, e2 = 0.00669437999014;
  const s = Math.sin(latitude * Math.PI / 180);
  const w = Math.sqrt(1 - e2 * s * s);
  const perDegree = Math.PI / 180;
  return {
    north: a * (1 - e2) / (w * w * w) * perDegree,
    east: a / w * Math.cos(latitude * Math.PI / 180) * perDegree,
  };
}

function centre([latitude, longitude]) {
  origin = { latitude, longitude, ...metres(latitude) };
}

function local(position) {
  if (!position || position[0] === null || position[1] === null) return null;
  if (!origin) centre(position);
  let east = position[1] - origin.longitude;
  if (east > 180) east -= 360;
  if (east < -180) east += 360;
  return [east * origin.east, (position[0] - origin.latitude) * origin.north];
}

const apart = (one, other) => Math.hypot(one[0] - other[0], one[1] - other[1]);

function keep() {
  const drone = state.drone;
  const id = drone ? drone.id : null;
  const now = state.now_us / 1000;
  if (id !== shown || now < clock - 1) {
    shown = id;
    history = [];
    origin = start = null;
  }
  clock = now;
  if (state.history) merge(state.history);
  state.history = null;
  const reported = drone && drone.reported;
  if (!reported) return;
  const last = history[history.length - 1];
  if (last && now - last.at < SAMPLE_MS) return;
  const old = reported.age_ms > STALE_MS;
  if (!old && reported.valid) start = start || reported.position;
  history.push({
    at: now,
    voted: !old && reported.valid ? reported.position : null,
    gps: drone.gps.map((gps) => (gps && gps.valid && gps.age_ms <= OLD_MS ? gps.position : null)),
    height: !old && reported.valid ? reported.position[2] : null,
    age: reported.age_ms / 1000,
    agree: old ? null : reported.agree,
  });
  while (history.length && history[0].at < now - KEPT_MS) history.shift();
}

// The station's samples, one a second, fill the times without samples of this page: before it was opened, and while it
// was not connected.
function merge(samples) {
  const own = history;
  const merged = [];
  let next = 0;
  for (const [at, voted, gps, height, age, agree] of samples) {
    while (next < own.length && own[next].at <= at) merged.push(own[next++]);
    const near = (sample) => sample && Math.abs(sample.at - at) < 1000;
    if (near(own[next - 1]) || near(own[next])) continue;
    merged.push({ at, voted, gps, height, age, agree });
  }
  history = merged.concat(own.slice(next));
}

// ---- words and numbers

const number = (value, digits, unit) => (value === null || value === undefined ? "–" : value.toFixed(digits) + unit);
const seconds = (ms) => (ms / 1000).toFixed(ms < 10000 ? 2 : 0) + " s";
const degrees = (value, positive, negative) =>
  value === null ? "–" : Math.abs(value).toFixed(7) + "° " + (value < 0 ? negative : positive);

// The accuracy is shown as the distance between the receivers, because the objects have no figure for it.
function accuracy(drone, voted) {
  if (!drone || !voted) return "–";
  const inside = [], outside = [];
  drone.gps.forEach((gps, index) => {
    const place = gps && gps.valid && gps.age_ms <= OLD_MS ? local(gps.position) : null;
    if (gps && gps.excluded) outside.push("GPS" + (index + 1));
    else if (place) inside.push(apart(place, voted));
  });
  const within = inside.length ? `${inside.length} within ${Math.max(...inside).toFixed(1)} m of it` : "none counts";
  return within + (outside.length ? `, ${outside.join(", ")} excluded` : "");
}

function put(id, text) {
  const target = element(id);
  if (target.textContent !== text) target.textContent = text;
}

function rows(id, lines) {
  const body = element(id);
  while (body.rows.length > lines.length) body.deleteRow(-1);
  lines.forEach(([name, text, bad], index) => {
    const row = body.rows[index] || body.insertRow();
    if (!row.cells.length) {
      const head = document.createElement("th");
      head.scope = "row";
      row.append(head, document.createElement("td"));
    }
    if (row.cells[0].textContent !== name) row.cells[0].textContent = name;
    if (row.cells[1].textContent !== text) row.cells[1].textContent = text;
    row.cells[1].className = bad ? "bad" : "";
  });
}

// The faults of the station itself, each with whether it is critical.
function stationAlarms() {
  const station = state.station;
  const lines = [];
  if (station.recorder) lines.push([true, "nothing is recorded: " + station.recorder]);
  for (const [name, why] of station.lines) lines.push([true, `${name}: ${why}`]);
  if (station.dropped) lines.push([true, `${station.dropped} arrivals dropped: this machine is too slow`]);
  if (station.refused) lines.push([false, `${station.refused} messages of further drones not shown: there is no room`]);
  if (station.forgotten) lines.push([false, `${station.forgotten} silent drones forgotten to make room for others`]);
  return lines;
}

// The worst fault comes first, with its text and colour. Green is only for a drone without faults, live and now.
function drawAge() {
  const silent = performance.now() - heard;
  const drone = state && state.drone;
  const reported = drone && drone.reported;
  const age = reported ? reported.age_ms + since() : null;
  // The text about old data shows their present age.
  const alarms = (drone ? drone.alarms : []).filter((alarm) => alarm.code !== "stale");
  const worst = alarms.find((alarm) => alarm.critical) || alarms[0];
  let kind = "fresh", level = "well", words = state && state.playback ? "as it was recorded" : "live";
  if (silent > LOST_MS) {
    kind = state ? "lost" : "waiting";
    words = state ? "NO CONNECTION TO THE BASE STATION" : "waiting for the base station";
  } else if (!reported) {
    kind = "waiting";
    words = state.drones.length ? "NO POSITION RECEIVED" : "no drone heard yet";
  } else {
    if (age > STALE_MS) kind = "old";
    const told = worst ? [worst.words] : [];
    if (kind === "old") told.push("OLD DATA");
    if (!told.length && stationAlarms().length) told.push("live, but " + stationAlarms()[0][1]);
    if (told.length) words = told.join(" · ");
    if (worst || stationAlarms().length) level = worst && worst.critical ? "critical" : "warning";
  }
  if (kind !== "fresh") level = "critical";
  if (state && state.playback) {
    words = "PLAYBACK · " + words;
    if (level === "well") level = "playback";
  }
  if (document.body.className !== kind) document.body.className = kind;
  if (document.body.dataset.level !== level) document.body.dataset.level = level;
  put("verdict", words);
  put("age-value", age === null ? "–" : seconds(age));
  put("doing", doing(reported));
  const other = worseDrone(drone, kind, worst);
  put("other", other ? `${other.id}: ${other.worst.words}` : "");
  element("other").className = other ? (other.worst.critical ? "critical" : "warning") : "";
  drawTitle(drone, other, level, words);
  drawFleetAges();
}

function doing(reported) {
  if (!reported) {
    const unread = state ? state.station.unread.slice(0, -1).filter(([, count]) => count) : [];
    return state && !state.drones.length && unread.length
      ? "refused: " + unread.map(([words, count]) => `${count} ${words}`).join("; ") : "";
  }
  const away = reported.valid && start ? apart(local(reported.position), local(start)) : null;
  return reported.state + (away === null ? "" : `, ${away.toFixed(0)} m from the start`);
}

// The drone with the worst alarm, if it is worse than that of the shown drone.
function worseDrone(drone, kind, worst) {
  const others = (state ? state.drones : []).filter((other) => other.worst && (!drone || other.id !== drone.id));
  const other = others.reduce((one, next) => (one && one.worst.rank <= next.worst.rank ? one : next), null);
  const lost = kind === "lost" || kind === "waiting";
  const old = kind === "old" ? state.station.stale_rank : Infinity;
  const own = lost ? -1 : Math.min(worst ? worst.rank : Infinity, old);
  return other && other.worst.rank < own ? other : null;
}

// The tab's title shows the worst of all drones, because the shown drone may be the only one without faults.
function drawTitle(drone, other, level, words) {
  const bad = other ? other.worst.critical : level === "critical";
  const mark = bad ? "!! " : other || level === "warning" ? "! " : "";
  const name = drone ? drone.id + ": " : "";
  const title = mark + (other ? `${other.id}: ${other.worst.words} – HORUS` : mark ? `${name}${words} – HORUS`
    : "HORUS " + (drone ? drone.id : ""));
  if (document.title !== title) document.title = title;
}

function drawList() {
  const select = element("drone");
  const ids = state.drones.map((drone) => drone.id);
  const same = select.options.length === ids.length && ids.every((id, index) => select.options[index].value === id);
  if (!same) {
    select.replaceChildren(...ids.map((id) => new Option(id, id)));
  }
  if (state.drone) select.value = state.drone.id;
  element("fleet-section").hidden = ids.length < 2;
  const body = element("fleet");
  while (body.rows.length > ids.length) body.deleteRow(-1);
  state.drones.forEach((drone, index) => {
    const row = body.rows[index] || body.insertRow();
    if (!row.cells.length) {
      const head = document.createElement("th");
      head.scope = "row";
      const button = document.createElement("button");
      button.addEventListener("click", () => look(button.textContent));
      head.append(button);
      row.append(head, ...[1, 2, 3].map(() => document.createElement("td")));
    }
    const own = state.drone && state.drone.id === drone.id;
    row.className = drone.worst ? (drone.worst.critical ? "critical" : "warning") : "well";
    const more = drone.alarms > 1 ? `, and ${drone.alarms - 1} more` : "";
    const worst = drone.worst ? drone.worst.words + more : "well";
    const texts = [drone.id, worst, null, drone.state || "no position received"];
    row.cells[0].firstChild.setAttribute("aria-current", own ? "true" : "false");
    texts.forEach((text, cell) => {
      const target = cell ? row.cells[cell] : row.cells[0].firstChild;
      if (text !== null && target.textContent !== text) target.textContent = text;
    });
  });
}

// The list comes each half second; its ages grow meanwhile.
function drawFleetAges() {
  if (!state) return;
  const passed = state.playback ? 0 : performance.now() - listed;
  state.drones.forEach((drone, index) => {
    const row = element("fleet").rows[index];
    const text = drone.age_ms === null ? "–" : seconds(drone.age_ms + passed);
    if (row && row.cells[2].textContent !== text) row.cells[2].textContent = text;
  });
}

function drawAlarms() {
  const drone = state.drone;
  const lines = stationAlarms();
  for (const alarm of drone ? drone.alarms : []) {
    lines.push([alarm.critical, `${alarm.words}, for ${Math.floor(alarm.since_ms / 1000)} s`]);
  }
  const recording = state.station.recording;
  put("recording", recording === null ? "" : state.station.recorder ? "NOT RECORDING" : `● recording ${recording}`);
  put("signed", drone ? (drone.signed ? "signed" : "not signed") + `, from ${drone.from}` : "");
  const list = element("alarms");
  const key = JSON.stringify(lines);
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...(lines.length ? lines : [[null, "none"]]).map(([critical, words]) => {
    const line = document.createElement("li");
    line.className = critical === null ? "none" : critical ? "critical" : "warning";
    line.textContent = words;
    return line;
  }));
}

// ---- changes of alarms

const SOUND_MS = 3000;         // the time from one sound to the next while a critical alarm is not acknowledged

let acknowledged = null;       // the station's time up to which alarms are acknowledged, ms
let notified = null;           // the station's time up to which alarms were notified, ms
let sounded = -Infinity;       // the instant of the last sound, ms
let sounds = 0;                // the number of sounds
let audio = null;

// The critical alarms of all drones that hold and began after `since`, the newest first.
function critical(since) {
  const over = new Set(), found = [];
  for (const [at, id, words, isCritical, raised] of [...state.log].reverse()) {
    const key = id + ": " + words;
    if (raised && isCritical && !over.has(key) && at > since) found.push({ at, key });
    over.add(key);
  }
  return found;
}

function drawLog() {
  const now = state.now_us / 1000;
  // Alarms from before the page was opened are on the page, without a notification.
  if (acknowledged === null || acknowledged > now) acknowledged = notified = now;
  const waiting = critical(acknowledged);
  const button = element("acknowledge");
  put("acknowledge", waiting.length ? `Acknowledge ${waiting.length}` : "Acknowledge");
  if (button.disabled !== !waiting.length) button.disabled = !waiting.length;
  const unknown = critical(notified);
  if (unknown.length) {
    notified = unknown[0].at;
    if (element("notify").checked && window.Notification && Notification.permission === "granted") {
      new Notification("HORUS: " + unknown[0].key, { tag: "horus-alarm" });
    }
  }
  if (waiting.length && element("sound").checked && performance.now() - sounded > SOUND_MS) sound();
  const list = element("log");
  const lines = [...state.log].reverse().slice(0, 50);
  const key = JSON.stringify(lines);
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...(lines.length ? lines : [null]).map((entry) => {
    const line = document.createElement("li");
    if (!entry) { line.textContent = "none since the station began"; return line; }
    const [at, id, words, isCritical, raised] = entry;
    line.className = raised && isCritical ? "critical" : "";
    line.textContent = `${new Date(at).toLocaleTimeString()} ${id}: ${words}${raised ? "" : " – over"}`;
    return line;
  }));
}

// Three short tones are generated, because the page loads no file.
function sound() {
  sounded = performance.now();
  sounds += 1;
  audio = audio || new AudioContext();
  [0, 0.2, 0.4].forEach((after) => {
    const tone = audio.createOscillator(), level = audio.createGain();
    tone.frequency.value = 880;
    level.gain.value = 0.2;
    tone.connect(level).connect(audio.destination);
    tone.start(audio.currentTime + after);
    tone.stop(audio.currentTime + after + 0.12);
  });
}

function acknowledge() {
  if (!state || acknowledged === null || !critical(acknowledged).length) return;
  acknowledged = state.now_us / 1000;
  put("acknowledged", "acknowledged");
  requestDraw();
}

// The drone after the shown one, or the one with the worst alarm.
function shift(by) {
  const ids = state.drones.map((drone) => drone.id);
  if (state.drone && ids.length > 1) look(ids[(ids.indexOf(state.drone.id) + by + ids.length) % ids.length]);
}

function worstDrone() {
  const rank = (drone) => (drone.worst ? drone.worst.rank : Infinity);
  const worst = state.drones.reduce((one, next) => (one && rank(one) <= rank(next) ? one : next), null);
  if (worst) look(worst.id);
}

// The speed over the last two seconds, m/s.
function speed() {
  const last = history[history.length - 1];
  const before = last && history.findLast((point) => point.at <= last.at - 2000);
  if (!last || !last.voted || !before || !before.voted || last.at - before.at > 4000) return null;
  return apart(local(last.voted), local(before.voted)) / (last.at - before.at) * 1000;
}

function drawNumbers() {
  const drone = state.drone;
  const reported = drone && drone.reported;
  const valid = reported && reported.valid;
  put("latitude", valid ? degrees(reported.position[0], "N", "S") : "–");
  put("longitude", valid ? degrees(reported.position[1], "E", "W") : "–");
  put("height", valid ? number(reported.position[2], 1, " m") : "–");
  const above = valid && start ? reported.position[2] - start[2] : NaN;
  put("above", Number.isFinite(above) && reported.position[2] !== null ? number(above, 1, " m") : "–");
  put("speed-value", valid ? number(speed(), 1, " m/s") : "–");
  put("clock", new Date(state.now_us / 1000).toLocaleString(undefined, { timeZoneName: "short" }));
  const turned = reported && reported.attitude;
  put("attitude", turned
    ? `${turned[0].toFixed(1)}°, ${turned[2].toFixed(1)}°, ${((turned[1] % 360 + 360) % 360).toFixed(1)}°` : "–");
  put("agree", reported ? `${reported.agree} of ${drone.receivers}${reported.degraded ? ", degraded" : ""}` : "–");
  put("accuracy", accuracy(drone, valid ? local(reported.position) : null));
  rows("itself", reported ? [
    ["HORUS's last reset", reported.reset, !reported.reset_usual],
    ["HORUS's memory", reported.memory_fault ? "FAULT FOUND" : "no fault found", reported.memory_fault],
  ] : []);
  put("time", drone && drone.time_ms !== null ? (drone.time_ms / 1000).toFixed(1) + " s" : "–");

  const body = element("receivers");
  const receivers = drone ? drone.gps : [];
  while (body.rows.length > receivers.length) body.deleteRow(-1);
  receivers.forEach((gps, index) => {
    const row = body.rows[index] || body.insertRow();
    while (row.cells.length < 6) row.insertCell();
    const old = gps && gps.age_ms > OLD_MS;
    const here = gps && gps.valid && !old ? local(gps.position) : null;
    const there = valid ? local(reported.position) : null;
    const notes = gps ? [old && "OLD DATA", gps.fix, !gps.valid && "no position", !gps.heard && "silent",
      gps.stale && "stale", gps.excluded && "EXCLUDED"].filter(Boolean).join(", ") : "not received";
    const texts = ["GPS" + (index + 1), notes,
      here && there ? apart(here, there).toFixed(1) + " m" : "–",
      gps && gps.valid ? number(gps.position[2], 1, " m") : "–", gps ? seconds(gps.age_ms) : "–",
      gps ? gps.solution : "–"];
    texts.forEach((text, cell) => {
      if (row.cells[cell].textContent !== text) row.cells[cell].textContent = text;
    });
    row.cells[1].className = !gps || old || gps.excluded || !gps.valid || !gps.heard ? "bad" : "";
    row.cells[4].className = old ? "bad" : "";
  });

  const link = drone && drone.link;
  const oldLink = link && link.age_ms > OLD_MS;
  rows("link", link ? [
    ["State", (oldLink ? "not known, was " : "") + (link.up ? "up" : "DOWN"), !link.up || oldLink],
    ["Age of the sample at the DPR", link.sample_age_ms.toFixed(1) + " ms"],
    ["Frames received, missed", `${link.received}, ${link.missed}`],
    ["Objects accepted, rejected", `${link.accepted}, ${link.rejected}`],
    ["Access violations", String(link.violations), link.violations > 0],
    ["DPR's last reset", link.reset],
    ["Age of this", seconds(link.age_ms) + (oldLink ? ", OLD DATA" : ""), oldLink],
  ] : [["Link-Status", "not received", true]]);
  const counts = drone && drone.counts;
  const refused = state.station.unread.filter(([, count]) => count);
  const unread = refused.map(([words, count]) => ["Refused: " + words, String(count), !words.startsWith("other")]);
  if (!unread.length) unread.push(["Refused unread", "0"]);
  rows("counts", [...counts ? [
    ["Messages", String(counts.messages)],
    ["Objects shown", String(counts.shown)],
    ["Bad CRC", String(counts.bad_crc), counts.bad_crc > 0],
    ["In another's place", String(counts.misplaced), counts.misplaced > 0],
    ["Vacant", String(counts.vacant)],
    ["Duplicates, older", `${counts.duplicate}, ${counts.older}`],
    ["Out of sequence", String(counts.out_of_sequence)],
    ["Cycles not forwarded, or lost", String(counts.missed)],
    ["Restarts of HORUS", String(counts.restarts)],
  ] : [], ...unread]);
}

// ---- uplink

const UPLINK = {
  sent: "SENT, not known yet whether the DPR has it",
  written: "WRITTEN: the DPR shows it",
  refused: "REFUSED by the DPR",
  unanswered: "NOT ANSWERED: it is not known whether the DPR has it",
};

let refused = null;            // the reason why the station did not send the last one

function drawUplink() {
  const section = element("uplink-section"), drone = state.drone;
  section.hidden = !state.station.uplinks || !drone;
  if (section.hidden) return;
  const uplink = drone.uplink, port = drone.port;
  const words = refused !== null ? "NOT SENT: " + refused : !uplink ? "none sent"
    : UPLINK[uplink.state] + (uplink.why ? ": " + uplink.why : "");
  put("uplink-state", words);
  section.dataset.uplink = refused !== null ? "refused" : uplink ? uplink.state : "";
  const answer = port && [
    ["Uplinks that the DPR has stored", String(port.stored)],
    ["Access violations by kind, together", String(port.violations), port.last_refused],
    ["Age of Port-Status", seconds(port.age_ms)],
  ];
  rows("uplink", [...uplink ? [
    ["Sent", `${seconds(uplink.ago_ms)} ago, ${uplink.times} times`],
    ["Known after", uplink.state === "sent" ? "–" : seconds(uplink.after_ms)],
    ["Timestamp, status", `${uplink.timestamp}, ${uplink.status}`],
    ["Payload", uplink.payload.replace(/(00)+$/, "") || "00"],
  ] : [], ...answer || []]);
}

async function sendUplink(event) {
  event.preventDefault();
  if (!state || !state.drone) return;
  const query = new URLSearchParams({
    drone: state.drone.id, payload: element("uplink-payload").value, status: element("uplink-status").value || "0",
  });
  try {
    const answer = await fetch("/uplink?" + query, { method: "POST" });
    refused = answer.ok ? null : await answer.text();
  } catch {
    refused = "the base station is not reached";
  }
  requestDraw();
}

// ---- pictures, drawn here: a library for plots is larger than the whole page, which loads nothing from elsewhere

function prepare(canvas) {
  const scale = window.devicePixelRatio || 1;
  const { width, height } = canvas.getBoundingClientRect();
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const to = canvas.getContext("2d");
  to.setTransform(scale, 0, 0, scale, 0, 0);
  to.clearRect(0, 0, width, height);
  to.font = "13px system-ui, sans-serif";
  return [to, width, height];
}

// The largest of 1, 2, 5 times a power of ten that is at most `most`.
function round(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].map((factor) => factor * power).find((step) => step <= most);
}

const receiverColour = (index) => colour("--r" + (index + 1));

// The positions that set the scale: an outlier that is left again within a moment, faster than any drone flies, is
// excluded.
function steady(points) {
  const runs = [[]];
  for (const { at, voted } of points) {
    const place = local(voted);
    if (!place) continue;
    const run = runs[runs.length - 1], last = run[run.length - 1];
    const jumped = last && apart(last.place, place) > 50 + FASTEST * (at - last.at) / 1000;
    if (jumped) runs.push([{ at, place }]); else run.push({ at, place });
  }
  const long = runs.filter((run) => run.length > 2);
  return (long.length ? long : runs).flat().map((point) => point.place);
}

function drawMap() {
  const [to, width, height] = prepare(element("map"));
  const points = history.slice(-MAP_POINTS);
  const newest = points.findLast((point) => point.voted);
  if (newest) centre(newest.voted);
  // The scale covers the voted position, the receivers now, and near drones: a receiver that was a kilometre off a
  // while ago does not shrink the map.
  const here = newest ? local(newest.voted) : [0, 0];
  const others = state.drones.filter((drone) => drone.place && (!state.drone || drone.id !== state.drone.id))
    .map((drone) => ({ ...drone, place: local(drone.place) })).filter(({ place }) => apart(place, here) < NEAR);
  const now = (points[points.length - 1]?.gps || []).map(local).filter((place) => place && apart(place, here) < NEAR);
  const all = [...steady(points), ...now, ...others.map((drone) => drone.place)];
  if (!all.length) {
    to.fillStyle = colour("--soft");
    to.fillText("no position yet", 12, 24);
    return;
  }
  let [left, right, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const [x, y] of all) {
    left = Math.min(left, x); right = Math.max(right, x);
    low = Math.min(low, y); high = Math.max(high, y);
  }
  const span = Math.max((right - left) / width, (high - low) / height, 20 / Math.min(width, height)) * 1.15;
  const [middleX, middleY] = [(left + right) / 2, (low + high) / 2];
  const at = ([x, y]) => [width / 2 + (x - middleX) / span, height / 2 - (y - middleY) / span];

  const step = round(span * 120);
  to.strokeStyle = colour("--line");
  to.lineWidth = 1;
  to.beginPath();
  for (let x = Math.ceil((middleX - span * width / 2) / step) * step; x < middleX + span * width / 2; x += step) {
    const [px] = at([x, 0]);
    to.moveTo(px, 0); to.lineTo(px, height);
  }
  for (let y = Math.ceil((middleY - span * height / 2) / step) * step; y < middleY + span * height / 2; y += step) {
    const [, py] = at([0, y]);
    to.moveTo(0, py); to.lineTo(width, py);
  }
  to.stroke();

  const line = (pick, stroke, thick) => {
    to.strokeStyle = stroke;
    to.lineWidth = thick;
    to.beginPath();
    let on = false;
    for (const point of points) {
      const place = local(pick(point));
      if (!place) { on = false; continue; }
      const [px, py] = at(place);
      if (on) to.lineTo(px, py); else to.moveTo(px, py);
      on = true;
    }
    to.stroke();
  };
  const receivers = state.drone ? state.drone.gps : [];
  receivers.forEach((_, index) => line((point) => point.gps[index] || null, receiverColour(index), 1));
  line((point) => point.voted, colour("--voted"), 2.5);

  const raw = points[points.length - 1];
  const last = { voted: local(raw && raw.voted), gps: raw ? raw.gps.map(local) : [] };
  receivers.forEach((gps, index) => {
    if (!last.gps[index]) return;
    const [px, py] = at(last.gps[index]);
    to.strokeStyle = receiverColour(index);
    to.lineWidth = 2;
    to.beginPath();
    to.arc(px, py, 6, 0, 2 * Math.PI);
    if (gps && gps.excluded) { to.moveTo(px - 6, py - 6); to.lineTo(px + 6, py + 6); }
    to.stroke();
    to.fillStyle = receiverColour(index);
    const off = gps && gps.excluded && last.voted ? ` excluded, ${apart(last.gps[index], last.voted).toFixed(0)} m off` : "";
    to.fillText((index + 1) + off, px + 8, py - 6 - 13 * (off ? 0 : index % 2));
  });
  // The distance of each receiver that is not excluded from the voted position.
  const spread = last.voted ? Math.max(...receivers.map((gps, index) =>
    (gps && !gps.excluded && last.gps[index] ? apart(last.gps[index], last.voted) : 0))) : 0;
  if (spread / span > 3) {
    const [px, py] = at(last.voted);
    to.strokeStyle = colour("--soft");
    to.lineWidth = 1;
    to.setLineDash([4, 3]);
    to.beginPath();
    to.arc(px, py, spread / span, 0, 2 * Math.PI);
    to.stroke();
    to.setLineDash([]);
  }
  if (last.voted) {
    const [px, py] = at(last.voted);
    // A HORUS that has just restarted has reported nothing yet; its last place is still on the map.
    const turned = state.drone.reported && state.drone.reported.attitude;
    to.fillStyle = colour("--voted");
    to.beginPath();
    if (turned) {
      const yaw = turned[1] * Math.PI / 180;
      const tip = (angle, far) => [px + far * Math.sin(yaw + angle), py - far * Math.cos(yaw + angle)];
      to.moveTo(...tip(0, 13)); to.lineTo(...tip(2.5, 9)); to.lineTo(...tip(Math.PI, 4)); to.lineTo(...tip(-2.5, 9));
    } else {
      to.arc(px, py, 5, 0, 2 * Math.PI);
    }
    to.fill();
  }
  // The last known position, if the present one is unknown.
  if (!last.voted && newest) {
    const [px, py] = at(local(newest.voted));
    to.strokeStyle = colour("--bad");
    to.lineWidth = 3;
    to.strokeRect(px - 8, py - 8, 16, 16);
  }
  for (const drone of others) {
    const [px, py] = at(drone.place);
    to.fillStyle = colour(drone.worst ? (drone.worst.critical ? "--bad" : "--warn") : "--ink");
    to.fillRect(px - 4, py - 4, 8, 8);
    to.fillText(drone.id, px + 8, py + 4);
  }
  to.fillStyle = colour("--ink");
  to.fillRect(12, height - 16, step / span, 3);
  to.fillText(`${step} m`, 12, height - 22);
  to.fillText("N ↑", width - 32, 20);
  const voted = steady(points);
  const range = (axis) => {
    const values = voted.map((place) => place[axis]);
    return `${(Math.max(...values) - Math.min(...values)).toFixed(0)} m`;
  };
  const flown = voted.length ? `${range(0)} from west to east, ${range(1)} from south to north` : "nothing voted";
  describe("map", `The track: ${flown}; the tables have the numbers`);
  drawLegend([["voted", colour("--voted")], ...receivers.map((gps, index) =>
    [`${index + 1}: GPS${index + 1}${gps && gps.excluded ? " (excluded)" : ""}`, receiverColour(index)])]);
}

function drawLegend(entries) {
  const legend = element("legend");
  const key = JSON.stringify(entries);
  if (legend.dataset.key === key) return;
  legend.dataset.key = key;
  legend.replaceChildren(...entries.map(([words, stroke]) => {
    const entry = document.createElement("span");
    entry.textContent = "━ " + words;
    entry.style.color = stroke;
    return entry;
  }));
}

// A picture's text for a screen reader.
function describe(id, words) {
  const canvas = element(id);
  if (canvas.getAttribute("aria-label") !== words) canvas.setAttribute("aria-label", words);
}

// Draws one line for each of `lines`: a function from a sample to a value, a colour, and a name if there are several.
function drawPlot(id, title, unit, lines, atLeast, history) {
  const [to, width, height] = prepare(element(id));
  const values = history.flatMap((point) => lines.map(([pick]) => pick(point))).filter((value) => value !== null);
  to.fillStyle = colour("--soft");
  if (!values.length) { to.fillText(title, 8, 16); return; }
  let low = Math.min(...values), high = Math.max(...values);
  if (high - low < atLeast) { const middle = (high + low) / 2; low = middle - atLeast / 2; high = middle + atLeast / 2; }
  // A quantity that cannot be negative has no negative part of an axis.
  if (low < 0 && values.every((value) => value >= 0)) { high -= low; low = 0; }
  const end = history[history.length - 1].at;
  const long = Math.max(60000, end - history[0].at);
  // The lines lie between the axes; their numbers are beside and below.
  const [left, top, bottom] = [52, 24, 18];
  const x = (at) => width - 8 - (end - at) / long * (width - 8 - left);
  const y = (value) => height - bottom - (value - low) / (high - low) * (height - bottom - top);
  const span = `last ${Math.round(long / 1000)} s`;
  const head = `${title}${unit ? "," + unit : ""}`;
  to.fillText(head, 8, 14);
  let beside = 8 + to.measureText(head).width + 12;
  for (const [, stroke, name] of lines.filter((line) => line[2])) {
    to.fillStyle = colour(stroke);
    to.fillText("━ " + name, beside, 14);
    beside += to.measureText("━ " + name).width + 12;
  }
  to.fillStyle = colour("--soft");
  describe(id, `${title}: ${Math.min(...values).toFixed(1)} to ${Math.max(...values).toFixed(1)}${unit}, ${span}`);
  to.strokeStyle = colour("--line");
  to.lineWidth = 1;
  to.beginPath();
  to.textAlign = "right";
  for (const value of [low, (low + high) / 2, high]) {
    to.moveTo(left, y(value)); to.lineTo(width - 8, y(value));
    to.fillText(value.toFixed(high - low < 4 ? 1 : 0), left - 4, y(value) + 4);
  }
  const tick = [10, 30, 60, 120, 300].find((seconds) => long / 1000 / seconds <= width / 90) || 600;
  to.textAlign = "center";
  for (let back = 0; back <= long / 1000; back += tick) {
    const px = x(end - back * 1000);
    to.moveTo(px, top); to.lineTo(px, height - bottom);
    to.fillText(back ? `−${back} s` : "now", Math.min(Math.max(px, left + 24), width - 22), height - 4);
  }
  to.stroke();
  to.textAlign = "left";
  to.lineWidth = 1.5;
  for (const [pick, stroke] of lines) {
    to.strokeStyle = colour(stroke);
    to.beginPath();
    let on = false;
    for (const point of history) {
      const value = pick(point);
      if (value === null) { on = false; continue; }
      if (on) to.lineTo(x(point.at), y(value)); else to.moveTo(x(point.at), y(value));
      on = true;
    }
    to.stroke();
  }
}

// ---- instants

let asked = false;
let drawn = 0;

function requestDraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    drawAge();
    drawList();
    drawAlarms();
    drawLog();
    drawNumbers();
    drawHold();
    drawUplink();
    drawPlayback();
    // Pictures cost more time than text, so ten a second suffice.
    if (performance.now() - drawn > 95) {
      drawn = performance.now();
      drawMap();
      drawPlot("plot-height", "Height", " m", [[(point) => point.height, "--r1"]], 2, history);
      drawPlot("plot-age", "Age", " s", [[(point) => point.age, "--r1"]], 0.5, history);
      drawPlot("plot-agree", "Receivers that agree", "", [[(point) => point.agree, "--r1"]], 1, history);
      drawHoldPlots();
    }
  });
}

// ---- playback

const JUMP_S = 10;             // the step of one key or button, s

let held = false;              // whether the user holds the slider, which then stays
let target = 0;                // the target of a jump, s
let going = false;             // whether a jump is under way without an answer
let orders = 0;                // the number of requests without an answer
let changes = 0;               // the station's count of changes in its last answer
let gone = 0;                  // the count of changes in the answer to the last jump
let pace = 1;                  // the requested pace, or the station's
let answered = Promise.resolve();

// Whether the last state was made after all requests had taken effect: an earlier one still shows the old pace and
// place.
const settled = () => !orders && state.playback.changes >= changes;

// A screen reader gets whole seconds only, at most one a second.
function minutes(seconds) {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

function drawPlayback() {
  const playback = state.playback;
  element("playback").hidden = !playback;
  if (!playback) return;
  if (settled()) pace = playback.speed;
  put("pause", playback.speed === 0 ? "Play" : "Pause");
  const at = element("at");
  // The slider has whole seconds; a target past the end is the end.
  const length = String(Math.ceil(playback.length_s));
  if (at.max !== length) at.max = length;
  const place = String(Math.floor(playback.at_s));
  if (!held && settled() && at.value !== place) at.value = place;
  const words = `${minutes(at.value)} of ${minutes(length)}`;
  if (at.getAttribute("aria-valuetext") !== words) at.setAttribute("aria-valuetext", words);
  put("at-value", `${playback.at_s.toFixed(1)} of ${playback.length_s.toFixed(1)} s`);
  // Another page, or the command line, may have set the pace.
  if (playback.speed !== 0 && settled()) chooseSpeed(playback.speed);
}

function chooseSpeed(speed) {
  const select = element("speed");
  if (Number(select.value) === speed) return;
  const options = [...select.options];
  if (!options.some((option) => Number(option.value) === speed)) {
    select.insertBefore(new Option(speed), options.find((option) => Number(option.value) > speed) || null);
  }
  select.value = String(speed);
}

// Sends a request to the station, and shows its result. Requests go one after the other, because concurrent ones may
// arrive in any order.
function order(what, words) {
  orders += 1;
  answered = answered.then(async () => {
    try {
      const answer = await fetch("/playback?" + what, { method: "POST" });
      if (answer.ok) changes = Number(await answer.text());
      put("did", answer.ok ? words : `refused: ${answer.status}`);
    } catch {
      put("did", "the base station is not reached");
    }
    orders -= 1;
  });
  return answered;
}

const stands = () => pace === 0;

// The next key refers to the last requested pace: the shown state may be older.
function setPace(speed, words) {
  pace = Number(speed);
  order("speed=" + speed, words);
}

function pause() {
  const speed = element("speed").value;
  if (stands()) setPace(speed, `playing, ${speed} times`);
  else setPace(0, `paused at ${minutes(state.playback.at_s)}`);
}

// A repeated key is faster than the answers: only the last target is requested then.
async function go(to) {
  target = Math.min(Math.max(to, 0), state.playback.length_s);
  element("at").value = Math.floor(target);
  if (going) return;
  going = true;
  let place = null;
  while (place !== target) {
    place = target;
    await order("at=" + place, `at ${minutes(place)}`);
  }
  going = false;
  gone = changes;
}

const jump = (by) => go((going || state.playback.changes < gone ? target : state.playback.at_s) + by);

function changeSpeed(speed) {
  // A change of the pace does not start a playback that stands still.
  if (stands()) put("did", `${speed} times, when it plays`);
  else setPace(speed, `${speed} times`);
}

function shiftSpeed(by) {
  const select = element("speed");
  const index = Math.min(Math.max(select.selectedIndex + by, 0), select.options.length - 1);
  if (index === select.selectedIndex) return;
  select.selectedIndex = index;
  changeSpeed(select.value);
}

// These keys work at any time; those of a playback are below.
const LIVE_KEYS = {
  a: acknowledge,
  n: () => shift(1),
  b: () => shift(-1),
  w: worstDrone,
};

const KEYS = {
  p: pause,
  j: () => jump(-JUMP_S),
  l: () => jump(JUMP_S),
  s: () => shiftSpeed(-1),
  f: () => shiftSpeed(1),
};

addEventListener("keydown", (event) => {
  const key = event.key.toLowerCase();
  const act = LIVE_KEYS[key] || (state && state.playback && element("keys").checked ? KEYS[key] : null);
  if (!act || !state || (LIVE_KEYS[key] && !element("live-keys").checked)) return;
  if (event.ctrlKey || event.altKey || event.metaKey || event.isComposing) return;
  // A list handles letters itself. A held key repeats a jump, but does not toggle pause.
  const isText = event.target instanceof HTMLInputElement && ["text", "number"].includes(event.target.type);
  if (event.target instanceof HTMLSelectElement || isText || (event.repeat && act === pause)) return;
  event.preventDefault();
  act();
});

function look(id) {
  want(id);
  connect();
}

element("drone").addEventListener("change", (event) => look(event.target.value));
element("acknowledge").addEventListener("click", acknowledge);
element("sound").addEventListener("change", ({ target }) => {
  // A browser plays sound only after a user's action.
  if (target.checked) { audio = audio || new AudioContext(); audio.resume(); }
});
element("notify").addEventListener("change", async ({ target }) => {
  if (target.checked && window.Notification) await Notification.requestPermission();
  if (target.checked && !(window.Notification && Notification.permission === "granted")) {
    target.checked = false;
    put("acknowledged", "this browser does not allow notifications here");
  }
});
element("uplink-form").addEventListener("submit", sendUplink);
element("pause").addEventListener("click", pause);
element("back").addEventListener("click", () => jump(-JUMP_S));
element("forward").addEventListener("click", () => jump(JUMP_S));
element("speed").addEventListener("change", (event) => changeSpeed(event.target.value));
element("at").addEventListener("input", () => { held = true; });
element("at").addEventListener("change", (event) => { held = false; go(Number(event.target.value)); });
element("playback").addEventListener("submit", (event) => event.preventDefault());
addEventListener("resize", () => { if (state) requestDraw(); });
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (state) requestDraw(); });

// A hidden page gets no frames; its age grows all the same.
setInterval(drawAge, 50);
connect();
