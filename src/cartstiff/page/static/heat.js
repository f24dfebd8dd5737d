// A quantity over two coordinates, as colours: sweeps of the first, one for each value of the second.

import { clamp, download, el, hues, short } from "./dom.js";
import { between } from "./drawing.js";
import { lettered, sized } from "./grid.js";
import { drawing, provenance, saveDrawing, table, svg } from "./plotfiles.js";

// Values of the second coordinate, and steps of each sweep: of a whole turn 7.5 degrees each; an even
// number, so that no cell is the middle of the range, where many a singularity lies. Rows are computed
// in this order, and the one before stands for a row until it has come.
const CELLS = 48;
const ORDER = [4, 2, 1].flatMap((step, pass) => Array.from({ length: CELLS }, (_, k) => k).filter((k) => k % step === 0 && (pass === 0 || k % (2 * step) !== 0)));
// Ratio of largest to smallest from which colours go by logarithms.
const WIDE = 20;
export const EDGE = { left: 62, right: 76, top: 8, bottom: 18 };
// Time (ms) without a change after which it is computed anew.
const CALM = 700;
// Cells that are seen at least, and the factor of one step towards that.
const FEWEST = 3;
// Wait (ms) for curves that are asked for.
const PAUSE = 30;
export const CLOSER = 1.25;
const NOTHING = { reason: "the server did not answer" };

/** A colour from dark to light. */
const hue = (share) => {
  stops ??= hues("sequential").map((text) => [1, 3, 5].map((i) => Number(`0x${text.slice(i, i + 2)}`)));
  return `rgb(${between(stops, clamp(share, 0, 1)).map(Math.round).join(" ")})`;
};
let stops = null;

