// A quantity over two coordinates, as colours: sweeps of the first, one for each value of the second.

import { bright, goodness, isOutside } from "./bright.js";
import { ARROWS, clamp, dropdown, engineering, evenly, resting, short } from "./dom.js";
import { Plot, isWhole, nearer } from "./plot.js";
import { provenance, savePlot, svg } from "./plotfiles.js";
import { curvesOf, inWords } from "./store.js";

// Values of the second coordinate, and steps of each sweep: of a whole turn 7.5 degrees each; an even
// number, so that no cell is the middle of the range, where many a singularity lies. Rows are computed
// in this order, and the one before stands for a row until it has come.
const CELLS = 48;
const ORDER = [4, 2, 1].flatMap((step, pass) => Array.from({ length: CELLS }, (_, k) => k)
  .filter((k) => k % step === 0 && (pass === 0 || k % (2 * step) !== 0)));
// Time (ms) without a change after which it is computed anew.
const CALM = 700;
// Cells that are seen at least.
const FEWEST = 3;
// Wait (ms) for curves that are asked for.
const PAUSE = 30;
const NOTHING = { reason: "the server did not answer" };

const hue = (share) => `fill: rgb(${bright(share).map(Math.round).join(" ")})`;

/** Distance of the values of a list, and both ends: those of its outer cells. */
const step = (list) => (list.at(-1) - list[0]) / (list.length - 1);
const whole = (list) => [list[0] - step(list) / 2, list.at(-1) + step(list) / 2];

