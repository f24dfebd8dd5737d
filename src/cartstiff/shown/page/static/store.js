// What is wanted (`state`), and what is shown: the newest answer and the state that it answers (`shown`).
// Words about numbers are read from `shown`, never from `state`.
// One question is in flight; while it is, only the newest state is kept.

import { LOST, SUPERSEDED, short } from "./dom.js";
import { legendOf } from "./legend.js";
import { givenLoad } from "./loads.js";

// Time (ms) after which what is shown is said to be of another posture.
const LATE = 700;
// Steps that can be taken back, and the time (ms) within which changes of one kind are one step.
const MOST_PAST = 200;
const TOGETHER = 800;

/** Tells of: hello, state, numbers, kept, error, late, refused, angles, rows, local, plot, replot, said, trace. */
export class Store extends EventTarget {
  constructor(source, pane = null, quiet = false) {
    super();
    this.source = source;
    this.pane = pane;
    this.quiet = quiet; // another store beside the page's own
    this.rows = []; // what is compared with, see compare.js
    this.kept = []; // of these, states that were kept: {number: 1, 2, 3; state}
    this.state = null; // what is wanted, see state.py
    this.hello = null;
    this.numbers = null; // what is shown
    this.shown = null; // the state that `numbers` are of
    this.refused = null; // why there are no numbers of what is wanted
    this.legend = null;
    this.angle = "deg";
    this.busy = null;
    this.wanted = false;
    this.number = 1;
    this.waiting = new Map();
    this.towards = null; // {towards: {pose, turning}} of a hand, or {lengths} of legs
    this.past = [];
    this.future = [];
    this.lastTime = 0; // of a step
    this.plot = null; // what the plot shows
    this.isPlaying = false; // whether the picture moves by itself
    this.showPlot = (_change) => {}; // shows something else
    this.trace = null; // what the colours of its way in the picture say
    source.onanswer = (data, commands) => this.receive(data, commands);
    source.onlost = () => this.lost();
    source.onalone = () => this.alone();
  }

  on(event, listener) {
    this.addEventListener(event, (/** @type {any} */ { detail }) => listener(detail));
  }

  /** A listener that fails is reported, and keeps nothing from the others. */
  tell(event, detail) {
    this.dispatchEvent(new CustomEvent(event, { detail }));
  }

  /**
   * Keep everything that a step may change, to come back to it; changes of one kind in quick succession are one step.
   */
  remember(kind) {
    const now = performance.now();
    const again = kind === this.lastKind && now - this.lastTime < TOGETHER;
    [this.lastKind, this.lastTime] = [kind, now];
    if (again || this.pane.holding && !kind.startsWith("hand")) return;
    this.past.push(this.step());
    if (this.past.length > MOST_PAST) this.past.shift();
    this.future = [];
  }

  step() {
    const { kept, angle, plot, hello: { mechanism: { frame } } } = this;
    return { state: structuredClone(this.state), kept, angle, plot: { ...plot }, frame };
  }

  undo = () => this.travel(this.past, this.future);
  redo = () => this.travel(this.future, this.past);

  async travel(from, to) {
    if (!from.length || !this.state) return;
    to.push(this.step());
    this.lastKind = null;
    await this.restore(from.pop());
  }

  /** Frame what a button has done, from the present side, once it is shown; a view that somebody turned stays. */
  follow() {
    const frame = () => this.ask({ do: "bounds" }).then(({ bounds }) => this.pane.keepInView(bounds), () => {});
    this.addEventListener("numbers", frame, { once: true });
  }

  /** Show everything as a step, or an address, has it. */
  async restore({ state, kept, angle, plot, frame }) {
    if (frame !== this.hello.mechanism.frame) await this.ask({ do: "frame", name: frame });
    this.kept = kept;
    const wishes = { ...state, theme: this.state.theme, moved: null };
    if (this.sent) this.apply(wishes);
    else Object.assign(this.state, wishes); // the first picture is asked for once all is known
    this.tell("kept", kept);
    this.tell("angles", angle);
    this.wishedPlot = plot;
    if (this.sent) this.tell("replot");
  }

