"use strict";
// Begins the flight that the page's address asks for, and connects the worker in which it runs with the base station's
// page, with the panel and with the wires.
{
  const asked = new URLSearchParams(location.search);
  const flight = {
    seed: asked.get("seed") || "1",
    faults: asked.get("faults") || "",
    seconds: asked.get("seconds") || "600",
    hold: asked.has("hold"),
    pace: asked.has("pace") ? Number(asked.get("pace")) : 1,
  };
  const worker = new Worker("worker.js");
  const { port1, port2 } = new MessageChannel();
  const waiting = new Map();
  let number = 0;
  let first = null;              // the time from the opening of the page to its first position, ms

  // The base station's page takes its states from here.
  window.stationPort = port1;

  const request = (data) => new Promise((resolve) => {
    waiting.set(++number, resolve);
    worker.postMessage({ ...data, number });
  });
  // The panel asks here, as it would ask a server.
  window.askPanel = async (path) => {
    const { status, body } = await request({ what: "ask", request: { what: "panel", path } });
    return new Response(status === 204 ? null : body, { status });
  };
  document.getElementById("panel").src = "panel.html";
  window.askWires = () => request({ what: "wires" });

  const put = (id, text) => { document.getElementById(id).textContent = text; };
  const minutes = (ms) => `${Math.floor(ms / 60000)}:${(ms / 1000 % 60).toFixed(1).padStart(4, "0")}`;

  function show({ now_ms, changed, outcome, pace, speed, tardy_ms }) {
    window.flightStep = { now_ms, changed, outcome, pace, speed, tardy_ms, first_ms: first };
    put("flight-time", minutes(now_ms));
    const kept = flight.pace === 0 || pace > 0.97 * flight.pace;
    if (!outcome && Number.isFinite(speed)) {
      document.getElementById("pace").className = kept ? "" : "slow";
      put("pace", kept ? `${pace.toFixed(2)} × real time; this machine could do ${speed.toFixed(1)} ×`
        : `SLOWER than real time: ${pace.toFixed(2)} ×. What is late here is late because of this machine.`);
    }
    if (!outcome) return;
    put("pace", `the flight is over; this machine did ${speed > 0 ? speed.toFixed(1) + " ×" : ""} real time`);
    put("digest", changed ? "the panel has changed this flight, so no command makes it again" : outcome.digest);
    put("violations", outcome.violations.length ? outcome.violations.join("\n") : "none");
    document.getElementById("outcome").hidden = false;
  }

  worker.onmessage = ({ data }) => {
    if (data.what === "step") show(data);
    else if (data.what === "failed") put("failure", data.why);
    else if (data.what === "answer") {
      waiting.get(data.number)(data.answered);
      waiting.delete(data.number);
    }
  };
  worker.onerror = (event) => put("failure", event.message || "the worker cannot be started");
  if (!(flight.pace === 0 || (flight.pace >= 0.01 && flight.pace <= 100))) {
    put("failure", `pace=${asked.get("pace")}: expected a factor from 0.01 to 100, or 0`);
  } else {
    worker.postMessage({ what: "begin", flight }, [port2]);
  }

  // The form reopens the page with another address.
  const form = document.getElementById("flight-form");
  for (const name of ["seed", "faults", "seconds"]) form.elements[name].value = flight[name];
  form.elements.hold.checked = flight.hold;
  const option = (name, value) => (value ? ` --${name} ${value}` : "");
  put("command", `cargo xtask sim${option("seed", flight.seed)}${option("faults", flight.faults)}` +
    `${option("seconds", flight.seconds)}${flight.hold ? " --hold" : ""} --events run.log && sha256sum run.log`);

  const looked = setInterval(() => {
    if (document.body.className !== "fresh") return;
    first = performance.now();
    put("first", `${(first / 1000).toFixed(1)} s`);
    clearInterval(looked);
  }, 20);
}
