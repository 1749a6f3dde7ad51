"use strict";
// Draws the page's plots from the JSON that is embedded in it. An estimate is [value, low, high, n]; null is undefined.
(() => {
  const { one, all, s, h, short, plain, seconds, r1, showTip, hideTip, hover, say, color: colorOf, dash: dashOf, swatch: swatchOf, roomSvg, sourceMark, unpack, trackMarks, copy } = pieces;
  const D = JSON.parse(document.getElementById("data").textContent);
  const state = { view: 0, on: new Set(D.entries.map((entry, i) => (entry.is_on ? i : -1)).filter((i) => i >= 0)), focus: null };

  // ---------------------------------------------------------------- names and formats
  const color = (e) => colorOf(D.entries[e]), dash = (e) => dashOf(D.entries[e]), swatch = (e) => swatchOf(D.entries[e]);
  const name = (e) => D.entries[e].name;
  // In narrow places names that all begin alike (one method with many settings) are told by what follows.
  const shared = (() => {
    const names = D.entries.filter((entry) => entry.color >= 0).map((entry) => entry.name);
    if (names.length < 3 || Math.max(...names.map((text) => text.length)) <= 18) return 0;
    let n = 0;
    while (n < names[0].length && names.every((text) => text[n] === names[0][n])) n++;
    const cut = Math.max(...["_", "-", " ", "/"].map((sign) => names[0].lastIndexOf(sign, n - 1)));
    return cut >= 7 ? cut + 1 : 0;
  })();
  // A line of several entries has a label of its own.
  const lineName = (line) => line.label || name(line.entry);
  const briefLine = (line, n) => (line.label ? short(line.label, n) : brief(line.entry, n));
  const brief = (e, n) => short(shared && D.entries[e].color >= 0 ? `…${name(e).slice(shared)}` : name(e), n);
  const view = () => D.views[state.view];
  const shown = (items) => items.filter((item) => item.label || state.on.has(item.entry));

  const percent = (v) => (v === null ? "–" : `${(100 * v).toFixed(Math.abs(v) < 0.0995 && v !== 0 ? 1 : 0)} %`);
  const signed = (v) => (v === null ? "–" : (Math.abs(v) < 0.005 ? "" : v > 0 ? "+" : "−") + Math.abs(100 * v).toFixed(0));
  // "98 % (90 – 100)": the unit stands once.
  const bare = (text) => text.replace(/ ?[%sm×]$/, "");
  const FORMATS = { percent, plain, seconds, number: (v) => (v === null ? "–" : String(+v.toPrecision(3))), metres: (v) => (v === null ? "–" : `${plain(v)} m`) };
  const interval = (v, l, u, f) => {
    if (v === null || l === null || u === null) return v === null ? "–" : f(v);
    const [low, high] = [bare(f(l)), bare(f(u))];
    return `${f(v)} (${low}${/^[+−-]/.test(low) || /^[+−-]/.test(high) ? " to " : "–"}${high})`;
  };
  const estimate = (x, f) => (x ? interval(x[0], x[1], x[2], f) : "–");

  function ticks(min, max, count) {
    const raw = (max - min) / count, power = 10 ** Math.floor(Math.log10(raw)), unit = raw / power;
    const step = (unit < 1.5 ? 1 : unit < 3.5 ? 2 : unit < 7.5 ? 5 : 10) * power, found = [];
    for (let value = Math.ceil(min / step - 1e-9) * step; value <= max + 1e-9 * step; value += step) found.push(Math.abs(value) < step * 1e-9 ? 0 : value);
    return found;
  }

  // ---------------------------------------------------------------- a table of a plot's figures
  function figuresTable(figure, heads, rows) {
    let box = one("details.figures", figure);
    if (!box) {
      box = h("details", { class: "figures" }, h("summary", {}, "Figures"), h("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Figures" }));
      figure.append(box);
      box.addEventListener("toggle", () => { if (box.open) box.fill(); });
    }
    box.fill = () => {
      const body = h("tbody");
      for (const row of rows()) body.append(h("tr", {}, ...row.map((cell, i) => h(i ? "td" : "th", i ? {} : { scope: "row" }, cell))));
      const head = h("tr", {}, ...heads.map((text, i) => h("th", { scope: "col", class: i ? null : "left" }, text)));
      one(".scroll", box).replaceChildren(h("table", {}, h("thead", {}, head), body));
    };
    if (box.open) box.fill();
  }

  // ---------------------------------------------------------------- lines with bands
  // spec: a chart of the page's data, with what `namedChart` adds.
  function lineChart(figure, spec) {
    const host = one(".canvas", figure) || figure.insertBefore(h("div", { class: "canvas" }), figure.firstChild);
    const width = Math.max(280, host.clientWidth || figure.clientWidth || 600);
    const lines = spec.lines, direct = width > 560 && lines.length <= 12 && !spec.plainEnds;
    const height = spec.height || Math.round(Math.min(360, Math.max(210, width * 0.5)));
    const m = { left: 48, right: direct ? 132 : 14, top: 10, bottom: 40 };
    const W = width - m.left - m.right, H = height - m.top - m.bottom;
    const { x, y } = spec;
    const X = x.is_log ? (v) => m.left + (W * Math.log(v / x.low)) / Math.log(x.high / x.low) : (v) => m.left + (W * (v - x.low)) / (x.high - x.low || 1);
    const Y = (v) => m.top + H - (H * (v - y.low)) / (y.high - y.low || 1);
    const fx = FORMATS[x.format] || plain, fy = FORMATS[y.format] || plain;
    const svg = s("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", tabindex: 0, "aria-label": `${spec.title}. Left and right arrows read the figures.` });
    for (const v of ticks(y.low, y.high, 5)) {
      svg.append(s("line", { class: "gridline", x1: m.left, x2: m.left + W, y1: Y(v), y2: Y(v) }),
        s("text", { x: m.left - 7, y: Y(v) + 4, "text-anchor": "end" }, y.format === "percent" ? (100 * v).toFixed(0) : plain(v).replace(/\.0+$/, "")));
    }
    const marks = x.ticks.length ? x.ticks : ticks(x.low, x.high, Math.max(3, Math.min(8, W / 70))).map((v) => [v, String(+v.toFixed(6))]);
    for (const [v, word] of marks) {
      svg.append(s("line", { class: "axis", x1: X(v), x2: X(v), y1: m.top + H, y2: m.top + H + 4 }),
        s("text", { x: X(v), y: m.top + H + 17, "text-anchor": "middle" }, word));
    }
    if (x.default !== null) svg.append(s("line", { class: "cross", x1: X(x.default), x2: X(x.default), y1: m.top, y2: m.top + H }), s("text", { x: X(x.default), y: m.top + 4, "text-anchor": "middle" }, "default"));
    svg.append(s("line", { class: "axis", x1: m.left, x2: m.left + W, y1: m.top + H, y2: m.top + H }),
      s("text", { x: m.left + W / 2, y: height - 5, "text-anchor": "middle" }, x.label),
      s("text", { x: -(m.top + H / 2), y: 12, transform: "rotate(-90)", "text-anchor": "middle" }, y.label));
    if (spec.has_diagonal) svg.append(s("line", { class: "cross", x1: X(0), y1: Y(0), x2: X(1), y2: Y(1) }));
    const path = (xs, ys) => {
      let d = "", pen = false;
      for (let i = 0; i < xs.length; i++) {
        if (ys[i] === null || (x.is_log && xs[i] <= 0)) { pen = false; continue; }
        d += !pen ? `M${r1(X(xs[i]))} ${r1(Y(ys[i]))}` : spec.is_step ? `H${r1(X(xs[i]))}V${r1(Y(ys[i]))}` : `L${r1(X(xs[i]))} ${r1(Y(ys[i]))}`;
        pen = true;
      }
      return d;
    };
    const opacity = lines.length > 8 ? 0.05 : 0.13;
    for (const line of lines) if (line.low && !spec.has_points) {
      const xs = [], low = [], high = [];
      line.x.forEach((v, i) => { if (line.low[i] !== null && line.high[i] !== null) { xs.push(v); low.push(line.low[i]); high.push(line.high[i]); } });
      if (!xs.length) continue;
      let d = path(xs, high), back = "";
      for (let i = xs.length - 1; i >= 0; i--) back += spec.is_step && i < xs.length - 1 ? `V${r1(Y(low[i]))}H${r1(X(xs[i]))}` : `L${r1(X(xs[i]))} ${r1(Y(low[i]))}`;
      svg.append(s("path", { class: "band", "data-e": line.entry, d: d + back + "Z", fill: color(line.entry), "fill-opacity": opacity }));
    }
    for (const line of lines) if (spec.has_points) line.x.forEach((v, i) => {
      if (line.value[i] === null) return;
      if (line.low[i] !== null && line.high[i] !== null) svg.append(s("line", { "data-e": line.entry, x1: X(v), x2: X(v), y1: Y(line.low[i]), y2: Y(line.high[i]), stroke: color(line.entry), "stroke-opacity": 0.6 }));
      svg.append(s("circle", { "data-e": line.entry, cx: r1(X(v)), cy: r1(Y(line.value[i])), r: 3.2, fill: color(line.entry) }));
    });
    if (spec.is_joined) for (const line of lines) svg.append(s("path", { class: "line", "data-e": line.entry, d: path(line.x, line.value), stroke: color(line.entry), "stroke-dasharray": dash(line.entry) }));
    if (direct) endLabels(svg, lines, (v) => Y(v), m.left + W + 8, m.top, m.top + H);
    const cross = s("line", { class: "cross", y1: m.top, y2: m.top + H, visibility: "hidden" });
    svg.append(cross);

    const place = (v) => (x.ticks.find(([at]) => at === v) || [v, exact(fx, v)])[1];
    const grid = [...new Set(lines.flatMap((line) => line.x))].sort((a, b) => a - b);
    const at = (line, v) => { if (spec.has_points) return line.x.indexOf(v); let i = -1; while (i + 1 < line.x.length && line.x[i + 1] <= v + 1e-9) i++; return i; };
    const read = (v) => lines.map((line) => [line, at(line, v)]).filter(([line, i]) => i >= 0 && line.value[i] !== null).sort((a, b) => b[0].value[b[1]] - a[0].value[a[1]]);
    const text = (line, i) => interval(line.value[i], line.low ? line.low[i] : null, line.high ? line.high[i] : null, fy);
    const tipAt = (v) => {
      const body = h("tbody");
      for (const [line, i] of read(v).slice(0, 14)) body.append(h("tr", {}, h("td", {}, swatch(line.entry)), h("td", { class: "left" }, briefLine(line, 30)), h("td", {}, text(line, i)), h("td", {}, `n ${line.n}`)));
      return [h("b", {}, `${x.name || x.label} ${place(v)}`), h("table", {}, body)];
    };
    const nearest = (pixel) => grid.reduce((best, v) => (Math.abs(X(v) - pixel) < Math.abs(X(best) - pixel) ? v : best), grid[0]);
    const point = (v) => { cross.setAttribute("x1", X(v)); cross.setAttribute("x2", X(v)); cross.setAttribute("visibility", "visible"); };
    const leave = () => { cross.setAttribute("visibility", "hidden"); hideTip(); };
    if (grid.length) {
      svg.addEventListener("pointermove", (event) => {
        const box = svg.getBoundingClientRect(), v = nearest(((event.clientX - box.left) * width) / box.width);
        point(v); showTip(tipAt(v), event.clientX, event.clientY);
      });
      svg.addEventListener("pointerleave", leave);
      svg.addEventListener("blur", leave);
      let current = -1;
      svg.addEventListener("keydown", (event) => {
        if (event.key !== "ArrowRight" && event.key !== "ArrowLeft") return;
        event.preventDefault();
        const jump = Math.max(1, Math.round(grid.length / 25));
        current = Math.max(0, Math.min(grid.length - 1, current + (event.key === "ArrowRight" ? jump : -jump)));
        const v = grid[current], box = svg.getBoundingClientRect();
        point(v); showTip(tipAt(v), box.left + (X(v) * box.width) / width, box.top + 30);
        say(`${x.name || x.label} ${place(v)}: ` + read(v).map(([line, i]) => `${lineName(line)} ${text(line, i)}`).join("; "));
      });
    }
    host.replaceChildren(svg);
    if (spec.table !== false) figuresTable(figure, ["entry", "n", ...sample(grid, 7).map(place)], () => lines.map((line) =>
      [lineName(line), String(line.n), ...sample(grid, 7).map((v) => { const i = at(line, v); return i < 0 ? "–" : text(line, i); })]));
  }
  // A round number without its zeros: 50 s, not 50.0 s.
  const exact = (format, v) => format(v).replace(/(\.\d*?)0+(?= |$)/, "$1").replace(/\.(?= |$)/, "");
  const sample = (list, n) => (list.length <= n ? list : Array.from({ length: n }, (_, i) => list[Math.round((i * (list.length - 1)) / (n - 1))]));

  function endLabels(svg, lines, Y, x, top, bottom) {
    const labels = lines.map((line) => { let i = line.value.length - 1; while (i > 0 && line.value[i] === null) i--; return { line, y: Y(line.value[i] ?? 0) }; }).sort((a, b) => a.y - b.y);
    const gap = 13;
    labels.forEach((label, i) => { if (i && label.y < labels[i - 1].y + gap) label.y = labels[i - 1].y + gap; });
    for (let i = labels.length - 1; i >= 0; i--) {
      const limit = i === labels.length - 1 ? bottom : labels[i + 1].y - gap;
      if (labels[i].y > limit) labels[i].y = Math.max(top - 6, limit);
    }
    for (const { line, y } of labels) svg.append(s("text", { class: "label", "data-e": line.entry, x, y: y + 4, style: `fill:${color(line.entry)}` }, briefLine(line, 17)));
  }

  // ---------------------------------------------------------------- plots by name
  // Charts of lines come as the page's data describe them; here is only how large they are.
  function namedChart(figure, layout) {
    const chart = view().charts[figure.dataset.chart];
    const lines = shown(chart.lines).map((line) => ({ ...line, x: line.x || chart.shared_x }));
    lineChart(figure, { ...chart, ...layout, lines: lines.sort((a, b) => D.order.indexOf(a.entry) - D.order.indexOf(b.entry)) });
  }
  const PLOTS = {
    lines(figure) { namedChart(figure, {}); },
    response(figure) {
      namedChart(figure, { height: 230, plainEnds: true });
      const { lines } = view().charts[figure.dataset.chart];
      if (lines.length > 1) one(".canvas", figure).append(h("p", { class: "note" }, ...lines.flatMap((line) => [swatch(line.entry), ` ${line.label}  `])));
    },
    runtime(figure) { namedChart(figure, { height: 230, plainEnds: figure.dataset.chart !== "runtime" }); },
    roc(figure) { namedChart(figure, { plainEnds: true, height: 320, table: false }); },
    beliefs(figure) { namedChart(figure, { plainEnds: true, height: 290 }); },
    times(figure) { timesChart(figure, view().times); },
    pairs(figure) { pairsChart(figure, view().pairs); },
    starts(figure) { roomPanels(figure, startPanel); },
    tracks(figure) { roomPanels(figure, trackPanel); },
  };
  FORMATS.times = (v) => `${plain(v)} ×`;

  function timesChart(figure, rows) {
    const host = one(".canvas", figure) || figure.insertBefore(h("div", { class: "canvas" }), figure.firstChild);
    const width = Math.max(300, host.clientWidth || 600), narrow = width < 560, items = D.order.filter((e) => state.on.has(e)).map((e) => rows.find((row) => row.entry === e)).filter(Boolean);
    const rowHeight = narrow ? 54 : 42, m = { left: narrow ? 8 : 150, right: narrow ? 62 : 84, top: 6, bottom: 38 };
    const height = m.top + m.bottom + rowHeight * items.length, W = width - m.left - m.right;
    const X = (v) => m.left + (W * v) / D.limit;
    const svg = s("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "Distribution of times to the source by entry; figures in the table below." });
    for (const v of ticks(0, D.limit, Math.max(3, Math.min(7, W / 80)))) svg.append(s("line", { class: "gridline", x1: X(v), x2: X(v), y1: m.top, y2: height - m.bottom }), s("text", { x: X(v), y: height - m.bottom + 16, "text-anchor": "middle" }, String(v)));
    svg.append(s("text", { x: m.left + W / 2, y: height - 5, "text-anchor": "middle" }, "time to the source [s]"));
    svg.append(s("text", { x: width - 2, y: height - 5, "text-anchor": "end" }, "not found"));
    // The oracle's times lie so close together that beside it all others would be flat.
    const tallest = (some) => Math.max(0, ...some.map((item) => Math.max(...item.bins) / Math.max(1, item.n)));
    const scale = tallest(items.filter((item) => D.entries[item.entry].color !== -1)) || tallest(items) || 1;
    items.forEach((item, k) => {
      const base = m.top + rowHeight * (k + 1) - 9, room = narrow ? 24 : 28, group = s("g");
      group.append(s("text", narrow ? { x: m.left, y: base - room - 4, class: "label ink" } : { x: m.left - 12, y: base - 4, class: "label ink", "text-anchor": "end" }, brief(item.entry, narrow ? 34 : 21)));
      const binWidth = W / item.bins.length;
      item.bins.forEach((count, i) => { if (count) { const tall = Math.min(room, (room * count) / Math.max(1, item.n) / scale); group.append(s("rect", { x: r1(m.left + i * binWidth + 0.5), width: r1(binWidth - 1), y: r1(base - tall), height: r1(tall), fill: color(item.entry), "fill-opacity": 0.42 })); } });
      group.append(s("line", { class: "axis", x1: m.left, x2: m.left + W, y1: base, y2: base }));
      const mean = item.restricted_s;
      if (mean && mean[0] !== null) group.append(s("line", { x1: X(mean[1] ?? mean[0]), x2: X(mean[2] ?? mean[0]), y1: base + 4, y2: base + 4, stroke: color(item.entry), "stroke-width": 3 }), s("circle", { cx: X(mean[0]), cy: base + 4, r: 3.6, fill: color(item.entry) }));
      const median = item.median_s;
      if (median && median[0] !== null) group.append(s("path", { d: `M${X(median[0])} ${base - room}V${base}`, stroke: "var(--ink)", "stroke-width": 1.4 }));
      const share = item.n ? item.n_missed / item.n : 0;
      group.append(s("rect", { x: width - m.right + 14, y: base - room * share, width: 12, height: room * share, fill: "var(--solid)" }), s("rect", { x: width - m.right + 14, y: base - room, width: 12, height: room, fill: "none", stroke: "var(--line)" }), s("text", { x: width - 2, y: base - 4, "text-anchor": "end" }, percent(share)));
      group.append(s("rect", { x: 0, y: base - rowHeight + 9, width, height: rowHeight, fill: "transparent" }));
      hover(group, () => [h("b", {}, name(item.entry)), h("div", {}, `restricted mean ${estimate(item.restricted_s, seconds)}`), h("div", {}, item.median_s && item.median_s[0] !== null ? `median ${interval(item.median_s[0], item.median_s[1], item.median_s[2], (v) => (v === null ? "never" : seconds(v)))}` : "median: fewer than half found it"), h("div", {}, `mean of the successes alone ${estimate(item.found_s, seconds)}`), h("div", {}, `not found in ${item.n_missed} of ${item.n}`)]);
      svg.append(group);
    });
    host.replaceChildren(svg);
    figuresTable(figure, ["entry", "n", "restricted mean", "median", "expected with restarts", "mean of successes alone", "not found"], () => items.map((item) => [name(item.entry), String(item.n), estimate(item.restricted_s, seconds), item.median_s && item.median_s[0] !== null ? estimate(item.median_s, seconds) : "not reached", item.expected_s && item.expected_s[0] !== null ? estimate(item.expected_s, seconds) : "infinite", item.found_s ? `${estimate(item.found_s, seconds)}, n ${item.found_s[3]}` : "–", `${item.n_missed} of ${item.n}`]));
  }

  function pairsChart(figure, pairs) {
    const host = one(".canvas", figure) || figure.insertBefore(h("div", { class: "canvas" }), figure.firstChild);
    const order = pairs.order.filter((e) => state.on.has(e)), k = order.length;
    const width = Math.max(280, host.clientWidth || 600), left = Math.min(170, width * 0.32);
    const size = Math.max(9, Math.min(62, (width - left - 52) / Math.max(1, k))), text = size >= 27;
    const high = Math.min(110, 14 + 6.2 * Math.max(0, ...order.map((e) => Math.min(16, brief(e, 16).length))));
    const total = left + size * k + 50, height = high + size * k + 4;
    const svg = s("svg", { viewBox: `0 0 ${Math.max(width, total)} ${height}`, role: "img", "aria-label": "Matrix of pairs: the entry of the row against the entry of the column. Figures in the table below." });
    const cells = new Map(pairs.cells.map((cell) => [cell.a * 1000 + cell.b, cell]));
    const turn = (x, f) => [f(x[0]), x[2] === null ? null : f(x[2]), x[1] === null ? null : f(x[1]), x[3]];
    // The pair as the entry of the row sees it.
    const cellOf = (a, b) => { const c = cells.get(a * 1000 + b), d = cells.get(b * 1000 + a); return c || (d ? { ...d, verdict: -d.verdict, score: turn(d.score, (v) => -v), success: turn(d.success, (v) => -v), a_better: turn(d.a_better, (v) => 1 - v) } : null); };
    order.forEach((e, i) => {
      svg.append(s("text", { class: "label ink", x: left - 8, y: high + size * (i + 0.5) + 4, "text-anchor": "end" }, brief(e, Math.floor(left / 7.4))));
      const x = left + size * (i + 0.5);
      svg.append(s("text", { class: "label ink", transform: `translate(${x + 4} ${high - 6}) rotate(-42)` }, brief(e, 16)));
    });
    order.forEach((a, i) => order.forEach((b, j) => {
      const x = left + size * j, y = high + size * i, pad = size > 20 ? 1 : 0.5;
      if (a === b) { svg.append(s("rect", { x: x + pad, y: y + pad, width: size - 2 * pad, height: size - 2 * pad, fill: "var(--sunk)" })); return; }
      const c = cellOf(a, b);
      if (!c) return;
      const strength = c.verdict > 0 ? 0.25 + 0.75 * Math.min(1, Math.max(0, 2 * (c.a_better[0] ?? 0.5) - 1)) : 0;
      const group = s("g", {}, s("rect", { x: x + pad, y: y + pad, width: size - 2 * pad, height: size - 2 * pad, rx: size > 20 ? 3 : 0, fill: c.verdict > 0 ? "var(--accent)" : "var(--panel)", "fill-opacity": c.verdict > 0 ? strength : 1, stroke: c.verdict > 0 ? "none" : c.is_same ? "var(--accent)" : "var(--line)", "stroke-dasharray": c.is_same ? "2 2" : "none" }));
      if (text) group.append(s("text", { x: x + size / 2, y: y + size / 2 + 4, "text-anchor": "middle", style: c.verdict > 0 ? `fill:${strength > 0.6 ? "var(--on-accent)" : "var(--ink)"};font-weight:600` : c.verdict < 0 ? "fill:var(--faint)" : "fill:var(--soft)" }, signed(c.success[0])));
      hover(group, () => [h("b", {}, `${name(a)} against ${name(b)}`), h("div", {}, c.verdict > 0 ? "better" : c.verdict < 0 ? "worse" : c.is_same ? "equally successful" : "open: neither a difference nor equality is shown"), h("div", {}, `score, mean difference ${interval(c.score[0], c.score[1], c.score[2], plain)}`), h("div", {}, `success ${interval(c.success[0], c.success[1], c.success[2], signed)} points`), h("div", {}, `better in ${estimate(c.a_better, percent)} of ${c.score[3]} pairs`), h("div", {}, `p ${c.p === null ? "–" : c.p < 0.001 ? "< 0.001" : c.p.toFixed(3)}, corrected for all pairs`)]);
      svg.append(group);
    }));
    const wrap = h("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Matrix of pairs" }, svg);
    if (total > width) svg.style.minWidth = `${total}px`;
    host.replaceChildren(wrap);
    figuresTable(figure, ["pair", "n", "score, difference", "success, points", "better in", "p, corrected", ""], () => order.flatMap((a, i) => order.slice(i + 1).map((b) => { const c = cellOf(a, b); return !c ? [`${name(a)} – ${name(b)}`, "0"] : [`${name(a)} – ${name(b)}`, String(c.score[3]), interval(c.score[0], c.score[1], c.score[2], plain), interval(c.success[0], c.success[1], c.success[2], signed), estimate(c.a_better, percent), c.p === null ? "–" : c.p < 0.001 ? "< 0.001" : c.p.toFixed(3), c.verdict > 0 ? "first is better" : c.verdict < 0 ? "second is better" : c.is_same ? "equally successful" : "open"]; })));
  }

  // ---------------------------------------------------------------- rooms: success by start, tracks
  function roomPanels(figure, draw) {
    const host = one(".canvas", figure) || figure.insertBefore(h("div", { class: "canvas" }), figure.firstChild);
    const rooms = D.rooms.map((room, i) => [room, i]).filter(([room]) => view().scenarios.includes(room.scenario));
    let pick = figure.pick;
    if (pick === undefined || !rooms.some(([, i]) => i === pick)) pick = rooms.length ? rooms[0][1] : -1;
    figure.pick = pick;
    const nodes = [];
    if (rooms.length > 1) {
      const select = h("select", { "aria-label": "room" });
      for (const [room, i] of rooms) { const option = h("option", { value: i }, room.label); option.selected = i === pick; select.append(option); }
      select.addEventListener("change", () => { figure.pick = +select.value; roomPanels(figure, draw); one("select", host).focus(); });
      nodes.push(h("div", { class: "pick" }, h("label", {}, "Room ", select), roomNote(D.rooms[pick])));
    }
    else if (pick >= 0) nodes.push(h("div", { class: "pick" }, roomNote(D.rooms[pick])));
    const grid = h("div", { class: "panels" });
    const order = D.order.filter((e) => state.on.has(e));
    const rows = [];
    if (pick >= 0) for (const e of order) { const panel = draw(D.rooms[pick], pick, e, rows); if (panel) grid.append(panel); }
    nodes.push(grid);
    host.replaceChildren(...nodes);
    if (draw === startPanel) figuresTable(figure, ["start", "entry", "success", "n"], () => rows);
  }
  function roomNote(room) {
    const [x0, y0, x1, y1] = room.box_m, metres = (v) => String(+v.toFixed(2)), size = `${room.label}: ${metres(x1 - x0)} by ${metres(y1 - y0)} m`;
    return h("span", {}, room.height_m === null ? `${size}, no plan` : `${size} at ${plain(room.height_m)} m height` + (room.greatest_ppm ? `; gas up to ${plain(room.greatest_ppm)} ppm on average` : ""));
  }
  const pictureOf = (room) => (room.picture ? room.picture.href : null);
  function startPanel(room, index, e, rows) {
    const starts = D.starts.filter((item) => item.room === index && item.entry === e);
    if (!starts.length) return null;
    const { svg, Y, unit } = roomSvg(room, pictureOf(room), `Success of ${name(e)} by start in ${room.label}; figures in the table below.`);
    let near = Infinity;
    starts.forEach((a, i) => starts.forEach((b, j) => { if (i < j) near = Math.min(near, Math.max(Math.abs(a.x_m - b.x_m), Math.abs(a.y_m - b.y_m)) || Infinity); }));
    const size = Math.min(22 * unit, Math.max(5 * unit, Math.min(near, 25 * unit) * 0.84));
    for (const { x_m: x, y_m: y, success: p } of starts) {
      rows.push([`${plain(x)}, ${plain(y)} m`, name(e), estimate(p, percent), String(p[3])]);
      const group = s("g", {}, s("rect", { x: x - size / 2, y: Y(y) - size / 2, width: size, height: size, rx: unit, fill: "var(--paper)", "fill-opacity": 0.8 }), s("rect", { x: x - size / 2, y: Y(y) - size / 2, width: size, height: size, rx: unit, fill: "var(--accent)", "fill-opacity": 0.04 + 0.92 * p[0], stroke: "var(--accent)", "stroke-opacity": 0.5, "stroke-width": 0.3 * unit }));
      if (size > 7 * unit) group.append(s("text", { x, y: Y(y) + 2.1 * unit, "text-anchor": "middle", style: `font-size:${Math.min(6.2 * unit, size * 0.4)}px;fill:${p[0] > 0.52 ? "var(--on-accent)" : "var(--ink)"}` }, (100 * p[0]).toFixed(0)));
      hover(group, () => [h("b", {}, `${name(e)} from ${plain(x)}, ${plain(y)} m`), h("div", {}, `success ${estimate(p, percent)}, n ${p[3]}`)]);
      svg.append(group);
    }
    sourceMark(svg, room.sources_m, Y, unit);
    return h("div", { class: "panel" }, heading(e), svg);
  }
  function heading(e, note) { return h("h3", {}, swatch(e), brief(e, 28), note ? h("small", {}, note) : null); }
  function trackPanel(room, index, e) {
    const tracks = D.tracks.filter((track) => track.room === index && track.entry === e);
    if (!tracks.length) return null;
    const flights = new Set(tracks.map((track) => track.id)).size, found = new Set(tracks.filter((track) => track.found).map((track) => track.id)).size;
    const { svg, Y, unit } = roomSvg(room, pictureOf(room), `${flights} flights of ${name(e)} in ${room.label}, of which ${found} found the source.`);
    for (const track of [...tracks].sort((a, b) => a.found - b.found)) {
      const { group, line, d } = trackMarks(unpack(track.packed, D.quanta), D.entries[e], track.found, Y, unit);
      const wide = s("path", { d, fill: "none", stroke: "transparent", "stroke-width": 3 * unit, style: "cursor:pointer" });
      const width = line.getAttribute("stroke-width"), opacity = line.getAttribute("stroke-opacity");
      group.append(wide);
      group.addEventListener("pointerenter", () => { line.setAttribute("stroke-width", 1.5 * unit); line.setAttribute("stroke-opacity", 1); });
      group.addEventListener("pointerleave", () => { line.setAttribute("stroke-width", width); line.setAttribute("stroke-opacity", opacity); });
      wide.addEventListener("click", () => { copy(D.entries[e].command + track.id); say("command copied"); });
      hover(group, () => [h("b", {}, `${name(e)}: ${track.outcome}`), h("div", {}, track.case), h("div", {}, `${seconds(track.end_s)}; a click copies the command that flies it again`), h("code", {}, track.id)]);
      svg.append(group);
    }
    sourceMark(svg, room.sources_m, Y, unit);
    return h("div", { class: "panel" }, heading(e, `${found} of ${flights}`), svg);
  }

  // ---------------------------------------------------------------- filter, legend, sort
  const figures = all("figure[data-plot]"), visible = new Set(), stale = new Set(figures);
  function draw(figure) {
    if (!stale.has(figure)) return;
    stale.delete(figure);
    const host = figure.closest("[data-needs]");
    const there = !host || view().charts[host.dataset.needs] || view()[host.dataset.needs];
    if (host) { host.hidden = !there; const note = host.nextElementSibling; if (note && note.matches(".absent")) note.hidden = Boolean(there); }
    if (there) PLOTS[figure.dataset.plot](figure);
  }
  function refresh() { figures.forEach((figure) => stale.add(figure)); for (const figure of visible) draw(figure); }
  const watcher = new IntersectionObserver((items) => {
    for (const item of items) { if (item.isIntersecting) { visible.add(item.target); draw(item.target); } else visible.delete(item.target); }
  }, { rootMargin: "500px 0px" });
  figures.forEach((figure) => watcher.observe(figure));
  // The rest while nothing else happens, so that pictures of the whole page have them.
  const whenIdle = window.requestIdleCallback || ((work) => setTimeout(work, 30));
  function drawRest() { const next = stale.values().next().value; if (next) { draw(next); whenIdle(drawRest); } }
  whenIdle(drawRest);
  addEventListener("beforeprint", () => figures.forEach(draw));
  let before = innerWidth, waiting = null;
  addEventListener("resize", () => { if (innerWidth === before) return; before = innerWidth; clearTimeout(waiting); waiting = setTimeout(refresh, 120); });

  const legend = one("#legend");
  if (legend) {
    const chips = D.order.map((e) => {
      const chip = h("button", { type: "button", class: "chip", "aria-pressed": String(state.on.has(e)), title: D.entries[e].name }, swatch(e), brief(e, 26));
      chip.addEventListener("click", () => { state.on.has(e) ? state.on.delete(e) : state.on.add(e); mark(); refresh(); });
      const light = (strong) => all(".plot [data-e]").forEach((node) => node.classList.toggle("dim", strong && +node.dataset.e !== e));
      chip.addEventListener("pointerenter", () => light(state.on.has(e)));
      chip.addEventListener("pointerleave", () => light(false));
      return [e, chip];
    });
    const mark = () => chips.forEach(([e, chip]) => chip.setAttribute("aria-pressed", String(state.on.has(e))));
    legend.append(...chips.map(([, chip]) => chip));
    if (chips.length > 2) {
      const everyone = h("button", { type: "button", class: "quiet" }, "all"), nobody = h("button", { type: "button", class: "quiet" }, "none");
      everyone.addEventListener("click", () => { D.order.forEach((e) => state.on.add(e)); mark(); refresh(); });
      nobody.addEventListener("click", () => { state.on.clear(); mark(); refresh(); });
      legend.append(everyone, nobody);
    }
  }
  const filter = one("#filter");
  if (filter) filter.addEventListener("change", () => {
    state.view = +filter.value;
    all("[data-view]").forEach((node) => { node.hidden = +node.dataset.view !== state.view; });
    say(`showing ${view().label}`);
    refresh();
  });

  const board = one("table.board");
  if (board) {
    const heads = all("thead th", board);
    heads.forEach((head, column) => {
      const button = one("button", head);
      if (!button) return;
      button.addEventListener("click", () => {
        const first = head.dataset.first || "descending";
        const now = head.getAttribute("aria-sort");
        const next = now === null ? first : now === "ascending" ? "descending" : "ascending";
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", next);
        const sign = next === "ascending" ? 1 : -1;
        const key = (row) => { const value = row.cells[column].dataset.v; return value === undefined || value === "" ? null : isNaN(value) ? value : +value; };
        for (const body of all("tbody", board)) {
          const rows = [...body.rows].map((row) => [key(row), row]);
          rows.sort(([a], [b]) => (a === null ? (b === null ? 0 : 1) : b === null ? -1 : typeof a === "string" || typeof b === "string" ? sign * String(a).localeCompare(String(b)) : sign * (a - b)));
          body.append(...rows.map(([, row]) => row));
        }
        say(`sorted by ${button.textContent}, ${next}`);
      });
    });
  }

  const links = new Map(all("nav.contents a").map((link) => [link.hash.slice(1), link]));
  const reader = new IntersectionObserver((items) => {
    for (const item of items) if (item.isIntersecting) { links.forEach((link) => link.removeAttribute("aria-current")); const link = links.get(item.target.id); if (link) link.setAttribute("aria-current", "true"); }
  }, { rootMargin: "-20% 0px -70% 0px" });
  all("main section[id]").forEach((section) => reader.observe(section));
})();