  /** Pull M towards a pose, or legs to lengths, see state.py. */
  reach(towards) {
    this.sticky = false;
    this.towards = towards;
    const given = this.given();
    if (given.load) {
      Object.assign(this.state, given);
      this.tell("state", given);
    }
    this.state.moved = null;
    this.draw();
  }

  /** What of the state another posture needs changed: see `givenLoad`. */
  given() {
    return this.state.load === null && this.shown?.load === null
      ? givenLoad(this.state, this.numbers, this.hello.mechanism) : {};
  }

  /** The state from which curves begin. */
  onTheWay() {
    return structuredClone({ ...this.state, ...this.given() });
  }

  /** What computes in the browser, if anything does. */
  get local() {
    return this.source.program ? this.source : this.source.local;
  }

  /** Change what is wanted, and ask for it. */
  change(patch) {
    if (!this.state) return;
    if (patch.q && !("load" in patch) && String(patch.q) !== String(this.state.q)) patch = { ...this.given(),
      ...patch };
    const kinds = Object.keys(patch).filter((key) => key !== "theme"
      && JSON.stringify(patch[key]) !== JSON.stringify(this.state[key]));
    if (kinds.length && this.numbers) this.remember(`${kinds.filter((key) => key !== "moved")} ${patch.moved ?? ""}`);
    this.apply(patch);
  }

  apply(patch) {
    this.sticky = false;
    this.towards = null;
    Object.assign(this.state, patch);
    this.tell("state", patch);
    this.draw();
  }

  /** Move one coordinate. */
  move(index, value) {
    const q = this.state.q.slice();
    q[index] = value;
    this.change({ q, moved: index });
  }

  /** Go to a whole posture. */
  goTo(q) {
    this.change({ q: q.slice(), moved: null });
  }

  draw() {
    if (this.busy !== null) {
      this.wanted = true;
      return;
    }
    this.wanted = false;
    /** @type {Messages.Message} */
    const question = { do: "draw", id: this.number, state: structuredClone(this.state), ...this.towards };
    this.busy = this.number++;
    this.sent = question.state;
    this.towards = null;
    if (this.numbers) this.lateness ??= setTimeout(() => this.tell("late", true), LATE);
    this.say("sent", this.busy);
    this.source.ask(question);
  }

  /**
   * Ask something else; resolves with the answer, rejects with the reason in words.
   *
   * @param {Messages.Question} message
   * @returns {Promise<any>}
   */
  ask(message) {
    return new Promise((resolve, reject) => {
      const question = { id: this.number++, state: this.state, ...message };
      this.waiting.set(question.id, { resolve, reject });
      this.source.ask(question);
    });
  }

  /** Ask again where a newer question took its place, as long as the answer is wanted; undefined if it no longer is. */
  async insist(message, isWanted = () => true) {
    while (await isWanted()) {
      try {
        return await this.ask(message);
      } catch (error) {
        if (error.message !== SUPERSEDED) throw error;
      }
    }
  }

  receive(data, commands) {
    if (data.do === "hello") return this.greet(data, commands);
    if (data.do === "additions") {
      this.pane.apply(commands);
      this.pane.viewer?.set_dirty();
      return this.tell("additions", data);
    }
    if (data.do === "go-to") return this.state && this.goTo(data.q);
    const waiting = this.waiting.get(data.id);
    if (waiting) {
      this.waiting.delete(data.id);
      if (data.do === "program") data.packed = commands; // not to be shown at once
      else if (commands.length) this.pane.apply(commands);
      if (data.error) waiting.reject(new Error(data.error));
      else waiting.resolve(data);
      return;
    }
    if (data.id === 0 && data.error) this.fail(data);
    if (data.id !== this.busy) return;
    this.busy = null;
    try {
      if (data.error) this.fail(data);
      else this.accept(data, commands);
    } finally {
      if (this.wanted) this.draw();
    }
  }

