// Beside what is in hand: states that were kept (posture, load, springs) and other mechanisms, a row
// each, with ratios; their pictures under the same camera, at the same scale.

import { byId, el, short, toast } from "./dom.js";
import { FINE } from "./deflection.js";
import { Pane } from "./pane.js";
import { freeness } from "./numbers.js";
import { LOOKS, METRES, Store, givenLoad } from "./store.js";

const LETTERS = ["A", "B", "C"];
// A picture that nobody sees.
const NONE = { reset() {}, apply() {}, wait() {}, holding: false };
// What another mechanism shares with the one in hand, its posture where its coordinates are the same.
const SHARED = ["load", "load_axes", "load_kind", "load_at", "point", "axes"];

// What decides which of a row's numbers stand beside those in hand.
const COMPARED = ["quantity", "connection", "others"];

/** One row: a kept state of the mechanism in hand, or another mechanism. */
class Row {
  constructor(main, letter, number, state) {
    Object.assign(this, { main, letter, number, state, numbers: null, error: null, pending: false, cells: null });
    this.own = number === (main.hello.number ?? 0);
    this.name = main.hello.mechanisms?.[number] ?? main.hello.mechanism.name;
    this.onchange = () => {};
  }

  get title() {
    return this.own ? this.letter : this.name;
  }

