// Beside what is in hand: states that were kept (posture, load, springs) and other mechanisms, a row
// each, with ratios; their pictures under the same camera, at the same scale.

import { displacementWords } from "./deflection.js";
import { button, byId, card, checkbox, el, heading, inSize, short } from "./dom.js";
import { callOut } from "./give.js";
import { actsAt, givenLoad, wayOf } from "./loads.js";
import { symbol } from "./matrix.js";
import { freeness } from "./numbers.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { Pane } from "./pane.js";
import { legColours } from "./shares.js";
import { LOOKS, METRES, Store, partOf } from "./store.js";

// A picture that nobody sees.
const NONE = { reset() {}, apply() {}, wait() {}, holding: false };
// What another mechanism shares with the one in hand, its posture where its coordinates are the same.
const SHARED = ["load", "load_axes", "load_kind", "load_at", "point", "axes"];

// What decides which of a row's numbers stand beside those in hand.
const COMPARED = ["quantity", "connection", "others"];
// How the numbers of a state that was kept are read: as those in hand.
const READ = [...COMPARED, "point", "axes"];

/** One row: a kept state of the mechanism in hand, or another mechanism. */
class Row {
  constructor(main, number, kept = null) {
    this.main = main;
    this.number = number;
    this.kept = kept;
    /** @type {any} */
    this.numbers = null;
    this.shown = this.error = this.cells = this.asked = this.store = this.pane = this.figure = null;
    this.caption = this.bar = null;
    this.pending = false;
    this.own = kept !== null;
    this.title = kept ? String(kept.number) : main.hello.mechanisms[number];
    this.onchange = () => {};
  }

  /** Whether its numbers can be set beside those that are shown. */
  get comparable() {
    return Boolean(this.numbers && !this.late && READ.every((key) =>
      JSON.stringify(this.shown[key]) === JSON.stringify(this.main.shown[key])));
  }

  /** Whether it follows the hand, which moves coordinates of the same names: until then each is at its own posture. */
  get follows() {
    const { state, hello } = this.main;
    const names = (of) => of?.mechanism.coordinates.map(({ name }) => name).join();
    return names(this.store?.hello) === names(hello)
      && (String(state.command) !== String(hello.state.command)
        || state.q.some((x, i) => Math.abs(x - hello.state.q[i]) > NEGLIGIBLE_DIFFERENCE));
  }

  /** How far its load moves the point, in the unit of the mechanism in hand if it can be. */
  way(numbers, store = this.store) {
    return displacementWords(this.sameUnits ? this.main : store, numbers);
  }

  /** Whether its numbers belong to what was wished before. */
  get late() {
    const { store } = this;
    const ofAnother = this.shown && COMPARED.some((key) => this.shown[key] !== this.main.shown[key]);
    return this.pending || ofAnother || Boolean(store?.hello && (store.busy !== null || store.wanted));
  }

  get units() {
    return (this.store?.hello ?? this.main.hello).mechanism.units;
  }

  get sameUnits() {
    return JSON.stringify(this.units) === JSON.stringify(this.main.hello.mechanism.units);
  }

  /** The state to show now: read as what is shown, where what is wanted has no answer. */
  wished() {
    const { legend, refused } = this.main;
    const state = refused === null ? this.main.state : this.main.shown;
    const looks = { ...LOOKS(state), quantity: state.quantity, mode: null, ghost: null,
      measures: this.sameUnits ? legend?.measures ?? null : null };
    if (this.own) return { ...structuredClone(this.kept.state), ...looks, load_at: actsAt(this.kept.state),
      point: state.point, axes: state.axes, moved: null };
    const { q, command } = this.follows ? state : this.store.hello.state;
    return { ...this.store.state, ...looks, ...partOf(state, SHARED), q, command, moved: null };
  }

  /** With a picture in a node, or without one. */
  open(node) {
    this.close();
    if (!node && this.own) return this.refresh();
    this.pane = node ? new Pane(node, []) : NONE;
    const store = this.store = new Store(this.main.source.beside(this.number), this.pane, true);
    if (node) {
      callOut(store, () => this.way(store.numbers, store));
      legColours(store);
    }
    this.store.on("hello", () => Object.assign(this.store.state, this.wished()));
    this.store.on("numbers", () => this.accept(this.store.numbers, this.store.shown));
    this.store.on("error", (text) => this.accept(null, null, text));
    this.store.source.start();
  }

  close() {
    this.store?.source.close();
    Object.assign(this, { store: null, pane: null, pending: false, asked: null });
  }

  /** Numbers, the state that they are of, or why there are none. */
  accept(numbers, shown, error = null) {
    this.figure?.classList.remove("waits");
    Object.assign(this, { numbers, shown, error });
    this.onchange();
  }

