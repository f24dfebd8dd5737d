// A quantity along a sweep of one coordinate or along a trajectory, with a linked cursor.

import { CURVES, plotted } from "./curves.js";
import { LOST, SUPERSEDED, placeBeside, byId, clamp, download, el, short, toast } from "./dom.js";
import { CLOSER, EDGE, heat } from "./heat.js";
import { BLANK } from "./numerics.js";
import { grid, lettered, sized, through, ticks } from "./grid.js";
import { player } from "./player.js";
import { drawing, provenance, saveDrawing, table, svg } from "./plotfiles.js";

export const MARGIN = { left: 52, right: 12, top: 20, bottom: 18 };
// Length of a line in the key, and width of a letter in a gap, in dots.
const [SAMPLE, LETTERS] = [26, 6];
// Width from which on the key names what is compared, too: that has its name at its end.
const KEY_FITS = 460;
// Half the width of the slider's thumb: its middle runs below the plot.
const THUMB = 8;
// What of a state curves depend on, besides the posture.
const OF = ["connection", "quantity", "point", "axes", "stiffness", "load", "load_axes", "load_kind", "load_at", "gravity", "payload", "command"];
// Share of a curve that is seen at least (a step of a sweep is 1/60).
const LEAST_SEEN = 0.02;
// Where this many sweeps in succession took longer than that (s), they are not repeated by themselves: the
// first of all may wait for machine code to be made, and the next ones are quick.
const [SLOW_SWEEPS, QUICK] = [2, 1];

/** Ends of an axis, in what its lines are even in. */
function range(list, isLog) {
  const high = Math.max(...list);
  // Twelve decades at most: what is below is as good as zero.
  const low = Math.max(Math.min(...list), isLog ? high - 12 : -Infinity);
  const half = Math.max(isLog ? 0.15 : 0.02 * Math.max(Math.abs(high), Math.abs(low)), 0.54 * (high - low));
  return [(high + low) / 2 - half, (high + low) / 2 + half];
}

/** Why nothing is drawn, in few words. */
const gapWords = (row, why) => (row.reason?.includes(" moves from ") ? "another drive moves" : row.reason ? "not reached" : why(row));