  /** Whether its coordinates are those of the mechanism in hand. */
  get alike() {
    const names = ({ hello }) => hello.mechanism.coordinates.map(({ name }) => name).join();
    return this.own || Boolean(this.store?.hello && names(this.store) === names(this.main));
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

  /** The state to show now. */
  wished() {
    const { state, legend } = this.main;
    const looks = { ...LOOKS(state), quantity: state.quantity, mode: null, ghost: null, measures: this.sameUnits ? legend?.measures ?? null : null };
    if (this.own) return { ...structuredClone(this.state), ...looks, moved: null };
    const shared = Object.fromEntries(SHARED.map((key) => [key, state[key]]));
    return { ...this.store.state, ...looks, ...shared, ...(this.alike ? { q: state.q, command: state.command } : {}), moved: null };
  }

  /** With a picture in a node, or without one. */
  open(node) {
    this.close();
    if (!node && this.own) return this.refresh();
    this.pane = node ? new Pane(node, []) : NONE;
    this.store = new Store(this.main.source.beside(this.number), this.pane, true);
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
    const [numbers, error] = await this.main.ask({ do: "numbers", state }).then((answer) => [answer.numbers, null], ({ message }) => [null, message]);
    if (key !== this.asked) return;
    this.pending = false;
    this.accept(numbers, state, error);
  }

  /** The curve of a sweep under this row's load and springs; null if it has no such coordinate. */
  async sweep(coordinate, steps) {
    const hello = (this.store ?? this.main).hello;
    if (!hello || !this.sameUnits || hello.mechanism.coordinates[coordinate]?.name !== this.main.hello.mechanism.coordinates[coordinate].name) return null;
    const wished = this.wished();
    const state = { ...wished, ...givenLoad(wished, this.numbers, hello.mechanism) };
    const answer = await (this.store ?? this.main).ask({ do: "sweep", coordinate, steps, state });
    return { title: this.title, at: answer.at, rows: answer.rows };
  }
}

/** Values of a row's numbers: how far the load moves the point, and the softest of each freedom. */
function values(numbers, { quantity }) {
  const soft = (freedom) => numbers.principal?.[freedom].values.at(quantity === "stiffness" ? 0 : -1) ?? null;
  return [numbers.moved?.resisted ? Math.hypot(...numbers.moved.displacement) : null, soft("translation"), soft("rotation")];
}

/** In words, how a kept state differs from the one in hand. */
function difference(store, row) {
  if (!row.own) return row.alike ? "" : "its own posture";
  const differs = (...keys) => keys.some((key) => JSON.stringify(row.state[key]) !== JSON.stringify(store.state[key]));
  return [[["q", "command"], "posture"], [["load", "load_axes", "load_kind", "load_at", "gravity", "payload"], "load"], [["stiffness"], "springs"], [["point", "axes"], "point"]]
    .filter(([keys]) => differs(...keys)).map(([, word]) => word).join(", ") || "the same";
}

export function compareCard(store) {
  const table = el("table", { class: "compared" });
  const keep = el("button", { type: "button", title: "Keep posture, load and springs as a row to compare with", onclick: () => add() }, "Keep as A");
  const pictures = el("input", { type: "checkbox", onchange: () => show() });
  const words = el("p", { class: "dim small" });
  const card = el("details", { class: "card compare-card" }, el("summary", {}, el("h2", {}, "Compare"), el("span", { class: "dim small" })),
    el("div", { class: "row" }, keep, el("label", { class: "check" }, pictures, "pictures side by side")), table, words);
  byId("right").append(card);
  const beside = byId("beside");

  const free = () => LETTERS.find((letter) => !store.rows.some((row) => row.letter === letter));

  function add(letter = free(), state = store.state) {
    if (!letter || !store.numbers) return;
    if (letter === "A" && !store.pinned) return store.pin(); // its row follows
    insert(new Row(store, letter, store.hello.number ?? 0, structuredClone({ ...state, moved: null })));
    card.open = true;
  }

  function insert(row) {
    row.onchange = update;
    store.rows.push(row);
    store.rows.sort((a, b) => a.own - b.own || a.letter.localeCompare(b.letter));
    show();
    store.tell("rows", store.rows);
  }

  function remove(row) {
    if (row.letter === "A" && row.own && store.pinned) return store.unpin();
    row.close();
    store.rows.splice(store.rows.indexOf(row), 1);
    show();
    store.tell("rows", store.rows);
  }

  /** Rows with their pictures, or without. */
  function show() {
    const seen = pictures.checked && store.rows.length > 0;
    beside.hidden = !seen;
    byId("middle").classList.toggle("compared-pictures", seen);
    for (const row of store.rows) {
      if (seen === Boolean(row.figure?.isConnected) && (row.store || !seen && row.own)) continue;
      row.figure?.remove();
      row.figure = null;
      row.asked = null;
      if (seen) {
        const node = el("div", { class: "pane" });
        row.figure = el("figure", {}, node, el("figcaption", {}, row.title));
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
      row.pane.seeAs(store.pane, (there / metres(row.units)) / (here / metres(store.hello.mechanism.units)));
    }
  });

  function update() {
    const { rows, numbers } = store;
    const letter = free();
    keep.disabled = !letter;
    keep.textContent = letter ? `Keep as ${letter}` : "Three are kept";
    card.querySelector("summary .dim").textContent = rows.length ? rows.map((row) => (row.title)).join(", ") : "keep states, set them side by side";
    words.textContent = rows.length ? "× is the ratio of a row to the current state (N). Pictures: one camera, radii as in the legend; dash-dotted curves below are rows." : "";
    table.hidden = !rows.length;
    if (!rows.length || !numbers) return;
    const stiff = store.shown.quantity === "stiffness";
    const [factor, unit] = FINE[store.unit("length")] ?? [1, store.unit("length")];
    const units = store.blockUnits();
    const [moving, turning] = freeness(store.shown);
    const heads = [["moves", unit], [`${stiff ? "softest" : "most compliant"}, ${moving}`, units[1][1]], [`in rotation, ${turning}`, units[0][0]]];
    const reads = [(x) => x * factor, (x) => store.read(x), (x) => x];
    const here = values(numbers, store.shown);
    const line = (name, title, found, note, ...buttons) => el("tr", { title: title ?? null }, el("th", { scope: "row" }, name, " ", el("span", { class: "dim" }, note), ...buttons),
      ...found);
    const cell = (x, k, ratio) => el("td", { class: "num" }, x === null ? "–" : short(reads[k](x), 4), ratio === null ? "" : el("span", { class: "ratio dim" }, ` × ${short(ratio, 3)}`));
    table.replaceChildren(
      el("thead", {}, el("tr", {}, el("td"), ...heads.map(([word, of]) => el("th", { scope: "col" }, word, el("br"), el("span", { class: "unit" }, of))))),
      el("tbody", {}, line(el("b", {}, "N"), "The current state", here.map((x, k) => cell(x, k, null)), store.hello.mechanisms?.length > 1 ? store.hello.mechanism.name : "now"),
        ...rows.map((row) => {
          const name = row.title;
          const found = row.numbers && row.sameUnits ? values(row.numbers, store.shown) : [null, null, null];
          // Until it is answered, a row keeps its numbers and the ratios that belong to them.
          if (!row.late || !row.cells) row.cells = found.map((x, k) => cell(x, k, x !== null && here[k] ? x / here[k] : null));
          const note = row.error ?? (row.numbers && !row.sameUnits ? "other units" : difference(store, row));
          const button = (text, title, onclick) => el("button", { type: "button", class: "quiet", title, "aria-label": title, onclick }, text);
          const actions = row.own ? [button("→", `Go to ${name}`, () => store.change({ ...structuredClone(row.state), theme: store.state.theme, moved: null, ghost: store.state.ghost })),
            button("✕", `Forget ${name}`, () => remove(row))]
            : [el("a", { class: "quiet", href: `?mechanism=${row.number}`, title: `Open ${name}` }, "→")];
          const shown = line(el("b", {}, name), null, row.cells, note, ...actions);
          shown.classList.toggle("late", row.late);
          return shown;
        })));
  }

  let before = "";
  store.on("hello", ({ mechanism, mechanisms = [], number = 0 }) => {
    const now = `${mechanism.name} ${mechanism.frame}`;
    if (now === before) return;
    if (before && store.rows.some(({ own }) => own)) toast("Kept states were of the frame before: they are forgotten");
    before = now;
    for (const row of store.rows.splice(0)) row.close();
    if (mechanisms.length > 1) pictures.checked = card.open = true;
    mechanisms.forEach((name, k) => { if (k !== number) insert(new Row(store, String(k), k, null)); });
    update();
  });
  store.on("pinned", (pinned) => {
    const row = store.rows.find(({ letter, own }) => own && letter === "A");
    if (!pinned) {
      if (row) {
        row.close();
        store.rows.splice(store.rows.indexOf(row), 1);
        show();
        store.tell("rows", store.rows);
      }
    } else if (!row || JSON.stringify(row.state.q) !== JSON.stringify(pinned.q)) {
      if (row) store.rows.splice(store.rows.indexOf(row), 1)[0].close();
      if (store.state) insert(new Row(store, "A", store.hello.number ?? 0, structuredClone({ ...(pinned.state ?? store.state), q: pinned.q, moved: null, ghost: null })));
    }
  });
  store.on("numbers", () => {
    for (const letter of ["B", "C"]) {
      const state = store.keeps[letter];
      delete store.keeps[letter];
      if (state) add(letter, state);
    }
    for (const row of store.rows) row.refresh();
    update();
  });
  store.on("units", update);
  return { add };
}