  refresh() {
    const wished = this.store && !this.store.hello ? null : this.wished();
    const key = JSON.stringify(wished);
    if (!wished || key === this.asked) return;
    this.asked = key;
    if (this.store) this.store.apply(wished);
    else this.ask(key, wished);
  }

  /** A state without a picture: only the answer to the newest question counts. */
  async ask(key, state) {
    this.pending = true;
    const [numbers, error] = await this.main.ask({ do: "numbers", state })
      .then((answer) => [answer.numbers, null], ({ message }) => [null, message]);
    if (key !== this.asked) return;
    this.pending = false;
    this.accept(numbers, state, error);
  }

  /** The curve of a sweep under this row's load and springs; null if it has no such coordinate. */
  async sweep(coordinate, steps) {
    const hello = (this.store ?? this.main).hello;
    const nameIn = ({ mechanism }) => mechanism.coordinates[coordinate]?.name;
    if (!hello || !this.sameUnits || nameIn(hello) !== nameIn(this.main.hello)) return null;
    const wished = this.wished();
    const state = { ...wished, ...givenLoad(wished, this.numbers, hello.mechanism) };
    const answer = await (this.store ?? this.main).ask({ do: "sweep", coordinate, steps, state });
    return { title: this.title, called: this.own ? `state ${this.title}` : this.title, at: answer.at,
      rows: answer.rows };
  }
}

/** Values of a row's numbers: how far the load moves the point, and the softest of each freedom. */
function values(numbers, { quantity }) {
  const soft = (freedom) => numbers.principal?.[freedom].values.at(quantity === "stiffness" ? 0 : -1) ?? null;
  return [wayOf(numbers), soft("translation"), soft("rotation")];
}

/** In words, how a kept state differs from the one in hand. */
function difference(store, row) {
  if (!row.own) return row.follows ? "" : "its own posture";
  const here = { ...store.state, load_at: actsAt(store.state) };
  const there = { ...row.kept.state, load_at: actsAt(row.kept.state) };
  /** @type {[string[], string][]} */
  const parts = [[["q", "command"], "posture"], [["stiffness"], "springs"],
    [["load", "load_axes", "load_kind", "load_at", "gravity", "payload"], "load"]];
  return parts.filter(([keys]) => keys.some((key) => JSON.stringify(here[key]) !== JSON.stringify(there[key])))
      .map(([, word]) => word).join(", ") || "the same";
}