/** `what` says what is drawn: {shown, along, key, busy}, with callbacks {choose, zoom, toggle, read, computed}. */
export function heat(store, what) {
  const select = el("select", { "aria-label": "And along what", title: "A second coordinate: the values become colours", onchange: () => what.choose(select.value) });
  const plot = svg("svg", { role: "img", class: "plot heat", "aria-label": "no values yet" });
  let map = null; // {key, state, first, second, xs, ys, rows}
  let asked = null;
  let timer = null;
  plot.style.display = "none";
  const size = sized(plot, () => draw());

  const on = () => select.value !== "" && what.along() !== null;
  const second = () => Number(select.value);
  const valueOf = (row) => what.shown(map.state).values(row)?.[0] ?? null;
  const times = (i) => (store.hello.mechanism.coordinates[i].is_length || store.angle === "rad" ? 1 : 180 / Math.PI);
  const word = (i, x) => `${short(x * times(i), 3)}${times(i) === 1 ? ` ${store.hello.mechanism.coordinates[i].unit}` : "°"}`;

  function show() {
    plot.style.display = on() ? "" : "none";
    what.toggle(on());
  }

  /** What the values depend on, besides the coordinates that run. */
  function wanted() {
    const { mechanism } = store.hello;
    const state = { ...store.state, ...store.given() };
    const rest = mechanism.sliders.filter((i) => i !== what.along() && i !== second()).map((i) => state.q[i]);
    return JSON.stringify([what.key(state), what.along(), second(), rest]);
  }

  /** Whether all values are here, and of what is shown. */
  const current = () => map !== null && map.rows.every(Boolean) && map.key === wanted();

  function request() {
    if (!on() || !store.numbers) return;
    const key = wanted();
    if (key === map?.key || key === asked) return draw();
    clearTimeout(timer);
    timer = setTimeout(() => compute(key), map ? CALM : 0);
  }

  async function compute(key) {
    asked = key;
    const [i, j] = [what.along(), second()];
    const { coordinates } = store.hello.mechanism;
    const [xs, ys] = [i, j].map((one) => coordinates[one].swept).map(([low, high]) => Array.from({ length: CELLS }, (_, k) => low + ((high - low) * k) / (CELLS - 1)));
    const from = structuredClone({ ...store.state, ...store.given() });
    const found = { key, state: from, first: i, second: j, ys, xs, rows: ys.map(() => null) };
    for (const k of ORDER) {
      const y = ys[k];
      const state = { ...from, q: from.q.with(j, y), moved: j };
      const own = store.source.local ?? (store.source.rows ? store.source : null);
      // By the page's own arithmetic; what that does not cover the server answers, if there is one.
      let line = own?.rows ? own.rows(i, found.xs, state) : null;
      if (line) await new Promise((done) => setTimeout(done));
      if (!line || store.source.live && line.some((row) => row.reason)) line = await swept(i, state, key) ?? line ?? found.xs.map(() => NOTHING);
      found.rows[k] = line;
      if (asked !== key) return;
      map = found;
      draw();
    }
    asked = null;
    what.computed();
    request();
  }

  /** Rows along a coordinate: of two sweeps at once the server answers the newer, and curves go first. */
  async function swept(coordinate, state, key) {
    const isWanted = async () => {
      while (asked === key && what.busy()) await new Promise((done) => setTimeout(done, PAUSE));
      return asked === key;
    };
    const answer = await store.insist({ do: "sweep", coordinate, steps: CELLS, refined: false, state }, isWanted).catch(() => null);
    return answer?.rows;
  }

  /** Why a cell has no colour. */
  const why = (row) => (valueOf(row) === null ? what.shown(map.state).why(row) : "not above zero");

  /** Which row stands for a place: its own, or one before it while that has not come. */
  const standsFor = (j) => [j, j - 1, j - 2, j - 3].find((k) => map.rows[k]);
  const values = () => map.rows.map((_, j) => map.rows[standsFor(j)]?.map((row) => {
    const x = valueOf(row);
    return x !== null && x > 0 ? x : null;
  }));

  /** Ends of what is seen, across and down, in cells. */
  function ends() {
    const { seen } = store.plot;
    if (seen?.length !== 4) return [0, map.xs.length, 0, map.ys.length];
    const cell = (list, x) => ((x - list[0]) / (list.at(-1) - list[0])) * (list.length - 1) + 0.5;
    return [cell(map.xs, seen[0]), cell(map.xs, seen[1]), cell(map.ys, seen[2]), cell(map.ys, seen[3])];
  }

  /** See so many times less, about a place (shares of what is seen) that stays where it is. */
  function zoom(times, across = 0.5, up = 0.5) {
    if (!map) return;
    const [x0, x1, y0, y1] = ends();
    const part = (low, high, count, share) => {
      const size = Math.max(FEWEST, Math.min(count, (high - low) / times));
      const start = clamp(low + share * (high - low) - share * size, 0, count - size);
      return [start, start + size];
    };
    const [a, b, c, d] = [...part(x0, x1, map.xs.length, across), ...part(y0, y1, map.ys.length, up)];
    const value = (list, cell) => list[0] + ((cell - 0.5) / (list.length - 1)) * (list.at(-1) - list[0]);
    const isAll = b - a >= map.xs.length && d - c >= map.ys.length;
    what.zoom(isAll ? null : [value(map.xs, a), value(map.xs, b), value(map.ys, c), value(map.ys, d)]);
  }

  function draw() {
    const { width, height } = size;
    if (!on() || !map || width < 120 || height < 50) return;
    const grid = values();
    const all = grid.flat().filter((x) => Number.isFinite(x));
    const [low, high] = [Math.min(...all), Math.max(...all)];
    const isLog = high > WIDE * low;
    const share = (x) => (high === low ? 0.5 : isLog ? Math.log(x / low) / Math.log(high / low) : (x - low) / (high - low));
    const [x0, x1, y0, y1] = ends();
    const [across, down] = [(width - EDGE.left - EDGE.right) / (x1 - x0), (height - EDGE.top - EDGE.bottom) / (y1 - y0)];
    const { unit, title } = what.shown(map.state);
    plot.replaceChildren(svg("defs", {}, svg("clipPath", { id: "seen-cells" },
      svg("rect", { x: EDGE.left, y: EDGE.top, width: width - EDGE.left - EDGE.right, height: height - EDGE.top - EDGE.bottom }))));
    const cells = svg("g", { "clip-path": "url(#seen-cells)" });
    plot.append(cells);
    const text = (x, y, words, anchor = "start", kind = "") => plot.append(lettered(x, y, words, anchor, kind));
    grid.forEach((line, j) => line?.forEach((x, i) => {
      if (i + 1 <= x0 || i >= x1 || j + 1 <= y0 || j >= y1) return;
      const cell = svg("rect", { x: EDGE.left + (i - x0) * across, y: height - EDGE.bottom - (j + 1 - y0) * down, width: across + 0.4, height: down + 0.4 });
      if (x === null) cell.setAttribute("class", "gap");
      else cell.setAttribute("style", `fill: ${hue(share(x))}`);
      cells.append(cell);
    }));
    const right = width - EDGE.right;
    // Ends of a list are the middles of its outer cells.
    const at = (list, cell) => clamp(list[0] + ((cell - 0.5) / (list.length - 1)) * (list.at(-1) - list[0]), list[0], list.at(-1));
    for (const [place, anchor, x] of [[EDGE.left, "start", at(map.xs, x0)], [right, "end", at(map.xs, x1)]]) text(place, height - 4, word(map.first, x), anchor);
    text((EDGE.left + right) / 2, height - 4, store.hello.mechanism.coordinates[map.first].name, "middle");
    text(EDGE.left - 4, height - EDGE.bottom, word(map.second, at(map.ys, y0)), "end");
    text(EDGE.left - 4, EDGE.top + 9, word(map.second, at(map.ys, y1)), "end");
    if (all.length) {
      const bar = height - EDGE.top - EDGE.bottom - 14;
      for (let k = 0; k < 24; k++) plot.append(svg("rect", { x: right + 8, y: EDGE.top + 14 + (bar * k) / 24, width: 9, height: bar / 24 + 0.4, style: `fill: ${hue(1 - k / 23)}` }));
      text(right + 20, EDGE.top + 22, short(high, 3));
      text(right + 20, height - EDGE.bottom, short(low, 3));
      text(width - 2, EDGE.top + 8, unit, "end", "unit");
      if (isLog) text(right + 20, (EDGE.top + height - EDGE.bottom) / 2 + 8, "log");
    }
    // Where the mechanism stands.
    const put = (list, x, low, from, step) => from + step * (0.5 - low + ((x - list[0]) / (list.at(-1) - list[0] || 1)) * (list.length - 1));
    const [x, y] = [put(map.xs, store.state.q[map.first], x0, EDGE.left, across), put(map.ys, store.state.q[map.second], y0, height - EDGE.bottom, -down)];
    if (x >= EDGE.left && x <= right && y >= EDGE.top && y <= height - EDGE.bottom) plot.append(svg("circle", { class: "here", cx: x, cy: y, r: 5 }));
    plot.setAttribute("aria-label", `${title} along ${store.hello.mechanism.coordinates[map.first].name} and ${store.hello.mechanism.coordinates[map.second].name}, as colours from ${short(low, 3)} to ${short(high, 3)}${isLog ? ", by logarithms" : ""}`);
  }

  /** The row of the grid under a pointer. */
  function under(event) {
    if (!map) return null;
    const { width, height } = size;
    const box = plot.getBoundingClientRect();
    const [x0, x1, y0, y1] = ends();
    const across = (event.clientX - box.left - EDGE.left) / (width - EDGE.left - EDGE.right);
    const up = (box.bottom - event.clientY - EDGE.bottom) / (height - EDGE.top - EDGE.bottom);
    if (!(across >= 0 && across <= 1 && up >= 0 && up <= 1)) return null;
    const [i, j] = [Math.floor(x0 + across * (x1 - x0)), standsFor(Math.floor(y0 + up * (y1 - y0)))];
    return i in map.xs && j in map.ys ? { row: map.rows[j][i], x: map.xs[i], y: map.ys[j], across, up } : null;
  }

  plot.addEventListener("wheel", (event) => {
    const found = event.ctrlKey ? null : under(event);
    if (!found) return;
    event.preventDefault();
    zoom(event.deltaY < 0 ? CLOSER : 1 / CLOSER, found.across, found.up);
  }, { passive: false });

  plot.addEventListener("pointermove", (event) => {
    const found = under(event);
    const value = found && valueOf(found.row);
    what.read(event, found && `${word(map.first, found.x)}, ${word(map.second, found.y)}: ${value === null ? why(found.row) : `${short(value, 5)} ${what.shown(map.state).unit}`}`);
  });
  plot.addEventListener("pointerleave", () => what.read(null, null));
  plot.addEventListener("click", (event) => {
    const found = under(event);
    if (found) store.change({ q: store.state.q.with(map.first, found.x).with(map.second, found.y), moved: null });
  });

  /** The map as a file. */
  function keep(kind, name) {
    const { coordinates } = store.hello.mechanism;
    const { title, unit } = what.shown(map.state);
    const lines = provenance(store, map.state, `${title} [${unit}] along ${coordinates[map.first].name} and ${coordinates[map.second].name}`);
    if (kind !== "csv") return saveDrawing(kind, name, drawing(plot, lines, ["colours as in the bar; grey: no value, or one that is not above zero; ring: the posture"]));
    const head = [map.first, map.second].map((i) => `${coordinates[i].name} [${coordinates[i].unit}]`);
    const rows = map.ys.flatMap((y, j) => map.xs.map((x, i) => {
      const value = valueOf(map.rows[j][i]);
      return [x, y, value, value === null ? why(map.rows[j][i]) : null];
    }));
    download(`${name}.csv`, table(lines, [...head, `value [${unit}]`, "why there is no value"], rows), "text/csv");
  }

  store.on("hello", ({ mechanism }) => {
    map = asked = null;
    const { coordinates, sliders } = mechanism;
    select.replaceChildren(el("option", { value: "" }, "alone"), ...sliders.map((i) => el("option", { value: i }, `and ${coordinates[i].name}`)));
    select.hidden = sliders.length < 2 || !store.source.moves;
    show();
  });
  store.on("numbers", () => { request(); });
  return { select, plot, on, show, current, request, draw, keep, zoom };
}
