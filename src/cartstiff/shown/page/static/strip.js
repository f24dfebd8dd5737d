// A quantity along a sweep of one coordinate or along a trajectory, with a linked cursor.

import { CURVES, plotted } from "./curves.js";
import { LOST, SUPERSEDED, button, byId, clamp, dropdown, el, short, tipIn, toast } from "./dom.js";
import { heat } from "./heat.js";
import { wayOf } from "./loads.js";
import { PRINTED_AS_ZERO } from "./numerics.js";
import { player } from "./player.js";
import { CLOSER, Plot, isWhole, nearer } from "./plot.js";
import { LETTER, provenance, saveList, savePlot, svg } from "./plotfiles.js";
import { curvesOf, inDegrees, inWords } from "./store.js";
import { traceOf } from "./trace.js";

export const MARGIN = { left: 52, right: 12, top: 20, bottom: 18 };
// Length of a line in the key, in dots.
const SAMPLE = 26;
// Width from which on the key names what is compared, too: that has its name at its end.
const KEY_FITS = 460;
// Half the width of the slider's thumb: its middle runs below the plot.
const THUMB = 8;
// Share of a curve that is seen at least (a step of a sweep is 1/60).
const LEAST_SEEN = 0.02;
// Where this many sweeps in succession took longer than that (s), they are not repeated by themselves: the
// first of all may wait for machine code to be made, and the next ones are quick.
const [SLOW_SWEEPS, QUICK] = [2, 1];
const SIGNS = { worst: "▼", best: "▲" };
const SAVED_AS = [["", "Save"], ["svg", "SVG"], ["csv", "CSV"], ["png1", "PNG"],
  ...[2, 3, 4].map((n) => [`png${n}`, `PNG × ${n}`])];

/** Ends of an axis, in what its lines are even in. */
function range(list, isLog) {
  const high = Math.max(...list);
  // Twelve decades at most: what is below is as good as zero.
  const low = Math.max(Math.min(...list), isLog ? high - 12 : -Infinity);
  const half = Math.max(isLog ? 0.15 : 0.02 * Math.max(Math.abs(high), Math.abs(low)), 0.54 * (high - low));
  return [(high + low) / 2 - half, (high + low) / 2 + half];
}

/** Why nothing is drawn, in few words. */
const gapWords = (row, why) => (row.moved ? "loops do not close" : row.reason ? "not reached" : why(row));