export function compareCard(store) {
  const table = el("table.compared");
  const keep = button("", () => store.keep(),
    { title: "Keep posture, load and springs as a state to compare with (a)" });
  const aside = checkbox("pictures side by side", () => show(),
    { title: "One camera, one scale, radii as in the legend" });
  const pictures = aside.control;
  card("right", "div.card.compare-card", heading("States", aside, keep), table);
  const beside = byId("beside");

  function insert(row) {
    row.onchange = () => {
      update();
      store.tell("rows", store.rows);
    };
    store.rows.push(row);
    store.rows.sort((a, b) => a.own - b.own || a.title.localeCompare(b.title));
  }

  /** The rows of the states that are kept now, beside those of other mechanisms. */
  function reconcile() {
    for (const row of store.rows.filter(({ own, kept }) => own && !store.kept.includes(kept))) {
      row.close();
      store.rows.splice(store.rows.indexOf(row), 1);
    }
    for (const kept of store.kept) if (!store.rows.some((row) => row.kept === kept)) insert(new Row(store,
      store.hello.number ?? 0, kept));
    show();
    store.tell("rows", store.rows);
  }

  /** Rows with their pictures, or without. */
  function show() {
    const seen = pictures.checked && store.rows.length > 0;
    beside.hidden = !seen;
    byId("middle").style.setProperty("--others", `${store.rows.length}fr`);
    byId("middle").classList.toggle("compared-pictures", seen);
    for (const row of store.rows) {
      if (seen === Boolean(row.figure?.isConnected) && (row.store || !seen && row.own)) continue;
      row.figure?.remove();
      Object.assign(row, { figure: null, asked: null });
      if (seen) {
        const node = el("div.pane");
        row.bar = el("i.scale");
        row.caption = el("figcaption");
        row.figure = el("figure.waits", node, row.caption);
        beside.append(row.figure);
        row.open(node);
      } else row.open(null);
    }
    for (const figure of [...beside.children]) if (!store.rows.some((row) => row.figure === figure)) figure.remove();
    update();
    store.pane.viewer.set_dirty();
  }

  // The eye follows that of the picture in hand, at the same scale.
  store.pane.before.push(() => {
    for (const row of store.rows) {
      const [here, there] = [store.legend?.per_length, row.store?.legend?.per_length];
      if (!row.figure || !here || !there) continue;
      const metres = (units) => 10 ** (METRES[units.length] ?? 0);
      row.bar.style.width = `${row.store.legend.bar.length * row.pane.dotsPerUnit}px`;
      row.pane.seeAs(store.pane, (there / metres(row.units)) / (here / metres(store.hello.mechanism.units)));
    }
  });

  /** Under the picture of a row: what it is, how far the load moves it, and its scale. */
  function caption(row) {
    const { numbers } = row;
    const way = numbers?.moved?.resisted ? `, ${row.way(numbers)}` : "";
    row.caption?.replaceChildren(row.own ? `State ${row.title}${way}` : `${row.title}${way}`, el("br"), row.bar,
      ` ${row.store?.legend?.bar.text ?? ""}`);
  }

  function update() {
    const { rows, numbers } = store;
    for (const row of rows) if (row.figure) caption(row);
    const { dataset } = byId("legend");
    delete dataset.name;
    if (numbers && !beside.hidden) {
      const way = numbers.moved?.resisted ? `, ${displacementWords(store)}` : "";
      dataset.name = `${store.hello.mechanism.name}${way}`;
    }
    keep.disabled = !store.freeNumber;
    keep.textContent = store.freeNumber ? `Keep as ${store.freeNumber}` : "Three are kept";
    table.hidden = aside.hidden = !rows.length;
    if (!rows.length || !numbers) return;
    const here = values(numbers, store.shown);
    const [[turnUnit], [, moveUnit]] = store.blockUnits();
    const sizes = [store.unit("length"), moveUnit, turnUnit]
      .map((unit, k) => inSize((k ? here[k] : store.sizes.displacement) ?? 0, unit));
    const [moving, turning] = freeness(store.shown);
    const heads = [["moves", ""], ["softest", `, ${moving}`], ["in rotation", `, ${turning}`]];
    const line = (name, title, found, note, ...buttons) =>
      el("tr", { title: title ?? null }, el("th", { scope: "row" }, name, " ", el("span.dim", note), ...buttons),
      ...found);
    const cell = (x, k, ratio) => el("td.num", x === null ? "–" : short(x / sizes[k][0]),
      ratio === null ? "" : el("span.ratio.dim", ` × ${short(ratio, 3)}`));
    table.replaceChildren(
      el("thead", el("tr", el("td"),
        ...heads.map(([word, others], k) => el("th", { scope: "col", title: k ? `of ${symbol(store)}` : null },
          word, el("br"), el("span.unit", sizes[k][1]), others)))),
      el("tbody", line(el("b", "now"), "The current state", here.map((x, k) => cell(x, k, null)),
        store.hello.mechanisms?.length > 1 ? store.hello.mechanism.name : ""),
        ...rows.map((row) => {
          const name = row.title;
          const found = row.numbers && row.sameUnits ? values(row.numbers, store.shown) : [null, null, null];
          // Until it is answered, a row keeps its numbers and the ratios that belong to them.
          if (!row.late || !row.cells) row.cells = found.map((x, k) =>
            [x, k, x !== null && here[k] ? x / here[k] : null]);
          const note = row.error ?? (row.numbers && !row.sameUnits ? "other units" : difference(store, row));
          const act = (text, title, onclick) => button(text, onclick, { class: "quiet", title, "aria-label": title });
          const actions = row.own ? [act("→", `Go to state ${name}`, () => store.goToKept(row.kept.number)),
            act("✕", `Forget state ${name}`, () => store.setKept(store.kept.filter((one) => one !== row.kept)))]
            : [el("a.quiet", { href: `?mechanism=${row.number}`, title: `Open ${name}` }, "→")];
          const shown = line(el("b", name), null, row.cells.map((one) => cell(...one)), note, ...actions);
          shown.classList.toggle("late", row.late);
          return shown;
        })));
  }

  let before = "";
  store.on("hello", ({ mechanism, mechanisms: named = [], number = 0, guides }) => {
    const mechanisms = guides ? [] : named; // those of other guided starts are not beside this one
    const now = `${mechanism.name} ${mechanism.frame}`;
    if (now !== before) {
      before = now;
      for (const row of store.rows.splice(0)) row.close();
      if (mechanisms.length > 1) pictures.checked = true;
      mechanisms.forEach((name, k) => { if (k !== number) insert(new Row(store, k)); });
    }
    reconcile();
  });
  store.on("kept", reconcile);
  const refresh = () => { for (const row of store.rows) row.refresh(); };
  store.on("refused", refresh);
  store.on("numbers", () => {
    refresh();
    update();
  });
}
