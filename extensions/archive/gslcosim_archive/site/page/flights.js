"use strict";
// Draws flights over the plan of a case: a player on the case's page, small pictures on a method's page.
// A file of tracks/ hands its case over by calling `flights(file, data)`.
const flights = (() => {
  const { one, all, s, h, plain, seconds, r1, say, color, dash, swatch, roomSvg, unpack, wayOf, startMark, trackMarks, sourceMark, hover } = pieces;
  const NARROW = "\u202f", CONTROL = 1, SUCCESS = 2, NO_RESULT = 4;
  const isControl = (flight) => Boolean(flight.flags & CONTROL), hasFound = (flight) => Boolean(flight.flags & SUCCESS);
  const loaded = new Map(), waiting = new Map();

  function receive(file, data) {
    const made = { ...data, flights: data.flights.map(([id, method, repetition, flags, outcome, end, time, nearest, tracks, gas, view, source]) => ({ id, method: data.methods[method], repetition, flags, outcome: data.outcomes[outcome], end, time, nearest, packed: tracks, gas, view, source })) };
    loaded.set(file, made);
    (waiting.get(file) || []).forEach((work) => work(made));
    waiting.delete(file);
  }
  function whenLoaded(file, work) {
    if (loaded.has(file)) { work(loaded.get(file)); return; }
    if (waiting.has(file)) { waiting.get(file).push(work); return; }
    waiting.set(file, [work]);
    if (!all("script[src]").some((script) => script.getAttribute("src") === `../tracks/${file}.js`)) document.body.append(h("script", { src: `../tracks/${file}.js` }));
  }

  // ---------------------------------------------------------------- tracks
  const tracksOf = (data, flight) => (flight.tracks ??= flight.packed.map((text) => unpack(text, data.quanta)));
  // Last kept place before a time, and the place at that time.
  function placeAt(track, t) {
    let low = 0, high = track.t.length - 1;
    while (low < high) { const middle = (low + high + 1) >> 1; if (track.t[middle] <= t) low = middle; else high = middle - 1; }
    const next = Math.min(low + 1, track.t.length - 1), span = track.t[next] - track.t[low];
    const share = span > 0 ? Math.max(0, Math.min(1, (t - track.t[low]) / span)) : 0;
    return [low, track.x[low] + share * (track.x[next] - track.x[low]), track.y[low] + share * (track.y[next] - track.y[low])];
  }
  const gasAt = (flight, t) => (flight.gas && t <= flight.end ? parseInt(flight.gas[Math.min(flight.gas.length - 1, Math.floor((t / flight.end) * flight.gas.length))], 16) : 0);
  function outcomeOf(flight) {
    if (flight.flags & NO_RESULT) return `no result: ${flight.outcome}`;
    if (hasFound(flight)) return `found after ${seconds(flight.time).replace(" ", NARROW)}`;
    return `${flight.outcome.replace(/_/g, " ")}${flight.nearest === null ? "" : `, nearest ${plain(flight.nearest)}${NARROW}m`}`;
  }

  // ---------------------------------------------------------------- plan
  // Flights of repetitions with sources of their own are drawn over the plan without the mapped gas.
  function planSvg(data, label, flown) {
    return roomSvg(data.room, data.plan && `../plans/${flown.some((flight) => flight.source) ? data.plan_without_gas : data.plan}.png`, label);
  }
  function sourceMarks(svg, data, flown, Y, unit) {
    const own = new Map(flown.map((flight) => (flight.source ? [String(flight.source), [flight.source]] : ["mapped", data.room.sources_m])));
    sourceMark(svg, own.size ? [...own.values()].flat() : data.room.sources_m, Y, unit);
  }
  function windStrokes(svg, data, Y, unit) {
    const group = s("g", { stroke: "var(--faint)", "stroke-width": 0.28 * unit, "stroke-opacity": 0.6, fill: "none", "aria-hidden": "true" });
    for (const [x, y, towardX, towardY] of data.wind) {
      const a = 1.6 * unit, tipX = x + a * towardX, tipY = Y(y) - a * towardY, tailX = x - a * towardX, tailY = Y(y) + a * towardY;
      const barb = (side) => `${tipX - 0.45 * a * (towardX + side * towardY)} ${tipY + 0.45 * a * (towardY - side * towardX)}`;
      group.append(s("path", { d: `M${tailX} ${tailY}L${tipX} ${tipY}M${barb(0.7)}L${tipX} ${tipY}L${barb(-0.7)}` }));
    }
    svg.append(group);
  }
  // ---------------------------------------------------------------- small pictures
  function smallPicture(panel, data) {
    const mine = data.flights.filter((flight) => flight.method.file === panel.dataset.entry && !isControl(flight));
    const { svg, Y, unit } = planSvg(data, `Tracks of ${mine.length} flights in ${data.name}`, mine);
    for (const flight of [...mine].sort((a, b) => hasFound(a) - hasFound(b))) for (const track of tracksOf(data, flight)) svg.append(trackMarks(track, flight.method, hasFound(flight), Y, unit).group);
    sourceMarks(svg, data, mine, Y, unit);
    panel.append(svg);
  }

  // ---------------------------------------------------------------- player
  // Links in the table of entries, each to a flight.
  function linkFlights(cell, data) {
    const mine = data.flights.filter((flight) => flight.method.file === cell.dataset.entry).sort((a, b) => isControl(a) - isControl(b));
    mine.forEach((flight, i) => {
      if (isControl(flight) && (!i || !isControl(mine[i - 1]))) cell.append(h("span", { class: "without" }, "without gas: "));
      const text = hasFound(flight) ? `${flight.time.toFixed(0)}${NARROW}s` : flight.outcome.replace(/_/g, " ");
      cell.append(h("a", { class: hasFound(flight) ? "run found" : "run", href: `#${encodeURIComponent(flight.id)}`, title: `repetition ${flight.repetition}` }, text), " ");
    });
  }

  const SPEEDS = [1, 2, 5, 10, 20, 50, 100], WHOLE_S = 12, MOST_AT_FIRST = 8, FEW_PICTURES = 24;
  function player(root, data) {
    const groups = [...new Map(data.flights.map((flight) => [groupOf(flight), flight])).entries()].sort(([, a], [, b]) => isControl(a) - isControl(b) || a.repetition - b.repetition).map(([key]) => key);
    const state = { group: groups[0], on: new Set(), t: 0, playing: false, speed: 1, last: null, chosen: null };
    let shown = [], drawn = [], longest = 1;

    const stage = h("div", { class: "stage" });
    const play = h("button", { type: "button", class: "play" }, "Play");
    const slider = h("input", { type: "range", min: 0, max: 1000, step: 5, value: 1000, "aria-label": "time" });
    const clock = h("output", {});
    const speed = h("select", { "aria-label": "speed" }, ...SPEEDS.map((factor) => h("option", { value: factor }, `${factor} ×`)));
    const pick = h("select", {}, ...groups.map((key) => h("option", { value: key }, key)));
    const legend = h("div", { class: "legend", role: "group", "aria-label": "Entries in the player" });
    const body = h("tbody");
    const list = h("table", {}, h("caption", { class: "hidden-text" }, "Flights in the player"), h("thead", {}, h("tr", {}, ...["entry", "how it ended", "gas at the nose", "command"].map((text) => h("th", { scope: "col", class: "left" }, text)))), body);
    root.replaceChildren(
      h("div", {}, stage, h("div", { class: "controls" }, play, slider, clock, h("label", {}, "Speed ", speed))),
      h("div", { class: "side" }, h("div", { class: "pick" }, h("label", {}, "Repetition ", pick)), legend, h("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Flights in the player" }, list),
        data.full_ppm ? h("p", { class: "note" }, `A full bar is ${plain(data.full_ppm)} ppm; the scale is logarithmic over ${data.decades} decades.`) : null),
    );

    function groupOf(flight) { return isControl(flight) ? `${flight.repetition}, without gas` : String(flight.repetition); }
    const here = () => data.flights.filter((flight) => groupOf(flight) === state.group);

    function choose() {
      shown = here().filter((flight) => (state.chosen ? flight.id === state.chosen : state.on.has(flight.method)));
      longest = Math.max(1, ...shown.map((flight) => flight.end || 0));
      const best = SPEEDS.find((factor) => longest / factor <= WHOLE_S) || SPEEDS[SPEEDS.length - 1];
      speed.value = best; state.speed = best;
      pause();
      const { svg, Y, unit } = planSvg(data, `${shown.length} ${shown.length === 1 ? "flight" : "flights"} in ${data.name}; the table beside says how each ended.`, here());
      windStrokes(svg, data, Y, unit);
      drawn = shown.map((flight) => {
        const parts = tracksOf(data, flight).map((track) => {
          const ghost = s("path", { d: wayOf(track, Y), fill: "none", stroke: color(flight.method), "stroke-width": 0.4 * unit, "stroke-opacity": 0.28, "stroke-linejoin": "round" });
          const way = s("path", { fill: "none", stroke: color(flight.method), "stroke-width": 0.75 * unit, "stroke-linejoin": "round", "stroke-dasharray": dash(flight.method) && dash(flight.method).split(" ").map((part) => part * 0.35 * unit).join(" ") });
          const start = startMark(track, Y, unit);
          const halo = s("circle", { r: 0, fill: "rgba(var(--gas), .5)" });
          const robot = s("circle", { r: 1.3 * unit, fill: color(flight.method), stroke: "var(--paper)", "stroke-width": 0.4 * unit });
          svg.append(ghost, way, start, halo, robot);
          hover(robot, () => [h("b", {}, flight.method.name), h("div", {}, outcomeOf(flight))]);
          return { track, way, halo, robot };
        });
        return { flight, parts, Y, unit, cursor: null };
      });
      sourceMarks(svg, data, here(), Y, unit);
      stage.replaceChildren(svg);
      body.replaceChildren(...drawn.map((item) => row(item)));
      if (!shown.length) body.replaceChildren(h("tr", {}, h("td", { colspan: 4, class: "left none" }, "No entry is chosen.")));
      all("a.run").forEach((link) => { if (state.chosen && decodeURIComponent(link.hash.slice(1)) === state.chosen) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current"); });
      chips.forEach(([method, chip]) => chip.setAttribute("aria-pressed", String(shown.some((flight) => flight.method === method))));
      pick.value = state.group;
      move(longest);
    }
    function row(item) {
      const { flight } = item, command = flight.method.command + flight.id;
      const trace = s("svg", { viewBox: "0 0 300 22", preserveAspectRatio: "none", role: "img", "aria-label": flight.gas ? "gas at the nose over time" : "no gas at the nose" });
      const width = (300 * (flight.end || 0)) / longest;
      trace.append(s("rect", { x: 0, y: 20.5, width, height: 1, fill: "var(--solid)" }));
      [...flight.gas].forEach((digit, i) => { const level = parseInt(digit, 16); if (level) trace.append(s("rect", { x: r1((i * width) / flight.gas.length), y: r1(20.5 - 1.3 * level), width: r1(width / flight.gas.length), height: r1(1.3 * level), fill: "rgb(var(--gas))" })); });
      item.cursor = s("rect", { x: 0, y: 0, width: 1.4, height: 22, fill: "var(--ink)" });
      trace.append(item.cursor);
      const again = [h("button", { type: "button", class: "copy", "data-text": command, title: command, "aria-label": `copy the command that flies ${flight.method.name} again` }, "copy")];
      if (flight.view) again.push(" ", h("button", { type: "button", class: "copy", "data-text": flight.view, title: flight.view, "aria-label": `copy the command that opens the recording of ${flight.method.name}` }, "view"));
      return h("tr", {}, h("th", { scope: "row" }, h("span", { class: "hue" }, swatch(flight.method), h("a", { href: `../methods/${flight.method.file}.html` }, flight.method.name))),
        h("td", { class: "left ended" }, outcomeOf(flight) + (flight.packed.length ? "" : "; no track")), h("td", { class: "trace" }, trace), h("td", { class: "left" }, ...again));
    }
    function move(t) {
      state.t = t;
      for (const { flight, parts, Y, unit, cursor } of drawn) {
        for (const part of parts) {
          const { track, way, halo, robot } = part, at = Math.min(t, track.t[track.t.length - 1]);
          // What has ended stays as it is.
          if (part.at === at) continue;
          part.at = at;
          const [last, x, y] = placeAt(track, at), level = gasAt(flight, at);
          way.setAttribute("d", `${wayOf(track, Y, last)}L${x.toFixed(2)} ${Y(y).toFixed(2)}`);
          for (const mark of [halo, robot]) { mark.setAttribute("cx", x.toFixed(2)); mark.setAttribute("cy", Y(y).toFixed(2)); }
          halo.setAttribute("r", level ? (1.6 + 0.2 * level) * unit : 0);
        }
        cursor.setAttribute("x", r1((298.6 * Math.min(t, flight.end || 0)) / longest));
      }
      slider.value = Math.round((1000 * t) / longest);
      const text = `${t.toFixed(1)} of ${longest.toFixed(1)} s`;
      slider.setAttribute("aria-valuetext", text);
      clock.textContent = text;
    }
    function step(now) {
      if (!state.playing) return;
      if (state.last !== null) move(Math.min(longest, state.t + ((now - state.last) / 1000) * state.speed));
      state.last = now;
      if (state.t >= longest) { pause(); say(drawn.map(({ flight }) => `${flight.method.name} ${outcomeOf(flight)}`).join("; ")); return; }
      requestAnimationFrame(step);
    }
    function pause() { state.playing = false; play.textContent = "Play"; }
    play.addEventListener("click", () => {
      if (state.playing) { pause(); return; }
      if (state.t >= longest) move(0);
      state.playing = true; state.last = null; play.textContent = "Pause";
      requestAnimationFrame(step);
    });
    slider.addEventListener("input", () => { pause(); move((slider.value * longest) / 1000); });
    speed.addEventListener("change", () => { state.speed = +speed.value; });
    // What was chosen by a link is let go as soon as something else is chosen here.
    function release() { if (state.chosen) { state.on = new Set(shown.map((flight) => flight.method)); state.chosen = null; } }
    pick.addEventListener("change", () => { release(); state.group = pick.value; choose(); });

    const chips = data.methods.map((method) => {
      const chip = h("button", { type: "button", class: "chip" }, swatch(method), method.name);
      chip.addEventListener("click", () => { release(); if (state.on.has(method)) state.on.delete(method); else state.on.add(method); choose(); });
      return [method, chip];
    });
    const everyone = h("button", { type: "button", class: "quiet" }, "all"), nobody = h("button", { type: "button", class: "quiet" }, "none");
    everyone.addEventListener("click", () => { release(); state.on = new Set(data.methods); choose(); });
    nobody.addEventListener("click", () => { release(); state.on.clear(); choose(); });
    legend.append(...chips.map(([, chip]) => chip), everyone, nobody);

    // #TRIAL plays a flight, #entry=FILE shows an entry.
    function follow() {
      let wanted = "";
      try { wanted = decodeURIComponent(location.hash.slice(1)); } catch { /* somebody has typed it */ }
      const flight = wanted && data.flights.find(({ id }) => wanted.startsWith(id));
      const file = wanted.startsWith("entry=") ? wanted.slice(6) : null, method = data.methods.find((each) => each.file === file);
      if (flight) { state.group = groupOf(flight); state.chosen = flight.id; }
      else if (method) { state.on = new Set([method]); state.chosen = null; }
      else if (!state.on.size) state.on = new Set(data.methods.filter((each) => each.is_on).slice(0, MOST_AT_FIRST));
      choose();
      if (flight || method) one("#player").scrollIntoView();
    }
    addEventListener("hashchange", follow);
    follow();
  }

  all(".player").forEach((root) => whenLoaded(root.dataset.case, (data) => {
    all("td.runs").forEach((cell) => linkFlights(cell, data));
    player(root, data);
  }));
  const panels = all(".panel[data-case]"), open = new Set(panels);
  function show(panel) {
    watcher.unobserve(panel);
    if (open.delete(panel)) whenLoaded(panel.dataset.case, (data) => { smallPicture(panel, data); showRest(); });
  }
  const watcher = new IntersectionObserver((items) => { for (const { isIntersecting, target } of items) if (isIntersecting) show(target); }, { rootMargin: "900px 0px" });
  // Few pictures are all drawn while nothing else happens, so that the page as a whole or on paper has them.
  const whenIdle = window.requestIdleCallback || ((work) => setTimeout(work, 30));
  function showRest() { if (panels.length <= FEW_PICTURES) whenIdle(() => { const next = open.values().next().value; if (next) show(next); }); }
  panels.forEach((panel) => watcher.observe(panel));
  if (panels.length) showRest();
  return receive;
})();