export function strip(store) {
  let series = null; // {coordinate, or null along the trajectory; state, at, rows, key, others}
  let position = 0; // index into the series
  let asked = null;
  let timer = null;
  let slow = 0; // sweeps in succession that took long
  let keeping = null; // the kind of a file that waits for its values
  // What is plotted, which an address holds: the quantity, along what, against what else, and the ends of what is seen.
  const usual = { of: "translation", along: "", and: "", values: "log", seen: null };
  store.plot = { ...usual };
  store.usualPlot = usual;
  // Words, units and values are of the state that the rows are of, whatever is wished meanwhile.
  const now = ({ state, rows } = series) => plotted(store, store.plot.of, state, rows);

  const what = dropdown("Along what", [], (along) => showPlot({ along, seen: null }));
  const quantity = dropdown("Values of", CURVES.map(({ key: name, words }) => [name, words]), (of) => showPlot({ of }),
    { title: "What the curves show" });
  const scale = dropdown("Values by", [["log", "log"], ["linear", "linear"]], (values) => showPlot({ values }),
    { title: "Equal steps of the values, or equal factors" });
  const plot = new Plot(MARGIN, () => draw());
  const map = heat(store, {
    shown: now, showPlot, busy: () => asked !== null, computed: () => write(),
      say: (words, event) => reading.say(words, event), tell: (found) => nameEnds(found),
    along: () => (what.value.startsWith("sweep") && what.value !== `sweep:${store.plot.and}`
      ? Number(what.value.slice(6)) : null),
    toggle: (on) => {
      scale.hidden = on;
      plot.node.style.display = on ? "none" : "";
      byId("strip").classList.toggle("mapped", on);
      setSlider();
    },
  });
  const play = button("▶", () => toggle(), { class: "play", title: "Play or pause (p)", "aria-label": "Play" });
  const time = el("input", { type: "range", id: "time", min: 0, max: 1, step: "any", value: 0, "aria-label": "Time",
    title: "+ and \u2212 zoom the curves here" });
  const whole = button("whole", () => showPlot({ seen: null }),
    { class: "quiet", hidden: true, title: "The whole of the curves (double click)" });
  const label = el("span.num.small.time-label");
  const again = button("↻ compute", () => request(true),
    { class: "quiet", hidden: true, title: "The posture or the load has changed since this was computed" });
  const save = saveList("plot", SAVED_AS, keep, "The plot as a file, with what it shows", () => ({ isPlot: true }));
  const marks = Object.fromEntries(Object.keys(SIGNS).map((which) => [which, button("", () => {},
    { class: `quiet ${which}`, hidden: true, title: "Go there" })]));
  const cursor = svg("line", { class: "cursor" });
  const trace = traceOf(store, () => drawWay());
  byId("show-list").append(trace.box);
  byId("strip").append(
    el("div.row", el("span.dim.along", "Along"), what, map.select, quantity, scale, again,
      whole, marks.worst, marks.best, label, save),
    el("div.plots", plot.node, map.plot),
    el("div.time-row", play, time));
  const reading = tipIn(byId("strip"), "reading", [12, -30]);

  time.addEventListener("input", () => go(closest(time.valueAsNumber)));
  time.addEventListener("keydown", ({ key: pressed }) => {
    if (!series || !"+=-".includes(pressed)) return;
    const times = pressed === "-" ? 1 / CLOSER : CLOSER;
    if (map.on()) map.zoom(times);
    else zoom(times, series.at[position]);
  });
  plot.onwheel((times, event) => series && zoom(times, under(event)));
  plot.node.addEventListener("dblclick", () => showPlot({ seen: null }));
  plot.node.addEventListener("pointerdown", (event) => {
    if (!series) return;
    plot.node.setPointerCapture(event.pointerId);
    go(closest(under(event)));
  });
  plot.node.addEventListener("pointermove", (event) => {
    if (plot.node.hasPointerCapture(event.pointerId)) go(closest(under(event)));
    read(event);
  });
  plot.node.addEventListener("pointerleave", () => reading.say(null));

  /** The values under a pointer, in words. */
  function read(event) {
    if (!series) return reading.say(null);
    const k = closest(under(event));
    const { values, unit, why } = now();
    const found = values(series.rows[k]);
    reading.say(`${atText(series.at[k])}: ${found ? `${found.map((x) => short(x, 5)).join(", ")} ${unit}`
      : why(series.rows[k])}`, event);
  }

  /** Show something else; what a user wished is a step that can be taken back. */
  function showPlot(change, isStep = true) {
    if (isStep && store.numbers && Object.entries(change).some(([key, value]) =>
      String(store.plot[key]) !== String(value))) store.remember(`plot ${Object.keys(change)}`);
    Object.assign(store.plot, change);
    [what.value, quantity.value, map.select.value, scale.value] = [store.plot.along, store.plot.of, store.plot.and,
      store.plot.values];
    whole.hidden = !store.plot.seen;
    store.tell("plot");
    request(true);
    map.show();
    draw();
    map.request();
  }

  /** The plot as a file; one that is of something else than the page says is computed first. */
  function keep(kind) {
    keeping = kind;
    if (write()) return;
    toast("The file follows when its values are computed");
    request(true);
    map.request();
  }

  /** Write the file that waits, if what it is to hold is here. */
  function write() {
    const kind = keeping;
    if (!kind || !(map.on() ? map.current() : series && series.key === key())) return false;
    keeping = null;
    const name = `${store.hello.mechanism.name}-${store.plot.of}`;
    if (map.on()) map.keep(kind, name);
    else keepCurves(kind, name);
    return true;
  }

  function keepCurves(kind, name) {
    const { title, lines: names, unit, values, legend, why } = now();
    const first = isSweep() ? `${along()} [${coordinate().unit}]`
      : store.hello.trajectory.timed ? "time [s]" : "posture";
    if (series.others.length) legend.push(`dash-dot, with a name: ${names[0]} of ${series.others.map(({ called }) =>
      called).join(", ")}`);
    savePlot(kind, name, plot, { legend, names: [first, ...names.map((word) => `${word} [${unit}]`)],
      lines: provenance(store, series.state, `${title} [${unit}] along ${along()}`),
      rows: series.at.map((x, k) => (values(series.rows[k]) ? [x, ...values(series.rows[k]), null]
        : [x, ...names.map(() => null), why(series.rows[k])])) });
  }

  const all = () => [series.at[0], series.at.at(-1)];
  const seen = () => (store.plot.seen?.length === 2 && store.plot.seen) || all();

  /** See so many times less of the series, about a place. */
  function zoom(times, at) {
    const [first, last] = all();
    const part = nearer(seen(), [first, last], times, at, LEAST_SEEN * (last - first));
    showPlot({ seen: isWhole(part, [first, last]) ? null : part });
    return true;
  }

  /** Where along the series a pointer is. */
  const under = (event) => clamp(plot.across(...seen()).value(plot.dots(event)[0]), ...seen());
  /** The place of the series that is next to a value. */
  const closest = (x) => series.at.reduce((best, value, i) =>
    (Math.abs(value - x) < Math.abs(series.at[best] - x) ? i : best), 0);

  /** Take the mechanism to a place of the series. */
  function go(index) {
    if (!series) return;
    position = clamp(Math.round(index), 0, series.at.length - 1);
    const q = series.rows[position].q ?? (isSweep() && store.state.q.with(series.coordinate, series.at[position]));
    if (q) store.change({ q: q.slice(), moved: series.coordinate });
    showCursor();
  }

  const { toggle, stop, isPlaying } = player(play, {
    places: () => series?.at.length ?? 0, position: () => position, go,
    duration: () => (!isSweep() && store.hello.trajectory.timed ? series.at.at(-1) - series.at[0]
      : series.at.length / 15),
    returns: () => isSweep(),
  });

  /** What the curves depend on, besides the coordinate that runs. */
  function key() {
    const [kind, index] = what.value.split(":");
    const isSeries = kind === "series";
    const rows = isSeries ? [] : store.rows.map((row) => [row.title, row.kept?.state]);
    return JSON.stringify([what.value, rows, curvesOf(store, isSeries ? null : [Number(index)])]);
  }

  function request(now = false) {
    if (!store.state || !what.value || !store.source.moves) return;
    const wanted = key();
    if (series?.key === wanted) plot.node.classList.remove("stale");
    if (series?.key === wanted || asked?.wanted === wanted) {
      again.hidden = true;
      return showCursor();
    }
    clearTimeout(timer);
    plot.node.classList.toggle("stale", series !== null);
    const waits = slow >= SLOW_SWEEPS && !now;
    again.hidden = !waits;
    if (isPlaying() || waits) return;
    timer = setTimeout(() => compute(wanted), now ? 0 : 350);
  }

  async function compute(wanted) {
    const state = store.onTheWay();
    const own = asked = { wanted }; // asked for again after something else, it is another question
    const swept = what.value.startsWith("sweep") ? Number(what.value.slice(6)) : null;
    const question = swept === null ? { do: "series", state } : { do: "sweep", coordinate: swept, steps: 61, state };
    plot.node.classList.add("computing");
    if (!series) {
      plot.node.replaceChildren();
      plot.text(MARGIN.left, MARGIN.top + 24, "computing …", "start", "nothing");
    }
    const { at, rows, seconds, why = null } = await store.ask(question).catch(({ message }) => ({ why: message }));
    if (asked !== own) return;
    if (why === null) {
      series = { state, coordinate: swept, at, rows, key: wanted, others: [] };
      if (seen()[0] < at[0] || seen()[1] > at.at(-1)) showPlot({ seen: null }, false);
      again.hidden = true;
      plot.node.classList.remove("stale");
      draw();
      slow = seconds > QUICK ? slow + 1 : 0;
      if (swept !== null) for (const row of store.rows) {
        const other = await row.sweep(swept, 61).catch(() => null);
        if (asked !== own) return;
        if (other) series.others.push(other);
      }
      if (series.others.length) draw();
    } else if (![LOST, SUPERSEDED].includes(why)) {
      keeping = null;
      store.tell("error", why);
    }
    asked = null;
    plot.node.classList.remove("computing");
    if (why === LOST) return; // the next numbers ask again
    write();
    request(keeping !== null);
  }

  const isSweep = () => series.coordinate !== null;
  const coordinate = () => store.hello.mechanism.coordinates[series.coordinate];
  /** What the curves run along: not what is chosen, while others are computed. */
  const along = () => (isSweep() ? coordinate().name : "the trajectory");

  function atText(x) {
    if (isSweep()) return inWords(store, series.coordinate, x);
    return store.hello.trajectory.timed ? `${short(x)} s` : `posture ${Math.round(x) + 1}`;
  }

  /** The slider's ends are those of what is seen, below it. */
  function setSlider() {
    const { left, right } = map.on() ? map.margin : MARGIN;
    [time.style.marginLeft, time.style.width] = [`${left - THUMB}px`, `calc(100% - ${left + right - 2 * THUMB}px)`];
    if (series) [time.min, time.max] = map.on() ? all() : seen();
  }

  function showCursor() {
    if (!series) return;
    if (isSweep() && !isPlaying()) position = closest(store.state.q[series.coordinate]);
    const [first, last] = seen();
    setSlider();
    const exact = isSweep() ? store.state.q[series.coordinate] : series.at[position];
    time.value = exact;
    time.setAttribute("aria-valuetext", atText(series.at[position]));
    label.textContent = atText(exact);
    const x = plot.across(first, last).place(clamp(exact, first, last));
    cursor.style.display = exact < first || exact > last ? "none" : "";
    for (const [name, value] of Object.entries({ x1: x, x2: x, y1: MARGIN.top,
      y2: plot.height - MARGIN.bottom })) cursor.setAttribute(name, value);
  }

  /** What each line is, above the plot's right end. */
  function lineKey(names, isCompared) {
    let x = plot.width - MARGIN.right;
    const kinds = names.map((name, k) => [name, `${store.plot.of} curve-${k}`]);
    for (const [name, kind] of [...kinds, ...(isCompared && plot.width > KEY_FITS ? [["compared", "other"]] : [])]
      .toReversed()) {
      x -= plot.text(x, MARGIN.top - 8, name, "end", "unit key").getComputedTextLength() + 4;
      plot.add("path", { class: `curve key ${kind}`, d: `M${x - SAMPLE},${MARGIN.top - 12}h${SAMPLE}` });
      x -= SAMPLE + 12;
    }
  }

  /** The way through the places of the series, in the picture. */
  function drawWay() {
    if (series && trace.box.control.checked && !map.on()) trace.show(series.rows, now(), store.state.allowed);
    else if (store.trace) trace.show(null);
  }

  function draw() {
    const { width, height } = plot;
    drawWay();
    if (!series || map.on() || width < 80 || height < 40) return;
    const { values: valuesOf, unit, why, title: heading, lines: names } = now();
    const curves = names.map((_, k) => series.rows.map((row) => valuesOf(row)?.[k] ?? null));
    // Of what is compared with the least value, dashed.
    const overlaid = series.others.map(({ title, at, rows }) =>
      ({ title, at, values: rows.map((row) => valuesOf(row)?.[0] ?? null) }));
    const x = plot.across(...seen());
    // With the next one on either side, to which the curves go on.
    const isSeen = (at, i) => (at[i + 1] ?? at[i]) >= x.low && (at[i - 1] ?? at[i]) <= x.high;
    const isLog = store.plot.values !== "linear";
    const found = [...curves.map((values) => [series.at, values]), ...overlaid.map(({ at, values }) => [at, values])]
      .flatMap(([at, values]) => values.filter((value, i) => Number.isFinite(value) && (value > 0 || !isLog)
        && isSeen(at, i)));
    if (!found.length) {
      plot.say(why(series.rows.find((row) => row.q) ?? series.rows[0]));
      return showCursor();
    }
    plot.node.replaceChildren();
    const to = isLog ? Math.log10 : (value) => value;
    const y = plot.upwards(...range(found.map(to), isLog));
    plot.grid(y, isLog, `${unit === "1" ? "" : `${unit}, `}${isLog ? "log" : "linear"}`);
    const isAngle = isSweep() && inDegrees(store, coordinate());
    plot.rounds(x, isAngle ? 180 / Math.PI : 1, isAngle, atText);
    plot.add("pattern", { id: "hatching", width: 6, height: 6, patternUnits: "userSpaceOnUse",
      patternTransform: "rotate(45)" },
      svg("line", { class: "hatch", x1: 0, x2: 0, y1: 0, y2: 6 }));
    plot.clip("seen");
    gaps(x, valuesOf, why);
    const line = (values, at, kind) => {
      const points = values.map((value, i) => (value === null || (isLog && value <= 0) || !isSeen(at, i) ? null
        : [x.place(at[i]), clamp(y.place(to(value)), y.end, y.start)]));
      plot.path(points, { class: `curve ${kind}`, "clip-path": "url(#seen)" });
      return points.findLast(Boolean);
    };
    curves.forEach((values, k) => line(values, series.at, `${store.plot.of} curve-${k}`));
    flag(x, y, to, now());
    allowedLine(x, y, to);
    lineKey(names, overlaid.length > 0);
    for (const { title, at, values } of overlaid) {
      const end = line(values, at, "other");
      if (!end) continue;
      let right = Math.min(end[0], x.end) - 3; // beside the names that stand there
      for (const box of [...plot.node.querySelectorAll(".name")]
        .map((name) => name.getBBox())) if (Math.abs(box.y + box.height - end[1]) < box.height) right = Math.min(right,
          box.x - 6);
      // not over the key
      plot.text(right, end[1] < 2 * MARGIN.top ? end[1] + 12 : end[1] - 4, title, "end", "unit name");
    }
    plot.node.setAttribute("aria-label", `${heading} [${unit}] along ${along()}`);
    plot.node.append(...plot.node.querySelectorAll(".unit, .key"), cursor); // over the curves
    showCursor();
  }

  /** Flag the worst place of all. */
  function flag(x, y, to, { worst: sign, one, unit }) {
    const rows = series.rows.filter((row) => Number.isFinite(one(row)));
    if (!rows.length) return nameEnds({});
    const row = rows.reduce((a, b) => (sign * (one(b) - one(a)) > 0 ? b : a));
    const at = series.rows.indexOf(row);
    nameEnds({ worst: { value: one(row), unit, place: atText(series.at[at]), go: () => go(at) } });
    plot.flag(x, y, [x.place(series.at[at]), clamp(y.place(to(one(row))), y.end, y.start)]);
  }

  /** Say the ends of what is plotted, and go there on a click. */
  function nameEnds(found) {
    for (const [which, node] of Object.entries(marks)) {
      const one = found[which];
      node.hidden = !one;
      if (!one) continue;
      node.textContent = [SIGNS[which], which, short(one.value, 3), one.unit === "1" ? "" : one.unit,
        one.place ? `at ${one.place}` : ""].filter(Boolean).join(" ");
      node.title = one.where ? `${one.where}: go there` : "Go there";
      node.onclick = one.go;
    }
  }

  /** The displacement that is allowed, and where the load moves the point further. */
  function allowedLine(x, y, to) {
    const { allowed } = store.state;
    if (!allowed) return;
    series.rows.forEach(({ deflection }, i) => { if (deflection?.[0] > allowed) ground(x, i, "gap outside"); });
    if (store.plot.of !== "deflection") return;
    const up = y.place(to(now().read(allowed)));
    if (up >= y.end && up <= y.start) plot.add("line", { class: "allowed", x1: x.start, x2: x.end, y1: up, y2: up });
  }

  /** Colour the ground of a place, half the way to its neighbours; returns its ends. */
  function ground(x, i, kind) {
    const { at } = series;
    const [from, to] = [i - 1, i + 1].map((j) =>
      x.place(clamp((at[i] + at[clamp(j, 0, at.length - 1)]) / 2, x.low, x.high)));
    plot.band(from, to - from, { class: kind });
    return [from, to];
  }

  /** Mark the ground where nothing exists, with the reason, or a value is negative. */
  function gaps(x, valuesOf, why) {
    const stretches = [];
    series.rows.forEach((row, i) => {
      const values = valuesOf(row);
      if (values && !(values[0] < -PRINTED_AS_ZERO * Math.max(...values.map(Math.abs)))) return;
      const [from, to] = ground(x, i, values ? "gap negative" : "gap");
      if (values) return;
      const [before, reason] = [stretches.at(-1), gapWords(row, why)];
      if (before?.end === i - 1 && before.reason === reason) Object.assign(before, { end: i, to });
      else stretches.push({ end: i, from, to, reason });
    });
    for (const { from, to, reason } of stretches) {
      if (to - from > LETTER * reason.length) plot.text((from + to) / 2, plot.height - MARGIN.bottom - 6, reason,
        "middle");
    }
  }

  store.on("hello", (hello) => {
    stop();
    series = asked = keeping = null;
    slow = 0;
    const { coordinates, sliders } = hello.mechanism;
    what.offer([...(hello.trajectory ? [["series:0", "the trajectory"]] : []),
      ...sliders.map((i) => [`sweep:${i}`, coordinates[i].name])]);
    // The coordinate in the middle of the chain usually tells most.
    usual.along = hello.trajectory ? "series:0" : `sweep:${sliders[Math.floor((sliders.length - 1) / 2)]}`;
    plot.node.replaceChildren();
    again.hidden = true;
    nameEnds({});
    trace.box.control.checked = Boolean(hello.trajectory);
    usual.of = "translation";
    replot();
  });
  /** What an address asks for, as far as there is such a thing. */
  function replot() {
    const wishes = { ...usual, ...store.wishedPlot };
    for (const [name, list] of [["of", quantity], ["along", what], ["and", map.select], ["values", scale]]) {
      if (![...list.options].some(({ value }) => value === wishes[name])) wishes[name] = usual[name];
    }
    showPlot(wishes, false);
  }
  store.on("replot", replot);
  store.showPlot = showPlot;
  const redraw = () => [draw, map.draw].forEach((each) => each());
  store.on("state", (patch) => { if ("allowed" in patch) redraw(); });
  store.on("rows", () => request());
  store.on("refused", () => plot.node.classList.toggle("stale", series !== null && series.key !== key()));
  /** Once a load acts, the question is how far it moves the point, unless something else was chosen. */
  function question() {
    const of = wayOf(store.numbers) ? "deflection" : "translation";
    if (of === usual.of) return;
    if (store.plot.of === usual.of) quantity.value = store.plot.of = of;
    usual.of = of;
    redraw();
  }
  for (const act of [question, () => request(), showCursor]) store.on("numbers", act);
  return { play: toggle };
}