  greet(data, commands) {
    const waiting = this.waiting.get(data.id);
    this.waiting.clear();
    const again = this.hello !== null && this.hello.mechanism.frame === data.mechanism.frame &&
      this.hello.mechanism.name === data.mechanism.name;
    const kept = again ? this.state : data.now;
    const looks = this.state;
    if (this.hello?.mechanism.name !== data.mechanism.name) [this.past, this.future, this.kept] = [[], [], []];
    this.kept = data.kept?.map((state, k) => ({ number: this.kept[k].number, state })) ?? this.kept;
    this.hello = data;
    this.state = kept ?? { ...data.state, ...(looks ? LOOKS(looks) : {}) };
    this.busy = null;
    this.pane.reset(commands, data.bounds);
    this.tell("hello", data);
    this.tell("state", this.state);
    waiting?.resolve(data);
    if (this.busy !== null) return;
    // What is wanted may be what the picture shows already.
    if (data.first && JSON.stringify(this.state) === JSON.stringify(data.state)) {
      this.sent = structuredClone(this.state);
      this.accept({ id: data.id, ...data.first }, []);
    } else {
      this.draw();
      this.pane.wait();
    }
  }

  accept(data, commands) {
    const { numbers } = data;
    this.numbers = numbers;
    this.shown = this.sent;
    this.legend = legendOf(data.legend, data.legend.quantity === this.shown.quantity ? this.sizes : {});
    if (this.pane) this.pane.extent = this.legend.size;
    this.refuse(null);
    this.inTime();
    // A closed chain has been assembled: its other coordinates, and without newer wishes all.
    // Commands of drives are added to the coordinates that they had before, "q" of the numbers.
    const wished = this.wanted && !this.towards ? this.hello.mechanism.sliders : [];
    this.state.q = this.ownQ.map((x, i) => (wished.includes(i) ? this.state.q[i] : x));
    this.tell("numbers", data);
    this.say("table", data.id);
    this.pane.apply(commands, () => this.say("rendered", data.id));
  }

  /** What is shown is what was wanted a moment ago. */
  inTime() {
    clearTimeout(this.lateness);
    this.lateness = null;
    this.tell("late", false);
  }

  /** Tell the document, for whoever measures. */
  say(what, detail) {
    if (!this.quiet) document.dispatchEvent(new CustomEvent(`cartstiff:${what}`, { detail }));
  }

  /** Say, or no longer say, that what is wanted has no answer: what is shown is of another state. */
  refuse(reason) {
    if (this.refused === reason) return;
    this.refused = reason;
    this.tell("refused", reason);
  }

  /** The server has gone, and the page answers: everything is drawn anew from what it has. */
  alone() {
    const { local } = this.source;
    this.pane.reset(local.listed(local.data.start), this.hello.bounds);
    this.draw();
  }

  fail(data) {
    this.inTime();
    // What an address asked for may be impossible: then the first state is shown.
    if (!this.numbers && this.state && !this.retried) {
      this.retried = true;
      this.sticky = true; // the reason stays until something else is wished
      this.state = { ...structuredClone(this.hello.state), theme: this.state.theme };
      this.wanted = true;
    } else if (this.numbers) this.refuse(data.error);
    this.tell("error", data.error);
  }

  /** The connection has gone: nothing that was asked will be answered. */
  lost() {
    this.busy = null;
    this.inTime();
    this.wanted = false;
    for (const { reject } of this.waiting.values()) reject(new Error(LOST));
    this.waiting.clear();
  }

  /** Coordinates of the shown numbers, before drives were commanded elsewhere. */
  get ownQ() {
    return this.numbers.q ?? this.numbers.result.q;
  }

  get freeNumber() {
    return [1, 2, 3].find((n) => !this.kept.some((one) => one.number === n));
  }

  /** Keep posture, load and springs under the lowest free number. */
  keep() {
    const number = this.freeNumber;
    if (number && this.numbers) this.setKept([...this.kept,
      { number, state: { ...structuredClone(this.shown), q: this.ownQ.slice() } }]);
  }

  /** The states that are kept; the first is drawn pale. */
  setKept(kept, isStep = true) {
    if (isStep) this.remember("kept");
    this.kept = kept.toSorted((a, b) => a.number - b.number);
    this.apply({ ghost: this.kept[0]?.state.q.slice() ?? null });
    this.tell("kept", this.kept);
  }

