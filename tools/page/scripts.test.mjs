// Arithmetic and stores of the page's scripts, in node: `node --test tools/page`.

import assert from "node:assert/strict";
import { cpSync, mkdtempSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { test } from "node:test";
import { fileURLToPath, pathToFileURL } from "node:url";

// Modules by name; in a folder of their own that says so to node.
const STATIC = join(dirname(fileURLToPath(import.meta.url)), "../../src/cartstiff/shown/page/static");
const folder = mkdtempSync(join(tmpdir(), "page-"));
cpSync(STATIC, folder, { recursive: true });
writeFileSync(join(folder, "package.json"), '{ "type": "module" }');
const module = (name) => import(pathToFileURL(join(folder, `${name}.js`)).href);

const algebra = await module("algebra");
const dom = await module("dom");
const { nearer, isWhole } = await module("plot");
const plotfiles = await module("plotfiles");
const principal = await module("principal");
const { givenLoad } = await module("loads");
const { Store } = await module("store");
const { directionWords } = await module("words");

/** Numbers between -1 and 1, the same each time. */
function draws(seed) {
  let state = seed;
  return () => {
    state = (1103515245 * state + 12345) % 2 ** 31;
    return state / 2 ** 30 - 1;
  };
}
const random = (n, m, draw) => Array.from({ length: n }, () => Array.from({ length: m }, draw));
const close = (found, expected, within = 1e-12) => {
  const [a, b] = [found, expected].map((one) => [one].flat(2));
  assert.equal(a.length, b.length);
  a.forEach((x, i) => assert.ok(Math.abs(x - b[i]) <= within * Math.max(1, Math.abs(b[i])), `${x} is not ${b[i]}`));
};

test("a matrix times its inverse is the identity, whatever its units", () => {
  const A = random(6, 6, draws(1));
  const sizes = [1e-3, 1e-3, 1e-3, 1e4, 1e4, 1e4];
  close(algebra.product(A, algebra.inverse(A)), algebra.identity(6), 1e-10);
  const inverted = sizes.map((x) => 1 / x);
  const scaled = algebra.scaled(A, sizes);
  close(algebra.scaled(algebra.product(scaled, algebra.inverse(scaled, inverted)), inverted, sizes),
    algebra.identity(6), 1e-10);
  assert.equal(algebra.inverse([[1, 2], [2, 4]]), null);
});

test("eigenvectors and singular vectors build the matrix again", () => {
  const A = random(6, 6, draws(2));
  const S = algebra.symmetric(A);
  const { values, vectors } = algebra.eigen(S);
  close(values, values.toSorted((a, b) => a - b));
  close(algebra.congruence(vectors, algebra.scaled(algebra.identity(6), values, Array(6).fill(1))), S);
  const found = algebra.singular(A);
  const gram = algebra.product(algebra.transposed(A), A);
  close(algebra.congruence(found.vectors, algebra.scaled(algebra.identity(6), found.values)), gram, 1e-11);
});

test("a screw motion twice is that of twice the twist", () => {
  const twist = [0.3, -0.2, 0.4, 0.1, 0.5, -0.3];
  const once = algebra.screwing(twist);
  close(algebra.product(once, once), algebra.screwing(twist.map((x) => 2 * x)));
  close(algebra.product(once, algebra.back(once)), algebra.identity(4));
  const [roll, pitch, yaw] = algebra.angles(once);
  const about = (axis, angle) => algebra.rotation(algebra.moving([0, 1, 2].map((i) => (i === axis ? angle : 0))
    .concat(0, 0, 0)));
  close(algebra.product(algebra.product(about(2, yaw), about(1, pitch)), about(0, roll)), algebra.rotation(once));
});

test("matrices that differ in one cell say where, and by which share", () => {
  const K = algebra.scaled(algebra.identity(6), [1, 1, 1, 2, 2, 2]);
  const other = K.map((row) => row.slice());
  other[0][4] = 0.5;
  const [found, ...more] = principal.differences({ B: K, A: other });
  assert.deepEqual([found.i, found.j, found.high, found.low, more.length], [0, 4, "A", "B", 0]);
  close(found.share, 0.5 / 2);
  assert.deepEqual(principal.differences({ B: K, A: null }), []);
  assert.equal(principal.asymmetry(K), 0);
  close(principal.asymmetry(other), 0.5);
  assert.equal(principal.definiteness([-1, 0, 2]), "indefinite");
});

test("numbers are written as people do", () => {
  assert.equal(dom.engineering(75_700, "N/m"), "75.7 N/mm");
  assert.equal(dom.engineering(-0.00277, "m", 3), "−2.77 mm");
  assert.equal(dom.engineering(5e-7, "m", 3, 1e-3), "5e-4 mm");
  assert.equal(dom.engineering(null, "m"), "–");
  assert.equal(dom.together([0, -1.1e-8, -1.105e-4], "m"), "(0, 0, −110.5) µm");
  assert.deepEqual(dom.chop([1, 1e-14]), [1, 0]);
  assert.equal(dom.plainly("4 deg off -z"), "4° off −z");
  assert.equal(algebra.general(12345.678, 3), "1.23e+04");
  assert.equal(directionWords([0, 0, -1], false), "vertical downwards");
  assert.equal(directionWords([1, 0, 0.05], true), "almost horizontal, 3 deg off the xy plane, along x");
});

test("tables run in no spreadsheet, lines are wrapped, zooms stay within", () => {
  assert.equal(plotfiles.safeCell("=SUM(A1)"), "'=SUM(A1)");
  assert.equal(plotfiles.safeCell("-5.0"), "-5.0");
  assert.equal(plotfiles.table(["a"], ["x", "y"], [[1, null], [0.1, "b;c"]]), '# a\nx,y\n1,\n0.1,"b;c"\n');
  assert.deepEqual(plotfiles.wrapped("one two three", 7), ["one two", "three"]);
  const seen = nearer([0, 10], [0, 10], 2, 9, 0.1);
  assert.deepEqual(seen, [4.5, 9.5]);
  assert.ok(!isWhole(seen, [0, 10]) && isWhole(nearer(seen, [0, 10], 0.1, 9, 0.1), [0, 10]));
});

// -- stores ----------------------------------------------------------------------------------------

const STATE = { q: [0, 0], load: null, load_axes: "world", load_kind: "dead", load_at: null, theme: "light", ghost: null,
  connection: "load", quantity: "stiffness", mode: null, point: [0, 0, 0] };
const FACTS = { length: { unit: "m", bar: 1, size: 1, scene_units_per_unit: 1 }, ellipsoids: {}, notes: [] };

/** A store with a source that keeps its questions, and what answers the oldest. */
function opened() {
  const asked = [];
  const source = { ask: (message) => asked.push(message), live: true };
  const pane = { apply: () => {}, reset: () => {}, wait: () => {} };
  const store = new Store(source, pane, true);
  const hello = { do: "hello", id: 0, state: STATE, now: null, mechanism: { name: "arm", frame: "tool", sliders: [0, 1],
    units: { length: "m", force: "N" }, coordinates: [] } };
  const answer = () => {
    const { id, state } = asked.shift();
    source.onanswer({ id, do: "draw", numbers: { q: state.q, result: { q: state.q } }, legend: FACTS }, []);
  };
  source.onanswer(hello, []);
  answer();
  return { store, asked, answer, source };
}

test("one question is in flight, and the newest state wins", () => {
  const { store, asked, answer } = opened();
  store.goTo([1, 0]);
  store.goTo([2, 0]);
  store.goTo([3, 0]);
  assert.deepEqual(asked.map(({ state }) => state.q), [[1, 0]]);
  answer();
  assert.deepEqual(asked.map(({ state }) => state.q), [[3, 0]]);
  assert.deepEqual(store.shown.q, [1, 0]);
  answer();
  assert.deepEqual([store.shown.q, store.busy, store.wanted], [[3, 0], null, false]);
});

test("undo goes back to the step before, redo forth, and a new step forgets what was undone", async () => {
  const { store, answer } = opened();
  const to = async (act) => {
    store.lastTime = -Infinity; // each is a step of its own
    await act();
    answer();
  };
  await to(() => store.change({ connection: "A" }));
  await to(() => store.change({ quantity: "compliance" }));
  await to(() => store.undo());
  assert.deepEqual([store.state.connection, store.state.quantity], ["A", "stiffness"]);
  await to(() => store.undo());
  assert.equal(store.state.connection, "load");
  await to(() => store.redo());
  assert.equal(store.state.connection, "A");
  await to(() => store.change({ connection: "B" }));
  assert.equal(store.future.length, 0);
});

test("a state without an answer leaves the last one, and says so", () => {
  const { store, asked, source } = opened();
  const said = [];
  store.on("refused", (reason) => said.push(reason));
  store.goTo([9, 9]);
  source.onanswer({ id: asked.shift().id, do: "draw", error: "too far" }, []);
  assert.deepEqual([store.refused, store.shown.q, store.state.q], ["too far", [0, 0], [9, 9]]);
  assert.deepEqual(said, ["too far"]);
});

test("states are kept under the lowest free number", () => {
  const { store, answer } = opened();
  for (const _ of [1, 2]) {
    store.keep();
    answer();
  }
  store.setKept(store.kept.filter(({ number }) => number === 2));
  assert.equal(store.freeNumber, 1);
  assert.deepEqual(store.kept.map(({ number }) => number), [2]);
});

test("the springs' own wrench becomes a load in the room when something moves", () => {
  const pose = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
  const numbers = { result: { wrench: [0, 0, 0, 10, 0, 0], pose }, moved: {} };
  assert.deepEqual(givenLoad(STATE, numbers, { may_be_loaded: true }),
    { load: [0, 0, 0, 0, 10, 0], load_at: [0, 0, 0], load_axes: "world" });
  assert.deepEqual(givenLoad(STATE, numbers, { may_be_loaded: false }), {});
});