/** `what` says what is drawn: {shown, along, busy}, with callbacks {showPlot, toggle, say, computed}. */
export function heat(store, what) {
  const select = dropdown("And along what", [], (and) => what.showPlot({ and, seen: null }),
    { title: "A second coordinate: the values become colours" });
  const plot = new Plot({ left: 62, right: 96, top: 22, bottom: 18 }, () => draw(),
    { kind: "plot heat", label: "no values yet" });
  let map = null; // {key, state, first, second, xs, ys, rows}
  let asked = null;
  const calm = resting();
  plot.node.style.display = "none";

  const on = () => select.value !== "" && what.along() !== null;
  const second = () => Number(select.value);
  const coordinate = (i) => store.hello.mechanism.coordinates[i];
  /** What is read from the rows of the map that is drawn, with its unit and words. */
  const told = () => what.shown({ state: map.state, rows: map.rows.flatMap((line) => line ?? []) });

  function show() {
    plot.node.style.display = on() ? "" : "none";
    what.toggle(on());
  }

  /** What the values depend on. */
  const wanted = () => JSON.stringify([what.along(), second(), curvesOf(store, [what.along(), second()])]);

  /** Whether all values are here, and of what is shown. */
  const current = () => map !== null && map.rows.every(Boolean) && map.key === wanted();

  function request() {
    if (!on() || !store.numbers) return;
    const key = wanted();
    if (key === map?.key || key === asked) return draw();
    calm(() => compute(key), map ? CALM : 0);
  }

  async function compute(key) {
    asked = key;
    const [i, j] = [what.along(), second()];
    const [xs, ys] = [i, j].map((one) => evenly(...coordinate(one).swept, CELLS));
    const from = store.onTheWay();
    const found = { key, state: from, first: i, second: j, ys, xs, rows: ys.map(() => null) };
    for (const k of ORDER) {
      const state = { ...from, q: from.q.with(j, ys[k]), moved: j };
      // By the page's own arithmetic; what that does not cover the server answers, if there is one.
      let line = store.local?.rows(i, found.xs, state);
      if (line) await new Promise((done) => setTimeout(done));
      if (!line || store.source.live && line.some((row) => row.reason)) line = await swept(i, state, key) ?? line
        ?? found.xs.map(() => NOTHING);
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
  async function swept(along, state, key) {
    const isWanted = async () => {
      while (asked === key && what.busy()) await new Promise((done) => setTimeout(done, PAUSE));
      return asked === key;
    };
    const answer = await store.insist({ do: "sweep", coordinate: along, steps: CELLS, state }, isWanted)
      .catch(() => null);
    return answer?.rows;
  }

  /** Why a cell has no colour. */
  const why = ({ one, why: reason }, row) => (one(row) === null ? reason(row) : "not above zero");

  /** Which row stands for a place: its own, or one before it while that has not come. */
  const standsFor = (j) => [j, j - 1, j - 2, j - 3].find((k) => map.rows[k]);

  /** Ends of what is seen, across and up. */
  const seen = () => (store.plot.seen?.length === 4 ? [store.plot.seen.slice(0, 2), store.plot.seen.slice(2)]
    : [whole(map.xs), whole(map.ys)]);
  const axes = () => [plot.across(...seen()[0]), plot.upwards(...seen()[1])];

  /** See so many times less, about values that stay where they are: the middle, unless others are given. */
  function zoom(times, about = seen().map(([low, high]) => (low + high) / 2)) {
    if (!map) return;
    const parts = [map.xs, map.ys].map((list, k) => nearer(seen()[k], whole(list), times, about[k],
      FEWEST * step(list)));
    what.showPlot({ seen: isWhole(parts[0], whole(map.xs)) && isWhole(parts[1], whole(map.ys)) ? null : parts.flat() });
  }

  /** The cells that are seen; of those without a value the ground is marked. */
  function cells(x, y, good) {
    plot.clip("seen-cells");
    const group = plot.add("g", { "clip-path": "url(#seen-cells)" });
    const [half, high] = [step(map.xs) / 2, step(map.ys) / 2];
    map.ys.forEach((_, j) => map.rows[standsFor(j)]?.forEach((row, i) => {
      const [left, top] = [x.place(map.xs[i] - half), y.place(map.ys[j] + high)];
      const [right, bottom] = [x.place(map.xs[i] + half), y.place(map.ys[j] - high)];
      if (right <= x.start || left >= x.end || bottom <= y.end || top >= y.start) return;
      const look = good.value(row) === null ? { class: "gap" } : { style: hue(good.share(row)) };
      group.append(svg("rect", { x: left, y: top, width: right - left + 0.4, height: bottom - top + 0.4, ...look }));
    }));
  }

  /** Where a row is: numbers of both coordinates. */
  function placeOf(row) {
    const j = map.rows.findIndex((line) => line?.includes(row));
    return [map.xs[map.rows[j].indexOf(row)], map.ys[j]];
  }

  const go = (place) => store.change({ q: store.state.q.with(map.first, place[0]).with(map.second, place[1]),
    moved: null });

  /** Mark the worst and the best cell, and say them. */
  function flag(x, y, found, { worst, best, value }) {
    const ends = { worst, best };
    what.tell(Object.fromEntries(Object.entries(ends).map(([name, row]) => {
      const place = placeOf(row);
      plot.flag(x, y, [x.place(place[0]), y.place(place[1])], name, name === "worst");
      const where = [map.first, map.second].map((i, k) => `${coordinate(i).name} ${inWords(store, i, place[k], 3)}`);
      return [name, { value: value(row), unit: found.unit, where: where.join(", "), go: () => go(place) }];
    })));
  }

  /** The bar of the colours: the best on top. */
  function bar(x, y, { worst, best, value, isLog }) {
    const [right, top] = [x.end, plot.margin.top];
    const height = y.start - top;
    for (let k = 0; k < 24; k++) plot.add("rect", { x: right + 8, y: top + (height * k) / 24, width: 9,
      height: height / 24 + 0.4, style: hue(1 - k / 23) });
    plot.text(right + 20, top + 8, `${short(value(best), 3)} best`);
    plot.text(right + 20, y.start, `${short(value(worst), 3)} worst`);
    if (isLog) plot.text(right + 20, (top + y.start) / 2 + 4, "log");
  }

  function draw() {
    const { width, height } = plot;
    if (!on() || !map || width < 120 || height < 50) return;
    const found = told();
    const { allowed } = store.state;
    const rows = map.rows.flatMap((line) => line ?? []);
    const good = goodness(found, rows, allowed);
    if (!good) return plot.say(`${found.title}: ${why(found, map.rows.find(Boolean)[0])}`);
    const [x, y] = axes();
    plot.node.replaceChildren();
    cells(x, y, good);
    const at = (i, list, value) => inWords(store, i, clamp(value, list[0], list.at(-1)), 3);
    plot.text(x.start, height - 4, at(map.first, map.xs, x.low));
    plot.text(x.end, height - 4, at(map.first, map.xs, x.high), "end");
    plot.text((x.start + x.end) / 2, height - 4, coordinate(map.first).name, "middle");
    plot.text(x.start - 4, y.start, at(map.second, map.ys, y.low), "end");
    plot.text(x.start - 4, y.end + 9, at(map.second, map.ys, y.high), "end");
    const [left, middle] = [12, (y.start + y.end) / 2];
    plot.text(left, middle, coordinate(map.second).name, "middle")
      .setAttribute("transform", `rotate(-90 ${left} ${middle})`);
    const inside = rows.filter((row) => row.q && !isOutside(row, allowed)).length / rows.length;
    const meaning = allowed
      ? `bright: within ${engineering(allowed, store.unit("length"), 3)}, ${short(100 * inside, 2)} %`
      : "bright is good";
    const unit = found.unit === "1" ? "" : ` [${found.unit}]`;
    plot.text(x.start, 14, `${found.called}${unit}: ${meaning}`, "start", "unit");
    bar(x, y, good);
    flag(x, y, found, good);
    // Where the mechanism stands.
    const [here, there] = [store.state.q[map.first], store.state.q[map.second]];
    if (here >= x.low && here <= x.high && there >= y.low && there <= y.high) plot.add("circle",
      { class: "here", cx: x.place(here), cy: y.place(there), r: 5 });
    plot.node.setAttribute("aria-label",
      `${found.title} along ${coordinate(map.first).name} and ${coordinate(map.second).name}, as colours from ${
        short(good.low, 3)} to ${short(good.high, 3)}${good.isLog ? ", by logarithms" : ""}: ${meaning}`);
  }

  /** The cell with these indices; null where no row has come. */
  function cellAt(i, j) {
    const row = map.rows[standsFor(j)]?.[i];
    return row ? { row, i, j, x: map.xs[i], y: map.ys[standsFor(j)] } : null;
  }

  /** The cell at a number of each coordinate. */
  const nearest = (at) => cellAt(...[map.xs, map.ys].map((list, k) => clamp(Math.round((at[k] - list[0]) / step(list)),
    0, list.length - 1)));

  /** The cell under a pointer, and the values there. */
  function under(event) {
    if (!map) return null;
    const at = axes().map((axis, k) => axis.value(plot.dots(event)[k]));
    if (!seen().every(([low, high], k) => at[k] >= low && at[k] <= high)) return null;
    const found = nearest(at);
    return found && { ...found, at };
  }

  plot.onwheel((times, event) => {
    const found = under(event);
    if (found) zoom(times, found.at);
    return found !== null;
  });
  /** Say a cell's values at a place of the screen. */
  function read(found, event) {
    if (!found) return what.say(null);
    const all = told();
    const value = all.one(found.row);
    const words = value === null ? why(all, found.row) : `${short(value, 5)} ${all.unit}`;
    what.say(`${inWords(store, map.first, found.x, 3)}, ${inWords(store, map.second, found.y, 3)}: ${words}`, event);
  }
  plot.node.addEventListener("pointermove", (event) => read(under(event), event));
  for (const event of ["pointerleave", "blur"]) plot.node.addEventListener(event, () => {
    what.say(null);
    chosen = null;
  });
  plot.node.setAttribute("tabindex", "0");
  let chosen = null; // the cell that the arrow keys have reached
  plot.node.addEventListener("keydown", (event) => {
    const way = ARROWS[event.key];
    if (!map || !way && event.key !== "Enter") return;
    event.preventDefault();
    if (!way) return chosen && go([chosen.x, chosen.y]);
    chosen = chosen ? cellAt(clamp(chosen.i + way[0], 0, map.xs.length - 1), clamp(chosen.j + way[1], 0,
      map.ys.length - 1)) : nearest([map.first, map.second].map((i) => store.state.q[i]));
    if (!chosen) return;
    const { left, top } = plot.node.getBoundingClientRect();
    const [x, y] = axes();
    read(chosen, { clientX: left + x.place(chosen.x), clientY: top + y.place(chosen.y) });
  });
  plot.node.addEventListener("click", (event) => {
    const found = under(event);
    if (found) go([found.x, found.y]);
  });

  /** The map as a file. */
  function keep(kind, name) {
    const all = told();
    const { title, unit, one } = all;
    const [first, second] = [map.first, map.second].map(coordinate);
    savePlot(kind, name, plot, {
      lines: provenance(store, map.state, `${title} [${unit}] along ${first.name} and ${second.name}`),
      legend: ["colours as in the bar, bright is good; grey: no value, or one that is not above zero; red and green "
        + "marks: the worst and the best; ring: the posture"],
      names: [...[first, second].map((each) => `${each.name} [${each.unit}]`), `value [${unit}]`],
      rows: map.ys.flatMap((y, j) => map.xs.map((x, i) => {
        const value = one(map.rows[j][i]);
        return [x, y, value, value === null ? why(all, map.rows[j][i]) : null];
      })),
    });
  }

  store.on("hello", ({ mechanism: { sliders } }) => {
    map = asked = null;
    select.offer([["", "as curves"], ...sliders.map((i) => [i, `and ${coordinate(i).name}`])]);
    select.hidden = sliders.length < 2 || !store.source.moves;
    show();
  });
  store.on("numbers", request);
  return { select, plot: plot.node, margin: plot.margin, on, show, current, request, draw, keep, zoom };
}