export function strip(store) {
  let series = null; // {kind, coordinate, at, rows, key, others}
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
  const now = (state = series.state) => plotted(store, store.plot.of, state);

  const what = el("select", { "aria-label": "Along what", onchange: () => showPlot({ along: what.value, seen: null }) });
  const quantity = el("select", { "aria-label": "Values of", title: "What the curves show", onchange: () => showPlot({ of: quantity.value }) },
    ...CURVES.map(({ key, words }) => el("option", { value: key }, words)));
  const axis = el("select", { "aria-label": "Values by", title: "Equal steps of the values, or equal factors", onchange: () => showPlot({ values: axis.value }) },
    el("option", { value: "log" }, "log"), el("option", { value: "linear" }, "linear"));
  const map = heat(store, {
    shown: now, zoom: (seen) => showPlot({ seen }), choose: (and) => showPlot({ and, seen: null }),
    along: () => (what.value.startsWith("sweep") && what.value !== `sweep:${store.plot.and}` ? Number(what.value.slice(6)) : null),
    key: (state) => OF.map((name) => state[name]), busy: () => asked !== null,
    toggle: (on) => { axis.hidden = on; plot.style.display = on ? "none" : ""; setSlider(); }, computed: () => write(),
    read: (event, words) => tell(event, words),
  });
  const play = el("button", { type: "button", class: "play", title: "Play or pause (p)", "aria-label": "Play", onclick: () => toggle() }, "▶");
  const time = el("input", { type: "range", id: "time", min: 0, max: 1, step: "any", value: 0, "aria-label": "Time", title: "+ and \u2212 zoom the curves here" });
  const whole = el("button", { type: "button", class: "quiet", hidden: true, title: "The whole of the curves (double click)", onclick: () => showPlot({ seen: null }) }, "whole");
  const label = el("span", { class: "num small time-label" });
  const again = el("button", { type: "button", class: "quiet", hidden: true, title: "The posture or the load has changed since this was computed", onclick: () => request(true) }, "↻ compute");
  const save = el("select", { "aria-label": "Save the plot", class: "save", title: "The plot as a file, with what it shows", onchange: () => keep() },
    ...[["", "Save"], ["svg", "SVG"], ["csv", "CSV"], ["png1", "PNG"], ["png2", "PNG × 2"], ["png3", "PNG × 3"], ["png4", "PNG × 4"]].map(([value, text]) => el("option", { value }, text)));
  const reading = el("div", { class: "tip reading", role: "status", hidden: true });
  const plot = svg("svg", { role: "img", class: "plot", "aria-label": "no curves yet" });
  const cursor = svg("line", { class: "cursor" });
  byId("strip").append(
    el("div", { class: "row" }, el("span", { class: "dim along" }, "Along"), what, map.select, quantity, axis, again, whole, label, save),
    el("div", { class: "plots" }, plot, map.plot), reading,
    el("div", { class: "time-row" }, play, time));

  time.addEventListener("input", () => go(closest(time.valueAsNumber)));
  time.addEventListener("keydown", ({ key: pressed }) => {
    if (!series || !"+=-".includes(pressed)) return;
    const times = pressed === "-" ? 1 / CLOSER : CLOSER;
    if (map.on()) map.zoom(times);
    else zoom(times, series.at[position]);
  });
  plot.addEventListener("wheel", (event) => {
    if (!series || event.ctrlKey) return;
    event.preventDefault();
    zoom(event.deltaY < 0 ? CLOSER : 1 / CLOSER, under(event));
  }, { passive: false });
  plot.addEventListener("dblclick", () => showPlot({ seen: null }));
  plot.addEventListener("pointerdown", (event) => {
    if (!series) return;
    plot.setPointerCapture(event.pointerId);
    go(nearest(event));
  });
  plot.addEventListener("pointermove", (event) => {
    if (plot.hasPointerCapture(event.pointerId)) go(nearest(event));
    read(event);
  });
  plot.addEventListener("pointerleave", () => { reading.hidden = true; });
  const size = sized(plot, () => draw());

  /** The values under a pointer, in words. */
  function read(event) {
    if (!series) return tell(event, null);
    const k = nearest(event);
    const { values, unit, why } = now();
    const found = values(series.rows[k]);
    tell(event, `${atText(series.at[k])}: ${found ? `${found.map((x) => short(x, 5)).join(", ")} ${unit}` : why(series.rows[k])}`);
  }

  /** Words beside a pointer, or none. */
  function tell(event, words) {
    reading.hidden = !words;
    if (!words) return;
    reading.textContent = words;
    placeBeside(reading, event, byId("strip").getBoundingClientRect(), [12, -30]);
  }

  /** Show something else. */
  function showPlot(change) {
    if (store.numbers && Object.entries(change).some(([key, value]) => String(store.plot[key]) !== String(value))) store.remember(`plot ${Object.keys(change)}`);
    Object.assign(store.plot, change);
    [what.value, quantity.value, map.select.value, axis.value] = [store.plot.along, store.plot.of, store.plot.and, store.plot.values];
    whole.hidden = !store.plot.seen;
    store.tell("plot");
    request(true);
    map.show();
    draw();
    map.request();
  }

  /** The plot as a file; one that is of something else than the page says is computed first. */
  function keep() {
    keeping = save.value || null;
    save.value = "";
    if (!keeping || write()) return;
    toast("The file follows when its values are computed");
    request(true);
    map.request();
  }

  /** Write the file that waits, if what it is to hold is here. */
  function write() {
    const kind = keeping;
    if (!kind || !(map.on() ? map.current() : series && series.key === key())) return false;
    keeping = null;
    const name = `${store.hello.mechanism.name}-${store.plot.of}`.replaceAll(/[^\w.-]+/g, "_");
    if (map.on()) map.keep(kind, name);
    else keepCurves(kind, name);
    return true;
  }

  function keepCurves(kind, name) {
    const { title, lines: names, unit, values, legend, why } = now();
    const lines = provenance(store, series.state, `${title} [${unit}] along ${along()}`);
    if (kind === "csv") {
      const first = series.kind === "sweep" ? `${along()} [${store.hello.mechanism.coordinates[series.coordinate].unit}]`
        : store.hello.trajectory.timed ? "time [s]" : "posture";
      const rows = series.at.map((x, k) => (values(series.rows[k]) ? [x, ...values(series.rows[k]), null] : [x, ...names.map(() => null), why(series.rows[k])]));
      return download(`${name}.csv`, table(lines, [first, ...names.map((word) => `${word} [${unit}]`), "why there is no value"], rows), "text/csv");
    }
    if (series.others.length) legend.push(`dash-dot, with a name: ${names[0]} of ${series.others.map(({ title: of }) => of).join(", ")}`);
    saveDrawing(kind, name, drawing(plot, lines, legend));
  }

  const ends = () => (store.plot.seen?.length === 2 && store.plot.seen) || [series.at[0], series.at.at(-1)];

  /** See so many times less of the series, about a place that stays where it is. */
  function zoom(times, at) {
    if (!series) return;
    const [[low, high], [first, last]] = [ends(), [series.at[0], series.at.at(-1)]];
    const size = Math.max(LEAST_SEEN * (last - first), (high - low) / times);
    const start = clamp(at - ((at - low) * size) / (high - low), first, last - size);
    showPlot({ seen: size < last - first ? [start, start + size] : null });
  }

  /** Where along the series a pointer is. */
  function under(event) {
    const box = plot.getBoundingClientRect();
    const share = (event.clientX - box.left - MARGIN.left) / (box.width - MARGIN.left - MARGIN.right);
    const [first, last] = ends();
    return first + clamp(share, 0, 1) * (last - first);
  }

  /** The place of the series that is next to a value. */
  const closest = (x) => series.at.reduce((best, value, i) => (Math.abs(value - x) < Math.abs(series.at[best] - x) ? i : best), 0);
  const nearest = (event) => closest(under(event));

  /** Take the mechanism to a place of the series. */
  function go(index) {
    if (!series) return;
    position = clamp(Math.round(index), 0, series.at.length - 1);
    const row = series.rows[position];
    if (!row.q) {
      if (series.kind === "sweep") store.move(series.coordinate, series.at[position]);
    } else if (series.kind === "sweep") {
      const q = row.q.slice();
      store.change({ q, moved: series.coordinate });
    } else store.goTo(row.q);
    showCursor();
  }

  const { toggle, stop, isPlaying } = player(play, {
    places: () => series?.at.length ?? 0, position: () => position, go,
    duration: () => (series.kind === "series" && store.hello.trajectory.timed ? series.at.at(-1) - series.at[0] : series.at.length / 15),
    returns: () => series.kind === "sweep",
  });

  /** What the curves depend on, besides the coordinate that runs. */
  function key() {
    const state = { ...store.state, ...store.given() };
    const [kind, index] = what.value.split(":");
    const rows = kind === "series" ? [] : store.rows.map((row) => [row.title, row.kept?.state]);
    const others = kind === "series" ? [] : store.hello.mechanism.sliders.filter((i) => i !== Number(index)).map((i) => state.q[i]);
    return JSON.stringify([what.value, rows, others, ...OF.map((name) => state[name])]);
  }

  function request(now = false) {
    if (!store.state || !what.value || !store.source.moves) return;
    const wanted = key();
    if (series?.key === wanted) plot.classList.remove("stale");
    if (series?.key === wanted || asked?.wanted === wanted) {
      again.hidden = true;
      return showCursor();
    }
    clearTimeout(timer);
    plot.classList.toggle("stale", series !== null);
    const waits = slow >= SLOW_SWEEPS && !now;
    again.hidden = !waits;
    if (isPlaying() || waits || store.searching) return;
    timer = setTimeout(() => compute(wanted), now ? 0 : 350);
  }

  async function compute(wanted) {
    const state = structuredClone({ ...store.state, ...store.given() });
    const own = asked = { wanted }; // asked for again after something else, it is another question
    const [kind, index] = what.value.split(":");
    plot.classList.add("computing");
    if (!series) plot.replaceChildren(lettered(MARGIN.left, MARGIN.top + 24, "computing …", "start", "nothing"));
    try {
      let seconds = 0;
      for (const refined of kind === "sweep" && store.source.live ? [false, true] : [true]) { // the first look need not wait
        const answer = await store.ask(kind === "series" ? { do: "series", state } : { do: "sweep", coordinate: Number(index), steps: 61, refined, state });
        if (asked !== own) return;
        series = { kind, state, coordinate: Number(index), at: answer.at, rows: answer.rows, key: refined && wanted, others: [] };
        if (ends()[0] < answer.at[0] || ends()[1] > answer.at.at(-1)) showPlot({ seen: null });
        seconds += answer.seconds;
        again.hidden = true;
        plot.classList.remove("stale");
        draw();
      }
      slow = seconds > QUICK ? slow + 1 : 0;
      if (kind === "sweep") for (const row of store.rows) {
        const other = await row.sweep(Number(index), 61).catch(() => null);
        if (asked !== own) return;
        if (other) series.others.push(other);
      }
      if (series.others.length) draw();
    } catch (error) {
      if (error.message === LOST) return; // the next numbers ask again
      if (asked === own && error.message !== SUPERSEDED) {
        keeping = null;
        store.tell("error", error.message);
      }
    } finally {
      if (asked === own) asked = null;
      plot.classList.remove("computing");
    }
    write();
    request(keeping !== null);
  }

  /** What the curves run along: not what is chosen, while others are computed. */
  const along = () => (series.kind === "sweep" ? store.hello.mechanism.coordinates[series.coordinate].name : "the trajectory");

  function isAngle() {
    return series.kind === "sweep" && !store.hello.mechanism.coordinates[series.coordinate].is_length && store.angle === "deg";
  }

  function atText(x) {
    if (series.kind === "sweep") {
      const { is_length: isLength, unit } = store.hello.mechanism.coordinates[series.coordinate];
      return isLength ? `${short(x)} ${unit}` : isAngle() ? `${short((x * 180) / Math.PI)}°` : `${short(x)} rad`;
    }
    return store.hello.trajectory.timed ? `${short(x)} s` : `posture ${Math.round(x) + 1}`;
  }

  /** The slider's ends are those of what is seen, below it. */
  function setSlider() {
    const { left, right } = map.on() ? EDGE : MARGIN;
    [time.style.marginLeft, time.style.width] = [`${left - THUMB}px`, `calc(100% - ${left + right - 2 * THUMB}px)`];
    if (series) [time.min, time.max] = map.on() ? [series.at[0], series.at.at(-1)] : ends();
  }

  function showCursor() {
    if (!series) return;
    if (series.kind === "sweep" && !isPlaying()) position = closest(store.state.q[series.coordinate]);
    const [first, last] = ends();
    setSlider();
    const exact = series.kind === "sweep" ? store.state.q[series.coordinate] : series.at[position];
    time.value = exact;
    time.setAttribute("aria-valuetext", atText(series.at[position]));
    label.textContent = atText(exact);
    const x = placeX(clamp(exact, first, last), size.width);
    cursor.style.display = exact < first || exact > last ? "none" : "";
    cursor.setAttribute("x1", x);
    cursor.setAttribute("x2", x);
    cursor.setAttribute("y1", MARGIN.top);
    cursor.setAttribute("y2", size.height - MARGIN.bottom);
  }

  /** What each line is, above the plot's right end. */
  function lineKey(names, isCompared, width) {
    let x = width - MARGIN.right;
    const kinds = names.map((name, k) => [name, `${store.plot.of} curve-${k}`]);
    for (const [name, kind] of [...kinds, ...(isCompared && width > KEY_FITS ? [["compared", "other"]] : [])].toReversed()) {
      const text = lettered(x, MARGIN.top - 8, name, "end", "unit key");
      plot.append(text);
      x -= text.getComputedTextLength() + 4;
      plot.append(svg("path", { class: `curve key ${kind}`, d: `M${x - SAMPLE},${MARGIN.top - 12}h${SAMPLE}` }));
      x -= SAMPLE + 12;
    }
  }

  function placeX(x, width) {
    const [first, last] = ends();
    return MARGIN.left + ((x - first) / (last - first || 1)) * (width - MARGIN.left - MARGIN.right);
  }

  function draw() {
    const { width, height } = size;
    if (!series || width < 80 || height < 40) return;
    const { values: valuesOf, unit, why, title: heading, lines: names } = now();
    const curves = names.map((_, k) => series.rows.map((row) => valuesOf(row)?.[k] ?? null));
    // Of what is compared with the least value, dashed.
    const overlaid = series.others.map(({ title, at, rows }) => ({ title, at, values: rows.map((row) => valuesOf(row)?.[0] ?? null) }));
    const [first, last] = ends();
    // With the next one on either side, to which the curves go on.
    const isSeen = (at, i) => (at[i + 1] ?? at[i]) >= first && (at[i - 1] ?? at[i]) <= last;
    const isLog = store.plot.values !== "linear";
    const found = [...curves.map((values) => [series.at, values]), ...overlaid.map(({ at, values }) => [at, values])]
      .flatMap(([at, values]) => values.filter((x, i) => Number.isFinite(x) && (x > 0 || !isLog) && isSeen(at, i)));
    plot.replaceChildren();
    if (!found.length) {
      plot.append(lettered(width / 2, height / 2, why(series.rows.find((row) => row.q) ?? series.rows[0]), "middle", "nothing"));
      plot.append(cursor);
      return showCursor();
    }
    const [to, from] = isLog ? [Math.log10, (x) => 10 ** x] : [(x) => x, (x) => x];
    const [bottom, top] = range(found.map(to), isLog);
    const placeY = (x) => MARGIN.top + ((top - to(x)) / (top - bottom)) * (height - MARGIN.top - MARGIN.bottom);
    const turn = isAngle() ? 180 / Math.PI : 1;
    const places = ticks(first * turn, last * turn, Math.max(2, (width - MARGIN.left - MARGIN.right) / 75), isAngle()).map((x) => [placeX(x / turn, width), atText(x / turn)]);
    grid(plot, { width, height, margin: MARGIN }, { bottom: from(bottom), top: from(top), isLog }, placeY, places, `${unit === "1" ? "" : `${unit}, `}${isLog ? "log" : "linear"}`);
    plot.append(svg("defs", {}, svg("pattern", { id: "hatching", width: 6, height: 6, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" },
      svg("line", { class: "hatch", x1: 0, x2: 0, y1: 0, y2: 6 })),
    svg("clipPath", { id: "seen" }, svg("rect", { x: MARGIN.left, y: 0, width: width - MARGIN.left - MARGIN.right, height }))));
    // Where nothing exists, or a value is negative, the ground is marked.
    const stretches = [];
    series.rows.forEach((row, i) => {
      const values = valuesOf(row);
      if (values && !(values[0] < -BLANK * Math.max(...values.map(Math.abs)))) return;
      const middle = (a, b) => placeX(clamp((series.at[a] + series.at[clamp(b, 0, series.at.length - 1)]) / 2, first, last), width);
      const x = middle(i, i - 1);
      plot.append(svg("rect", { class: values ? "gap negative" : "gap", x, y: MARGIN.top,
        width: middle(i, i + 1) - x, height: height - MARGIN.top - MARGIN.bottom }));
      const before = stretches.at(-1);
      if (values) return;
      if (before?.end === i - 1 && before.reason === gapWords(row, why)) [before.end, before.to] = [i, middle(i, i + 1)];
      else stretches.push({ end: i, from: x, to: middle(i, i + 1), reason: gapWords(row, why) });
    });
    for (const { from: x, to: end, reason } of stretches) {
      if (end - x > LETTERS * reason.length) plot.append(lettered((x + end) / 2, height - MARGIN.bottom - 6, reason, "middle"));
    }
    const line = (values, at, kind) => {
      const points = values.map((x, i) => (x === null || (isLog && x <= 0) || !isSeen(at, i) ? null
        : [placeX(at[i], width), clamp(placeY(x), MARGIN.top, height - MARGIN.bottom)]));
      plot.append(svg("path", { d: through(points), class: `curve ${kind}`, "clip-path": "url(#seen)" }));
      return points.findLast(Boolean);
    };
    curves.forEach((values, k) => line(values, series.at, `${store.plot.of} curve-${k}`));
    lineKey(names, overlaid.length > 0, width);
    for (const { title, at, values } of overlaid) {
      const end = line(values, at, "other");
      if (!end) continue;
      let x = Math.min(end[0], width - MARGIN.right) - 3; // beside the names that stand there
      for (const box of [...plot.querySelectorAll(".name")].map((name) => name.getBBox())) if (Math.abs(box.y + box.height - end[1]) < box.height) x = Math.min(x, box.x - 6);
      plot.append(lettered(x, end[1] - 4, title, "end", "unit name"));
    }
    plot.setAttribute("aria-label", `${heading} [${unit}] along ${along()}`);
    plot.append(...plot.querySelectorAll(".unit, .key"), cursor); // over the curves
    showCursor();
  }

  store.on("hello", (hello) => {
    stop();
    series = asked = keeping = null;
    slow = 0;
    const { coordinates, sliders } = hello.mechanism;
    what.replaceChildren();
    if (hello.trajectory) what.append(el("option", { value: "series:0" }, "the trajectory"));
    for (const i of sliders) what.append(el("option", { value: `sweep:${i}` }, coordinates[i].name));
    // The coordinate in the middle of the chain usually tells most.
    usual.along = hello.trajectory ? "series:0" : `sweep:${sliders[Math.floor((sliders.length - 1) / 2)]}`;
    plot.replaceChildren();
    again.hidden = true;
    replot();
  });
  /** What an address asks for, as far as there is such a thing. */
  function replot() {
    const wishes = { ...usual, ...store.wishedPlot };
    const has = (select, value) => [...select.options].some((option) => option.value === value);
    showPlot({ ...wishes, of: has(quantity, wishes.of) ? wishes.of : usual.of, along: has(what, wishes.along) ? wishes.along : usual.along,
      and: has(map.select, wishes.and) ? wishes.and : "", values: has(axis, wishes.values) ? wishes.values : usual.values });
  }
  store.on("replot", replot);
  store.on("units", () => {
    draw();
    map.draw();
  });
  store.on("rows", () => request());
  store.on("numbers", () => {
    request();
    showCursor();
  });
  return { toggle, draw };
}
