// A quantity over two coordinates, as colours: sweeps of the first, one for each value of the second.

import { clamp, download, el, short } from "./dom.js";
import { drawing, provenance, saveDrawing, table } from "./plotfiles.js";

// Values of the second coordinate, and steps of each sweep.
const COLUMNS = 31;
const LINES = 21;
// Colours at equal steps, dark to light: told apart by those who see fewer hues, too.
const STOPS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
// Ratio of largest to smallest from which colours go by logarithms.
const WIDE = 20;
const EDGE = { left: 62, right: 76, top: 8, bottom: 18 };
// Time (ms) without a change after which it is computed anew.
const CALM = 700;

const hue = (share) => {
  const at = clamp(share, 0, 1) * (STOPS.length - 1);
  const k = Math.min(Math.floor(at), STOPS.length - 2);
  return `rgb(${STOPS[k].map((x, i) => Math.round(x + (at - k) * (STOPS[k + 1][i] - x))).join(" ")})`;
};

/** `what` says what is drawn: {svg, along, value, unit, title, key}. */
export function heat(store, what) {
  const { svg } = what;
  const select = el("select", { "aria-label": "And along what", title: "A second coordinate: the values become colours", onchange: () => { show(); request(); } });
  const plot = svg("svg", { role: "img", class: "plot heat", "aria-label": "no values yet" });
  let map = null; // {key, first, second, xs, ys, rows}
  let asked = null;
  let timer = null;
  let [width, height] = [0, 0];
  plot.style.display = "none";
  new ResizeObserver(() => {
    [width, height] = [plot.clientWidth, plot.clientHeight];
    draw();
  }).observe(plot);

  const on = () => select.value !== "" && what.along() !== null;
  const second = () => Number(select.value);
  const times = (i) => (store.hello.mechanism.coordinates[i].is_length || store.angle === "rad" ? 1 : 180 / Math.PI);
  const word = (i, x) => `${short(x * times(i), 3)}${times(i) === 1 ? ` ${store.hello.mechanism.coordinates[i].unit}` : "°"}`;

  function show() {
    plot.style.display = on() ? "" : "none";
    what.toggle(on());
  }

  function request() {
    if (!on() || !store.numbers) return;
    const { mechanism } = store.hello;
    const rest = mechanism.sliders.filter((i) => i !== what.along() && i !== second()).map((i) => store.state.q[i]);
    const key = JSON.stringify([what.key(), what.along(), second(), rest]);
    if (key === map?.key || key === asked) return draw();
    clearTimeout(timer);
    timer = setTimeout(() => compute(key), map ? CALM : 0);
  }

  async function compute(key) {
    asked = key;
    const [i, j] = [what.along(), second()];
    const { lower, upper } = store.hello.mechanism.coordinates[j];
    const ys = Array.from({ length: LINES }, (_, k) => lower + ((upper - lower) * k) / (LINES - 1));
    const { lower: low, upper: high } = store.hello.mechanism.coordinates[i];
    const xs = Array.from({ length: COLUMNS }, (_, k) => low + ((high - low) * k) / (COLUMNS - 1));
    const found = { key, first: i, second: j, ys, xs, rows: [] };
    // By the page's own arithmetic, where it has any for this state.
    const { gravity, payload, command } = store.state;
    const own = gravity || payload || command ? null : store.source.local ?? (store.source.row ? store.source : null);
    for (const y of ys) {
      const state = { ...store.state, q: store.state.q.with(j, y), moved: j };
      if (own) {
        found.rows.push(found.xs.map((x) => own.row(state.q.with(i, x), state)));
        await new Promise((done) => setTimeout(done));
      } else {
        const answer = await store.ask({ do: "sweep", coordinate: i, steps: COLUMNS, refined: false, state }).catch(() => null);
        found.rows.push(answer?.rows ?? found.xs.map(() => null));
      }
      if (asked !== key) return;
      map = found;
      draw();
    }
    asked = null;
    request();
  }

  const values = () => map.rows.map((line) => line.map((row) => {
    const x = what.value(row);
    return x !== null && x > 0 ? x : null;
  }));

  function draw() {
    if (!on() || !map || width < 120 || height < 50) return;
    const grid = values();
    const all = grid.flat().filter((x) => x !== null);
    const [low, high] = [Math.min(...all), Math.max(...all)];
    const isLog = high > WIDE * low;
    const share = (x) => (high === low ? 0.5 : isLog ? Math.log(x / low) / Math.log(high / low) : (x - low) / (high - low));
    const [across, down] = [(width - EDGE.left - EDGE.right) / map.xs.length, (height - EDGE.top - EDGE.bottom) / map.ys.length];
    plot.replaceChildren();
    const text = (x, y, words, anchor = "start", kind = "") => {
      const node = svg("text", { x, y, "text-anchor": anchor, class: kind });
      node.textContent = words;
      plot.append(node);
    };
    grid.forEach((line, j) => line.forEach((x, i) => {
      const cell = svg("rect", { x: EDGE.left + i * across, y: height - EDGE.bottom - (j + 1) * down, width: across + 0.4, height: down + 0.4 });
      if (x === null) cell.setAttribute("class", "gap");
      else cell.setAttribute("style", `fill: ${hue(share(x))}`);
      plot.append(cell);
    }));
    const right = width - EDGE.right;
    for (const [at, anchor, x] of [[EDGE.left, "start", map.xs[0]], [right, "end", map.xs.at(-1)]]) text(at, height - 4, word(map.first, x), anchor);
    text((EDGE.left + right) / 2, height - 4, store.hello.mechanism.coordinates[map.first].name, "middle");
    text(EDGE.left - 4, height - EDGE.bottom, word(map.second, map.ys[0]), "end");
    text(EDGE.left - 4, EDGE.top + 9, word(map.second, map.ys.at(-1)), "end");
    if (all.length) {
      const bar = height - EDGE.top - EDGE.bottom - 14;
      for (let k = 0; k < 24; k++) plot.append(svg("rect", { x: right + 8, y: EDGE.top + 14 + (bar * k) / 24, width: 9, height: bar / 24 + 0.4, style: `fill: ${hue(1 - k / 23)}` }));
      text(right + 20, EDGE.top + 22, short(high, 3));
      text(right + 20, height - EDGE.bottom, short(low, 3));
      text(width - 2, EDGE.top + 8, what.unit(), "end", "unit");
      if (isLog) text(right + 20, (EDGE.top + height - EDGE.bottom) / 2 + 8, "log");
    }
    // Where the mechanism stands.
    const put = (list, x, from, step) => from + step * (0.5 + ((x - list[0]) / (list.at(-1) - list[0] || 1)) * (list.length - 1));
    const [x, y] = [put(map.xs, store.state.q[map.first], EDGE.left, across), put(map.ys, store.state.q[map.second], height - EDGE.bottom, -down)];
    plot.append(svg("circle", { class: "here", cx: x, cy: y, r: 5 }));
    plot.setAttribute("aria-label", `${what.title()} and ${store.hello.mechanism.coordinates[map.second].name}, as colours from ${short(low, 3)} to ${short(high, 3)}${isLog ? ", by logarithms" : ""}`);
  }

  /** The row of the grid under a pointer. */
  function under(event) {
    if (!map) return null;
    const box = plot.getBoundingClientRect();
    const i = Math.floor(((event.clientX - box.left - EDGE.left) / (width - EDGE.left - EDGE.right)) * map.xs.length);
    const j = Math.floor(((box.bottom - event.clientY - EDGE.bottom) / (height - EDGE.top - EDGE.bottom)) * map.ys.length);
    return i in map.xs && map.rows[j] ? { row: map.rows[j][i], x: map.xs[i], y: map.ys[j] } : null;
  }

  plot.addEventListener("pointermove", (event) => {
    const found = under(event);
    const value = found && what.value(found.row);
    what.read(event, found && `${word(map.first, found.x)}, ${word(map.second, found.y)}: ${value === null ? "nothing exists here" : `${short(value, 5)} ${what.unit()}`}`);
  });
  plot.addEventListener("pointerleave", () => what.read(null, null));
  plot.addEventListener("click", (event) => {
    const found = under(event);
    if (found) store.change({ q: store.state.q.with(map.first, found.x).with(map.second, found.y), moved: null });
  });

  /** The map as a file. */
  function keep(kind, name) {
    if (!map) return;
    const { coordinates } = store.hello.mechanism;
    const lines = provenance(store, `${what.title()} and ${coordinates[map.second].name}`);
    if (kind !== "csv") return saveDrawing(kind, name, drawing(plot, lines, ["colours as in the bar; grey: nothing exists, or the value is not above zero; ring: the posture"]));
    const head = [map.first, map.second].map((i) => `${coordinates[i].name} [${coordinates[i].unit}]`);
    const rows = map.ys.flatMap((y, j) => map.xs.map((x, i) => [x, y, map.rows[j] ? what.value(map.rows[j][i]) : null]));
    download(`${name}.csv`, table(lines, [...head, `value [${what.unit()}]`], rows), "text/csv");
  }

  store.on("hello", ({ mechanism }) => {
    map = asked = null;
    const { coordinates, sliders } = mechanism;
    select.replaceChildren(el("option", { value: "" }, "alone"), ...sliders.map((i) => el("option", { value: i }, `and ${coordinates[i].name}`)));
    select.hidden = sliders.length < 2 || !store.source.moves;
    show();
  });
  store.on("numbers", () => { request(); });
  return { select, plot, on, show, request, draw, keep };
}
