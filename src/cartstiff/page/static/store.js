// What is wanted (`state`), and what is shown: the newest answer and the state that it answers (`shown`).
// Words about numbers are read from `shown`, never from `state`.
// One question is in flight; while it is, only the newest state is kept.

import { cross, rotation, times } from "./algebra.js";
import { LOST } from "./dom.js";

// Steps that can be taken back, and the time (ms) within which changes of one kind are one step.
const MOST_PAST = 200;
const TOGETHER = 800;

export class Store {
  constructor(source, pane = null, quiet = false) {
    this.source = source;
    this.pane = pane;
    this.quiet = quiet; // another store beside the page's own
    this.rows = []; // what is compared with, see compare.js
    this.keeps = {}; // states that an address wants kept, by letter
    this.state = null; // what is wanted, see state.py
    this.hello = null;
    this.numbers = null; // what is shown
    this.shown = null; // the state that `numbers` are of
    this.refused = null; // why there are no numbers of what is wanted
    this.legend = null;
    this.pinned = null; // posture A: {q, numbers}
    this.angle = "deg";
    this.error = null;
    this.listeners = { hello: [], state: [], numbers: [], pinned: [], error: [], refused: [], pose: [], units: [], angles: [], rows: [], local: [], plot: [], replot: [] };
    this.fine = null; // the unit of length in which translations are read, if not the file's
    this.busy = null;
    this.wanted = false;
    this.number = 1;
    this.waiting = new Map();
    this.towards = null; // {pose, turning} of a hand, or {lengths} of legs
    this.past = [];
    this.future = [];
    source.onanswer = (data, commands) => this.receive(data, commands);
    source.onlost = () => this.lost();
    source.onalone = () => this.alone();
  }

  on(event, listener) {
    this.listeners[event].push(listener);
  }

  /** A listener that fails is reported, and keeps nothing from the others. */
  tell(event, detail) {
    for (const listener of this.listeners[event]) {
      try {
        listener(detail);
      } catch (error) {
        reportError(error);
      }
    }
  }

  /** Keep the state, to come back to it; changes of one kind in quick succession are one. */
  remember(kind) {
    const now = performance.now();
    const again = kind === this.lastKind && now - this.lastTime < TOGETHER;
    [this.lastKind, this.lastTime] = [kind, now];
    if (again || this.pane.holding && !kind.startsWith("hand")) return;
    this.past.push(structuredClone(this.state));
    if (this.past.length > MOST_PAST) this.past.shift();
    this.future = [];
  }

  undo() {
    this.travel(this.past, this.future);
  }

  redo() {
    this.travel(this.future, this.past);
  }

  travel(from, to) {
    if (!from.length || !this.state) return;
    to.push(structuredClone(this.state));
    this.lastKind = null;
    const { ghost } = this.state;
    const wanted = { ...from.pop(), theme: this.state.theme, moved: null };
    this.apply(wanted);
    if (JSON.stringify(ghost) !== JSON.stringify(wanted.ghost)) this.compareWith(wanted.ghost);
  }

  /** Pull M towards a pose, or legs to lengths, see state.py. */
  reach(towards) {
    this.sticky = false;
    this.towards = towards;
    const given = this.given();
    if (given.load) {
      Object.assign(this.state, given);
      this.tell("state", given);
      if (this.pinned) this.refreshPinned();
    }
    this.state.moved = null;
    this.draw();
  }

  /** What of the state another posture needs changed: see `givenLoad`. */
  given() {
    return this.state.load === null && this.shown?.load === null ? givenLoad(this.state, this.numbers, this.hello.mechanism) : {};
  }

  /** Change what is wanted, and ask for it. */
  change(patch) {
    if (!this.state) return;
    if (patch.q && !("load" in patch) && String(patch.q) !== String(this.state.q)) patch = { ...this.given(), ...patch };
    const kinds = Object.keys(patch).filter((key) => key !== "theme" && JSON.stringify(patch[key]) !== JSON.stringify(this.state[key]));
    if (kinds.length && this.numbers) this.remember(`${kinds.filter((key) => key !== "moved")} ${patch.moved ?? ""}`);
    this.apply(patch);
  }

