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

  return { one, all, s, h, short, plain, seconds, r1, showTip, hideTip, hover, say, sourceMark, copy };
})();
