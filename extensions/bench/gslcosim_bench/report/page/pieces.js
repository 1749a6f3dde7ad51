"use strict";
// Pieces that the scripts of all pages share.
const pieces = (() => {
  const SVG = "http://www.w3.org/2000/svg";
  const one = (selector, root = document) => root.querySelector(selector);
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];

  function make(space, name, attributes, children) {
    const node = space ? document.createElementNS(SVG, name) : document.createElement(name);
    for (const [key, value] of Object.entries(attributes || {})) if (value !== null && value !== undefined) node.setAttribute(key, value);
    for (const child of children) if (child !== null && child !== undefined) node.append(child);
    return node;
  }
  const s = (name, attributes, ...children) => make(true, name, attributes, children);
  const h = (name, attributes, ...children) => make(false, name, attributes, children);

  // What differs stands at the end as often as at the beginning.
  const short = (text, n) => (text.length > n ? `${text.slice(0, Math.ceil(0.45 * n) - 1)}…${text.slice(text.length - Math.floor(0.55 * n))}` : text);
  const plain = (v) => (v === null ? "–" : Math.abs(v) >= 100 ? v.toFixed(0) : Math.abs(v) >= 10 ? v.toFixed(1) : v.toFixed(2));
  const seconds = (v) => (v === null ? "–" : `${plain(v)} s`);
  const r1 = (value) => Math.round(value * 10) / 10;

  const tip = h("div", { id: "tip", hidden: "" });
  const spoken = h("div", { class: "hidden-text", "aria-live": "polite" });
  document.body.append(tip, spoken);
  function showTip(content, x, y) {
    tip.replaceChildren(...(Array.isArray(content) ? content : [content]));
    tip.hidden = false;
    const box = tip.getBoundingClientRect();
    const left = x + 16 + box.width > innerWidth ? x - box.width - 12 : x + 16;
    tip.style.left = `${Math.max(6, left)}px`;
    tip.style.top = `${Math.max(6, Math.min(y + 12, innerHeight - box.height - 6))}px`;
  }
  const hideTip = () => { tip.hidden = true; };
  function hover(node, content) {
    node.addEventListener("pointermove", (event) => showTip(content(), event.clientX, event.clientY));
    node.addEventListener("pointerleave", hideTip);
    return node;
  }
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") hideTip(); });
  addEventListener("scroll", hideTip, { passive: true });
  const say = (text) => { spoken.textContent = text; };

  // ---------------------------------------------------------------- looks of entries
  const DASHES = ["", "7 3", "2 3", "9 3 2 3"];
  const color = (look) => (look.color === -1 ? "var(--lower)" : look.color === -2 ? "var(--upper)" : `var(--e${look.color})`);
  const dash = (look) => DASHES[look.dashes] || null;
  function swatch(look) {
    const svg = s("svg", { width: 18, height: 10, "aria-hidden": "true" });
    svg.append(s("line", { x1: 1, x2: 17, y1: 5, y2: 5, "stroke-width": 3, stroke: color(look), "stroke-dasharray": dash(look) }));
    return svg;
  }

  // ---------------------------------------------------------------- rooms and tracks
  function roomSvg(room, href, label) {
    const [x0, y0, x1, y1] = room.box_m, w = x1 - x0, t = y1 - y0, unit = Math.max(w, t) / 100, Y = (y) => y1 - y;
    const svg = s("svg", { viewBox: `${x0} 0 ${w} ${t}`, role: "img", "aria-label": label, style: "overflow:hidden" });
    svg.append(s("rect", { x: x0, y: 0, width: w, height: t, fill: "var(--sunk)" }));
    if (href) {
      const { origin_m: [x, y], extent_m: [width, height] } = room.picture;
      svg.append(s("image", { href, x, y: y1 - y - height, width, height, preserveAspectRatio: "none", style: "image-rendering:pixelated" }));
    }
    svg.append(s("rect", { x: x0, y: 0, width: w, height: t, fill: "none", stroke: "var(--solid)", "stroke-width": 0.8 * unit }));
    return { svg, Y, unit };
  }
  // Zigzag varints of the steps of time, x and y.
  function unpack(text, quanta) {
    const bytes = atob(text), now = [0, 0, 0], track = { t: [], x: [], y: [] };
    let value = 0, shift = 1, axis = 0;
    for (let i = 0; i < bytes.length; i++) {
      const byte = bytes.charCodeAt(i);
      value += (byte & 127) * shift;
      if (byte & 128) { shift *= 128; continue; }
      now[axis] += value % 2 ? -(value + 1) / 2 : value / 2;
      value = 0; shift = 1; axis = (axis + 1) % 3;
      if (axis === 0) { track.t.push(now[0] * quanta[0]); track.x.push(now[1] * quanta[1]); track.y.push(now[2] * quanta[1]); }
    }
    return track;
  }
  const wayOf = (track, Y, until = track.t.length - 1) => { let d = ""; for (let i = 0; i <= until; i++) d += `${i ? "L" : "M"}${track.x[i].toFixed(2)} ${Y(track.y[i]).toFixed(2)}`; return d; };
  const startMark = (track, Y, unit) => s("circle", { cx: track.x[0], cy: Y(track.y[0]), r: 1.25 * unit, fill: "var(--paper)", stroke: "var(--ink)", "stroke-width": 0.45 * unit });
  // A whole track with its start; one that did not find the source is grey, and has its end.
  function trackMarks(track, look, found, Y, unit) {
    const d = wayOf(track, Y), last = track.t.length - 1;
    const line = s("path", { d, fill: "none", stroke: !found ? "var(--faint)" : look.color === -2 ? "var(--ink)" : color(look), "stroke-width": (found ? 0.75 : 0.5) * unit, "stroke-opacity": found ? 0.75 : 0.55, "stroke-linejoin": "round" });
    const end = found ? null : s("circle", { cx: track.x[last], cy: Y(track.y[last]), r: unit, fill: "var(--faint)" });
    return { group: s("g", {}, line, end, startMark(track, Y, unit)), line, d };
  }

  function sourceMark(svg, sources, Y, u) {
    for (const [x, y] of sources) {
      const a = 2.6 * u;
      svg.append(s("circle", { cx: x, cy: Y(y), r: 3.1 * u, fill: "var(--paper)", "fill-opacity": 0.85 }), s("path", { d: `M${x - a} ${Y(y)}H${x + a}M${x} ${Y(y) - a}V${Y(y) + a}M${x - a * 0.7} ${Y(y) - a * 0.7}L${x + a * 0.7} ${Y(y) + a * 0.7}M${x - a * 0.7} ${Y(y) + a * 0.7}L${x + a * 0.7} ${Y(y) - a * 0.7}`, stroke: "var(--ink)", "stroke-width": 0.75 * u, fill: "none" }));
    }
  }

  function copy(text) {
    if (navigator.clipboard && isSecureContext) { navigator.clipboard.writeText(text).catch(() => {}); return; }
    const area = h("textarea", { style: "position:fixed;opacity:0" });
    area.value = text; document.body.append(area); area.select();
    try { document.execCommand("copy"); } finally { area.remove(); }
  }
  document.addEventListener("click", (event) => {
    const button = event.target.closest("button.copy");
    if (!button) return;
    if (button.textContent !== "copied") button.dataset.word = button.textContent;
    copy(button.dataset.text);
    button.textContent = "copied";
    setTimeout(() => { button.textContent = button.dataset.word; }, 1500);
  });

  return { one, all, s, h, short, plain, seconds, r1, showTip, hideTip, hover, say, color, dash, swatch, roomSvg, unpack, wayOf, startMark, trackMarks, sourceMark, copy };
})();