  apply(patch) {
    this.sticky = false;
    this.towards = null;
    Object.assign(this.state, patch);
    this.tell("state", patch);
    this.draw();
    if (this.pinned && Object.keys(patch).some((key) => SHOWN.has(key))) this.refreshPinned();
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
      if (!this.towards) this.source.between?.(this);
      return;
    }
    this.wanted = false;
    this.busy = this.number++;
    this.sent = structuredClone(this.state);
    const { towards } = this;
    this.towards = null;
    this.say("sent", this.busy);
    this.source.ask({ id: this.busy, do: "draw", state: this.sent, ...(towards?.lengths ? towards : towards ? { towards } : {}) });
  }

  /** Ask something else; resolves with the answer, rejects with the reason in words. */
  ask(message) {
    const id = this.number++;
    return new Promise((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
      this.source.ask({ id, state: this.state, ...message });
    });
  }

  receive(data, commands) {
    if (data.do === "hello") return this.greet(data, commands);
    if (data.do === "go-to") return this.state && this.goTo(data.q);
    const waiting = this.waiting.get(data.id);
    if (waiting) {
      this.waiting.delete(data.id);
      if (data.do === "swing" || data.do === "program") data.packed = commands; // not to be shown at once
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
    this.hello = data;
    if (!again) [this.past, this.future] = [[], []];
    this.state = kept ?? { ...data.state, ...(looks ? LOOKS(looks) : {}) };
    this.busy = null;
    this.pane.reset(commands, data.bounds);
    if (!kept) this.pinned = null;
    this.tell("hello", data);
    this.tell("state", this.state);
    waiting?.resolve(data);
    if (data.now && this.pinned) this.refreshPinned();
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
    this.error = null;
    this.numbers = numbers;
    this.shown = this.sent;
    this.legend = data.legend;
    this.refuse(null);
    // A closed chain has been assembled: its other coordinates, and without newer wishes all.
    // Commands of drives are added to the coordinates that they had before, "q" of the numbers.
    const before = numbers.q ?? numbers.result.q;
    if (!this.wanted || this.towards) this.state.q = before.slice();
    else {
      const moved = new Set(this.hello.mechanism.sliders);
      const q = before.slice();
      for (const i of moved) q[i] = this.state.q[i];
      this.state.q = q;
    }
    this.tell("numbers", data);
    this.say("table", data.id);
    this.beforePicture?.();
    this.pane.apply(commands, () => this.say("rendered", data.id));
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

  /** Numbers and places of a state that pass: the server's answer follows. */
  pass(state, numbers, commands) {
    const { modes, weighed } = this.numbers;
    this.numbers = { ...numbers, modes, weighed };
    this.shown = structuredClone(state);
    this.refuse(null);
    this.tell("numbers", { numbers: this.numbers, legend: this.legend, followed: null, passing: true });
    this.pane.move(commands);
  }

  /** The server has gone, and the page answers: everything is drawn anew from what it has. */
  alone() {
    const { local } = this.source;
    this.pane.reset(local.listed(local.data.start), this.hello.bounds);
    this.draw();
  }

  fail(data) {
    this.error = data.error;
    // What an address asked for may be impossible: then the first state is shown.
    if (!this.numbers && this.state && !this.retried) {
      this.retried = true;
      this.sticky = true; // the reason stays until something else is wished
      this.state = { ...structuredClone(this.hello.state), theme: this.state.theme };
      this.wanted = true;
    } else this.refuse(data.error);
    this.tell("error", data.error);
  }

  /** The connection has gone: nothing that was asked will be answered. */
  lost() {
    this.busy = null;
    this.wanted = false;
    for (const { reject } of this.waiting.values()) reject(new Error(LOST));
    this.waiting.clear();
  }

  /** Coordinates as posture A, or none. */
  compareWith(q) {
    this.pinned = q ? { q: q.slice(), numbers: null, state: this.keeps.A } : null;
    this.tell("pinned", this.pinned);
    return this.refreshPinned();
  }

  /** Posture A under the connection, quantity and axes that are shown now. */
  async refreshPinned() {
    const pinned = this.pinned;
    if (!pinned) return;
    try {
      const state = { ...structuredClone(this.state), q: pinned.q, moved: null };
      pinned.numbers = (await this.ask({ do: "numbers", state })).numbers;
      pinned.shown = state;
    } catch {
      pinned.numbers = null;
    }
    if (this.pinned === pinned) this.tell("pinned", pinned);
  }

  pin() {
    this.pinned = this.numbers && { q: this.numbers.result.q.slice(), numbers: this.numbers, shown: this.shown, state: structuredClone(this.shown) };
    this.change({ ghost: this.pinned ? this.pinned.q : null });
    this.tell("pinned", this.pinned);
  }

  unpin() {
    this.pinned = null;
    this.change({ ghost: null });
    this.tell("pinned", null);
  }

  /** The numbers of posture A that can be set beside those that are shown; null while there are none. */
  get beside() {
    const { pinned, shown } = this;
    return pinned?.numbers && [...SHOWN].every((key) => JSON.stringify(pinned.shown[key]) === JSON.stringify(shown[key])) ? pinned.numbers : null;
  }

  /** The shown matrix of a connection, at the reference point: 6 rows, or null. */
  matrix(name, numbers = this.numbers, quantity = this.shown.quantity) {
    const table = numbers && (numbers[quantity] ?? numbers.result[quantity]);
    if (!table) return null;
    if (name === "load" && !("load" in table)) return numbers.result.load[quantity] ?? null;
    if (name !== "+") return table[name];
    return table.A && table.A.map((_, i) => table.A.map((row) => row[i]));
  }

  unit(kind) {
    const { length, force } = this.hello.mechanism.units;
    return { length, force, moment: `${force} ${length}` }[kind];
  }

  /** Units of the four blocks [[rr, rt], [tr, tt]] as they are read; `read` gives the last one's numbers. */
  blockUnits(quantity = this.shown.quantity) {
    const [l, f, m] = ["length", "force", "moment"].map((kind) => this.unit(kind));
    const fine = this.fine ?? l;
    return quantity === "stiffness"
      ? [[`${m}/rad`, f], [`${f}/rad`, `${f}/${fine}`]]
      : [[`rad/(${m})`, `rad/${f}`], [`${l}/(${m})`, `${fine}/${f}`]];
  }

  /** Units of length in which translations may be read; none where the file's is no metre. */
  get lengths() {
    const own = this.unit("length");
    return own in METRES ? [...new Set([own, "m", "mm", "µm"])] : [own];
  }

  /** A translational stiffness or compliance of the answer as it is read. */
  read(x, quantity = this.shown.quantity) {
    if (x === null || !this.fine) return x;
    const times = 10 ** (METRES[this.unit("length")] - METRES[this.fine]);
    return quantity === "stiffness" ? x / times : x * times;
  }

  /** Read translations in a unit of length. */
  readIn(unit) {
    this.fine = this.lengths.includes(unit) && unit !== this.unit("length") ? unit : null;
    this.tell("units", this.fine);
  }
}

/** Another posture moves the drives and leaves the load: the patch of a state that says so.
 *
 * Where the file says how springs rest, they exert a load of their own: it is given from then on,
 * along the room's axes unless it turns with the tool.
 */
export function givenLoad(state, numbers, { may_be_loaded: mayBe }) {
  const W = numbers?.result.wrench;
  if (!mayBe || state.load !== null || !W) return {};
  const at = state.load_at ?? [0, 0, 0];
  const force = W.slice(3);
  const moment = W.slice(0, 3).map((x, i) => x - cross(at, force)[i]);
  const turns = state.load_kind === "follower";
  const along = (v) => (turns ? v : times(rotation(numbers.result.pose), v));
  const load = numbers.moved ? [...along(moment), ...along(force)] : [0, 0, 0, 0, 0, 0];
  return { load, load_at: at, load_axes: turns ? "body" : "inertial" };
}

// Powers of ten.
export const METRES = { m: 0, cm: -2, mm: -3, "µm": -6 };
// What changes the numbers of a posture without moving it.
const SHOWN = new Set(["connection", "quantity", "others", "axes", "point", "stiffness", "load", "load_axes",
  "load_kind", "load_at", "gravity", "payload"]);

/** Of a state what says how numbers and picture are shown. */
export const LOOKS = ({ theme, translation, rotation, scale, labels, wrench, deflection, screws, centres,
  connection, others, mode }) =>
  ({ theme, translation, rotation, scale, labels, wrench, deflection, screws, centres, connection, others, mode });
