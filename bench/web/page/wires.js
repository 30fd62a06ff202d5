"use strict";
// Draws the wires of the last 100 ms. The worker's bytes are described in bench/web/src/wires.rs.
{
  const SPAN = 100e6;            // the time that is kept, ns
  const EVERY_MS = 250;
  const ROW = 26;                // the height of a wire, pixels
  const LEFT = 110;              // the width of the names, pixels
  const NAMES = ["TICK", "frame on the air", "HORUS's IRQ", "DPR's IRQ", "FRESH", "SSI CSN", "SSI SCK", "SSI MOSI",
    "SSI MISO"];
  const [CSN, SCK, MOSI, MISO, BYTE] = [5, 6, 7, 8, 255];
  const ZOOMS = [100e6, 20e6, 4e6, 1e6, 200e3, 40e3, 8e3];   // the width of the view, ns

  const element = (id) => document.getElementById(id);
  const canvas = element("wires");
  const scroll = element("wires-scroll");
  let wires = null;
  let zoom = 2;

  function read(buffer) {
    const view = new DataView(buffer);
    const clock = view.getFloat64(8, true);
    const levels = view.getUint32(16, true);
    const changes = Array.from({ length: NAMES.length }, () => []);
    const bytes = [];
    for (let at = 24; at + 8 <= buffer.byteLength; at += 8) {
      const instant = SPAN - view.getUint32(at, true);
      const [wire, one, other] = [view.getUint8(at + 4), view.getUint8(at + 5), view.getUint8(at + 6)];
      if (wire === BYTE) bytes.push({ end: instant, begin: instant - 8e9 / clock, mosi: one, miso: other });
      else changes[wire].push([instant, one]);
    }
    return { now: view.getFloat64(0, true), bit: 1e9 / clock, levels, changes, bytes };
  }

  function draw() {
    if (!wires) return;
    const width = canvas.clientWidth, height = canvas.clientHeight, scale = window.devicePixelRatio || 1;
    canvas.width = width * scale;
    canvas.height = height * scale;
    const ink = canvas.getContext("2d");
    ink.scale(scale, scale);
    const style = getComputedStyle(document.body);
    ink.font = "12px system-ui, sans-serif";
    ink.fillStyle = ink.strokeStyle = style.color;
    const span = ZOOMS[zoom];
    const room = scroll.scrollWidth - scroll.clientWidth;
    const from = room > 0 ? (SPAN - span) * scroll.scrollLeft / room : 0;
    const x = (at) => LEFT + (at - from) / span * (width - LEFT);
    const y = (row, level) => row * ROW + 6 + (level ? 0 : ROW - 12);
    NAMES.forEach((name, row) => ink.fillText(name, 4, row * ROW + 17));
    ink.save();
    ink.beginPath();
    ink.rect(LEFT, 0, width - LEFT, height);
    ink.clip();
    for (let row = 0; row <= CSN; row++) trace(ink, row, wires.changes[row], wires.levels >> row & 1, x, y, width);
    for (const byte of wires.bytes) {
      if (byte.end < from || byte.begin > from + span) continue;
      const bits = x(wires.bit) - x(0) >= 3;
      for (const [row, value] of [[SCK, null], [MOSI, byte.mosi], [MISO, byte.miso]]) {
        if (bits) drawBits(ink, row, byte, value, x, y);
        else ink.fillRect(x(byte.begin), y(row, 1), Math.max(1, x(byte.end) - x(byte.begin) - 1), ROW - 12);
      }
    }
    ink.restore();
    const ms = (at) => ((wires.now - SPAN + at) / 1e6).toFixed(span < 1e6 ? 4 : 2);
    element("wires-at").textContent = `${ms(from)} to ${ms(from + span)} ms of the flight`;
  }

  function trace(ink, row, changes, before, x, y, width) {
    let level = before;
    ink.beginPath();
    ink.moveTo(LEFT, y(row, level));
    for (const [at, next] of changes) {
      const place = Math.min(Math.max(x(at), LEFT - 1), width + 1);
      ink.lineTo(place, y(row, level));
      ink.lineTo(place, y(row, next));
      level = next;
    }
    ink.lineTo(width, y(row, level));
    ink.stroke();
  }

  // SPI mode 0: a bit is there before the clock rises, and until it has fallen.
  function drawBits(ink, row, { begin, end }, value, x, y) {
    const bit = (end - begin) / 8;
    ink.beginPath();
    for (let nth = 0; nth < 8; nth++) {
      const at = begin + nth * bit;
      const level = value === null ? 0 : value >> (7 - nth) & 1;
      ink.lineTo(x(at), y(row, level));
      if (value === null) {
        ink.lineTo(x(at + bit / 2), y(row, 0));
        ink.lineTo(x(at + bit / 2), y(row, 1));
        ink.lineTo(x(at + bit), y(row, 1));
      }
      ink.lineTo(x(at + bit), y(row, level));
    }
    ink.stroke();
    if (value !== null && x(end) - x(begin) > 40) {
      ink.fillText(value.toString(16).padStart(2, "0"), x(begin + 3.5 * bit), y(row, 0) + 5);
    }
  }

  // The width of what is scrolled follows the zoom; the right end is now.
  function size(keep) {
    const at = (scroll.scrollLeft + scroll.clientWidth / 2) / scroll.scrollWidth;
    element("wires-width").style.width = SPAN / ZOOMS[zoom] * 100 + "%";
    scroll.scrollLeft = keep ? at * scroll.scrollWidth - scroll.clientWidth / 2 : scroll.scrollWidth;
    draw();
  }

  async function look() {
    if (!element("wires-still").checked) {
      wires = read(await window.askWires());
      window.wiresSeen = wires;
      draw();
    }
    setTimeout(look, EVERY_MS);
  }

  element("wires-closer").addEventListener("click", () => { zoom = Math.min(zoom + 1, ZOOMS.length - 1); size(true); });
  element("wires-wider").addEventListener("click", () => { zoom = Math.max(zoom - 1, 0); size(true); });
  scroll.addEventListener("scroll", draw);
  addEventListener("resize", draw);
  size(false);
  look();
}
