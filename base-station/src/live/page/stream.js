"use strict";
// One stream of states serves all tabs of this browser, because it allows at most six connections to one host. It
// carries a state for each drone that a tab shows; `asked` lists them.

const GONE_MS = 180000;        // a tab without messages for this time is gone: in the background it sends one a minute

const tabs = new Map();        // port: the drone that the tab shows, and the instant of its last message
let source = null;
let open = "";                 // the drones that the stream was requested for

function connect() {
  const drones = [...new Set([...tabs.values()].map(({ drone }) => drone))].sort();
  const query = drones.map((drone) => "drone=" + encodeURIComponent(drone)).join("&");
  if (source && source.readyState !== EventSource.CLOSED && query === open) return;
  if (source) source.close();
  source = null;
  open = query;
  if (!drones.length) return;
  const mine = source = new EventSource("/events?" + query);
  mine.onopen = () => tell({ what: "open" });
  mine.onmessage = ({ data }) => {
    // The tabs parse the text; only the drone is needed here.
    const { asked } = JSON.parse(data);
    for (const [port, { drone }] of tabs) if (drone === asked) port.postMessage({ what: "state", data });
  };
  mine.onerror = () => {
    tell({ what: "error" });
    // The browser tries again by itself, unless it was refused.
    if (mine === source && mine.readyState === EventSource.CLOSED) setTimeout(connect, 1000);
  };
}

function tell(what) {
  for (const port of tabs.keys()) port.postMessage(what);
}

onconnect = ({ ports: [port] }) => {
  port.onmessage = ({ data }) => {
    const before = tabs.get(port);
    if (data.what === "bye") tabs.delete(port);
    else tabs.set(port, { drone: data.what === "look" ? data.drone : before ? before.drone : "", at: Date.now() });
    for (const [other, { at }] of tabs) if (Date.now() - at > GONE_MS) tabs.delete(other);
    // A tab that selects a drone needs its history, which only the first state of a connection has.
    if (data.what === "look") open = null;
    connect();
  };
};