  /** Go to a state that was kept. */
  goToKept(number = 1) {
    const found = this.kept.find((one) => one.number === number);
    if (!found) return;
    this.change({ ...structuredClone(found.state), ...LOOKS(this.state), quantity: this.state.quantity,
      ghost: this.state.ghost, moved: null });
    this.follow();
  }

  /** Whether a load is shown: one that was given, or that the springs exert. */
  get isLoaded() {
    return Boolean(this.numbers?.moved) || Boolean(this.shown.load?.some((x) => x));
  }

  /** The shown matrix of a connection, at the reference point: 6 rows, or null. */
  matrix(name, numbers = this.numbers, quantity = this.shown.quantity) {
    const table = numbers && (numbers[quantity] ?? numbers.result[quantity]);
    if (!table) return null;
    if (name === "load" && !("load" in table)) return numbers.result.load[quantity] ?? null;
    if (name !== "+") return table[name] ?? numbers.own?.[name] ?? null;
    return table.A && table.A.map((_, i) => table.A.map((row) => row[i]));
  }

  unit(kind) {
    const { length, force } = this.hello.mechanism.units;
    return { length, force, moment: `${force} ${length}` }[kind];
  }

  /** Sizes of which the page's one unit of each quantity is: displacements, stiffnesses, as they are shown. */
  get sizes() {
    const { moved, principal } = this.numbers ?? {};
    const least = (kind) => principal?.[kind].values.map(Math.abs).filter((x) => x > 0).sort((a, b) => a - b)[0];
    const way = moved && Math.hypot(...moved.displacement) || undefined;
    return { displacement: way, deflection: way, translation: least("translation"), rotation: least("rotation") };
  }

  /** The unit of a cell. */
  unitOf(i, j) {
    return this.blockUnits()[Number(i > 2)][Number(j > 2)];
  }

  /** Units of the four blocks [[rr, rt], [tr, tt]]. */
  blockUnits(quantity = this.shown.quantity) {
    const [l, f, m] = ["length", "force", "moment"].map((kind) => this.unit(kind));
    return quantity === "stiffness" ? [[`${m}/rad`, f], [`${f}/rad`, `${f}/${l}`]]
      : [[`rad/(${m})`, `rad/${f}`], [`${l}/(${m})`, `${l}/${f}`]];
  }
}

// What of a state decides its numbers, besides the posture; what else decides curves; how it is shown.
const MECHANICS = ["point", "stiffness", "load", "load_axes", "load_kind", "load_at", "gravity", "payload", "command"];
const CURVED = [...MECHANICS, "connection", "quantity", "others", "axes"];
const SEEN = ["theme", "translation", "rotation", "scale", "labels", "wrench", "deflection", "drawn", "enlarged",
  "centres", "held_forces", "connection", "others", "mode"];
export const mechanicsOf = (state) => MECHANICS.map((key) => state[key]);
/** What curves along some coordinates depend on; with null along all of them. */
export function curvesOf(store, running) {
  const state = { ...store.state, ...store.given() };
  const rest = running ? store.hello.mechanism.sliders.filter((i) => !running.includes(i)) : [];
  return [CURVED.map((key) => state[key]), rest.map((i) => state.q[i])];
}

/** Whether a coordinate is read in degrees. */
export const inDegrees = ({ angle }, coordinate) => !coordinate.is_length && angle === "deg";

/** A value of a coordinate in words. */
export function inWords(store, index, x, digits = 4) {
  const coordinate = store.hello.mechanism.coordinates[index];
  return inDegrees(store, coordinate) ? `${short((x * 180) / Math.PI, digits)}°`
    : `${short(x, digits)} ${coordinate.unit}`;
}

// Powers of ten.
export const METRES = { m: 0, cm: -2, mm: -3, "µm": -6 };
/** Of a state what says how numbers and picture are shown. */
export const LOOKS = (state) => partOf(state, SEEN);
/** What an object has under some names. */
export const partOf = (whole, names) => Object.fromEntries(names.map((name) => [name, whole[name]]));
