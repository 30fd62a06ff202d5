"use strict";
// One stream of states for all tabs of this browser, since it allows no more than six connections to one host. It
// brings a state for each drone that a tab looks at; `asked` says which.

const GONE_MS = 180000;        // a tab that says nothing for so long is gone: in the background it speaks once a minute

const tabs = new Map();        // port: which drone it looks at, and when it spoke last
let source = null;
let open = "";                 // what the stream was asked for

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
    // The text is read by the tabs that it is for; here only whose it is.
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
    // A tab that begins to look at a drone wants its history, which the first state of a connection has.
    if (data.what === "look") open = null;
    connect();
  };
};
