// The 6x6 matrix as a heat map with units, and the choice of connection.

import { largest, sureOfInverse } from "./algebra.js";
import { ARROWS, all, button, card, choice, copy, dropdown, el, inSize, short, stateChoice, sure } from "./dom.js";
import { ROUNDOFF, UNCOUPLED } from "./numerics.js";
import { safeCell } from "./plotfiles.js";

// Of wrenches and of motions, the rows and the columns of a stiffness.
export const SHORT = [["mx", "my", "mz", "fx", "fy", "fz"], ["rx", "ry", "rz", "x", "y", "z"]];
const WORDS = [["moment about", "force along"], ["rotation about", "motion along"]]
  .map((kinds) => kinds.flatMap((kind) => ["x", "y", "z"].map((axis) => `${kind} ${axis}`)));

const headsOf = ({ quantity }, heads = SHORT) => (quantity === "stiffness" ? heads : heads.toReversed());
/** A cell of a state's matrix in words. */
export function cellOf(state, { i, j }, heads = WORDS) {
  const [rows, columns] = headsOf(state, heads);
  return `${rows[i]} per ${columns[j]}`;
}

const VIEWS = [
  ["whole", "K", "The matrix itself"],
  ["symmetric", "sym", "Symmetric part (K + Kᵀ)/2"],
  ["antisymmetric", "anti", "Antisymmetric part (K − Kᵀ)/2: made of the load alone"],
  ["difference", "− …", "Difference from another connection, or from a state that was kept"],
];

const NAMES = ["load", "A", "B", "K", "F", "+"];

export const sup = (name) => ({ A: "ᴬ", B: "ᴮ", K: "ᴷ", F: "ꟳ", "+": "⁺", load: " under the load" })[name]
  ?? `^${name}`;

/** What a matrix that is shown is called: that of its connection, or of another; without a load all are one. */
export const symbol = ({ shown: { quantity, connection }, isLoaded }, name = connection) =>
  `${quantity === "stiffness" ? "K" : "C"}${name === "load" && !isLoaded ? "" : sup(name)}`;

const six = (make) => Array.from({ length: 6 }, (_, i) => make(i));

export function matrixPanel(store) {
  let view = "whole";
  let other = "B";
  let shown = null;
  const title = el("h2", { id: "matrix-title" });
  const place = el("span.dim.small.place");
  const [views, chooseView] = choice("Part of the matrix", VIEWS, (value) => {
    view = value;
    update();
  });
  const select = dropdown("Compared with", [], (name) => {
    other = name;
    update();
  }, { hidden: true });
  const [columnHeads, rowHeads] = ["col", "row"].map((scope) => six(() => el("th", { scope })));
  const cells = six((i) => six((j) => el("td.cell", { tabindex: i + j ? -1 : 0, "data-row": i, "data-column": j })));
  const units = [0, 1].map(() => [0, 1].map(() => el("td.block-unit", { colspan: 3 })));
  const row = (head, one, other) => el("tr", head, ...one, el("td.space", { "aria-hidden": "true" }), ...other);
  const halves = (list) => [list.slice(0, 3), list.slice(3)];
  const table = el("table.matrix", { "aria-labelledby": "matrix-title" },
    el("thead", row(el("td"), ...halves(columnHeads))),
    el("tbody", ...cells.flatMap((line, i) =>
      [...(i % 3 ? [] : [row(el("td"), ...units[i / 3].map((unit) => [unit]))]), row(rowHeads[i], ...halves(line))])));
  const readout = el("div.readout", { role: "status" });
  const absent = el("p.absent-words", { hidden: true });
  const parts = el("div.row.parts", views, select);
  const [meaning, badge] = [el("p.meaning"), el("span.badge")];
  const connections = stateChoice(store, "connection", "Connection", NAMES.map((name) => [name, name]));
  connections.classList.add("connections");
  const quantities = stateChoice(store, "quantity", "Quantity",
    [["stiffness", "Stiffness", "Wrench per motion (s)"], ["compliance", "Compliance", "Motion per wrench (s)"]]);
  const choices = el("div.row.choices", connections, el("span.grow"), quantities);
  parts.prepend(connections.lastChild);
  const fold = el("details.parts-fold", el("summary", "Parts and transpose"), parts);
  card("right", "details.card.matrix-card", el("summary", title, place, badge), choices, table, absent,
    el("div.row", readout,
      button("NumPy", () => copyNumpy(), { class: "quiet", title: "Copy as NumPy array (c)" }),
      button("CSV", () => copyCsv(), { class: "quiet", title: "Copy as CSV" })),
    meaning, fold);
  chooseView(view);

  let read = null;
  table.addEventListener("pointerover", (event) => point(event.target));
  table.addEventListener("focusin", (event) => point(event.target));
  table.addEventListener("pointerleave", () => point(null));
  table.addEventListener("keydown", (event) => {
    const step = ARROWS[event.key];
    if (!step || !event.target.dataset.row) return;
    event.preventDefault();
    const i = (Number(event.target.dataset.row) - step[1] + 6) % 6;
    const j = (Number(event.target.dataset.column) + step[0] + 6) % 6;
    cells[i][j].focus();
  });

  function point(target) {
    read = target?.dataset?.row !== undefined ? [Number(target.dataset.row), Number(target.dataset.column)] : null;
    showReadout();
  }

  function showReadout() {
    if (!read || !shown) {
      readout.textContent = shown ? lostDigits() || scaleWords : "";
      readout.title = "";
      return;
    }
    const [i, j] = read;
    const rest = store.shown.quantity === "stiffness" ? "other motions held" : "no other load";
    const words = `${cellOf(store.shown, { i, j })}, ${rest}`;
    readout.replaceChildren(el("b", `${sure(shown[i][j], largest(shown))} ${store.unitOf(i, j)}`), ` ${words}`);
    readout.title = words;
  }
  const scaleWords = "colour: sign and size within blocks of one unit";

  /** A compliance of legs is inverted: a note states the lost digits from the twelfth on. */
  function lostDigits() {
    const C = store.shown.quantity === "compliance" && store.numbers.legs && store.matrix(store.shown.connection);
    const error = C ? sureOfInverse(C) : 0;
    return error > ROUNDOFF ? `ill-conditioned: known to ${short(error, 2)} of its largest entry` : "";
  }

  function chosen() {
    const { connection } = store.shown;
    const M = store.matrix(connection);
    if (!M) return null;
    const map = (f) => M.map((row, i) => row.map((x, j) => f(x, i, j)));
    if (view === "symmetric") return map((x, i, j) => (x + M[j][i]) / 2);
    if (view === "antisymmetric") return map((x, i, j) => (x - M[j][i]) / 2);
    if (view === "difference") {
      const row = store.rows.find(({ own, title }) => own && title === other);
      const N = row ? row.comparable && store.matrix(connection, row.numbers) : store.matrix(other);
      return N && map((x, i, j) => x - N[i][j]);
    }
    return M;
  }

  function update() {
    if (!store.numbers) return;
    const { connection, quantity, point, axes } = store.shown;
    const own = symbol(store);
    chooseView(view);
    if (view !== "whole" || connection === "+") fold.open = true;
    views.firstChild.lastChild.textContent = quantity === "stiffness" ? "K" : "C";
    select.hidden = view !== "difference";
    const options = [...NAMES.filter((name) => name !== connection), ...store.kept.map(({ number }) => String(number))];
    if (!options.includes(other)) other = options[0];
    const called = (name) => (/\d/.test(name) ? `state ${name}` : symbol(store, name));
    select.offer(options.map((name) => [name, called(name)]));
    select.value = other;
    title.textContent = { whole: own, symmetric: `sym ${own}`, antisymmetric: `anti ${own}`,
      difference: `${own} − ${called(other)}` }[view];
    const frame = store.hello.mechanism.frame;
    const moved = point.some((x) => x !== 0);
    place.textContent = `in ${frame}${moved ? " + offset" : ""}${axes === "world" ? ", room axes" : ""}`;
    const stiff = quantity === "stiffness";
    const heads = headsOf(store.shown);
    [rowHeads, columnHeads].forEach((nodes, k) => nodes.forEach((node, i) => { node.textContent = heads[k][i]; }));
    shown = chosen();
    const names = store.blockUnits();
    // The unit of a block is of the size of its largest entry.
    const sizes = names.map((pair, a) => pair.map((name, b) => (!shown ? [1, name]
      : inSize(Math.max(...shown.slice(3 * a, 3 * a + 3).flatMap((row) => row.slice(3 * b, 3 * b + 3)).map(Math.abs)),
        name))));
    units.forEach((pair, a) => pair.forEach((cell, b) => { cell.textContent = sizes[a][b][1]; }));

    absent.hidden = shown !== null;
    table.classList.toggle("empty", shown === null);
    const { verdict, has_compliance: hasCompliance, result } = store.numbers;
    absent.textContent = `${own} does not exist here${stiff ? `: ${verdict.title}` : ""}.${stiff && hasCompliance
      && !result.stiffness.B ? " The compliance does." : ""}`;
    const { symmetric } = store.numbers;
    const apart = symmetric[connection];
    for (const button of connections.children) button.classList.toggle("absent",
      symmetric[button.dataset.value] === null);
    [badge.textContent, badge.dataset.level] = apart === null ? ["no matrix", "none"] : apart === 0
      ? ["✓ symmetric", "good"] : ["≠ asymmetric", "warning"];
    badge.title = apart ? `largest entry of its difference from the transpose: ${short(apart)}` : "";
    paint(cells, shown, store.matrix(connection), sizes);
    showReadout();
  }

  /** The matrix with all its digits, in the file's units. */
  function copyAs(what, begin, row, end) {
    if (!shown) return;
    const [[a, b], [c, d]] = store.blockUnits();
    const words = `${title.textContent} ${place.textContent}; order rotation, translation; blocks [[${a}, ${b}], `
      + `[${c}, ${d}]]`;
    copy(`${begin(words)}\n${shown.map(row).join("\n")}\n${end}`, what);
  }

  const copyNumpy = () => copyAs("NumPy array", (words) => `np.array([  # ${words}`,
    (row) => `    [${row.map(String).join(", ")}],`, "])\n");
  const copyCsv = () => copyAs("CSV", (words) => `# ${safeCell(words)}`, (row) => row.map(String).join(","), "");

  store.on("hello", ({ mechanism }) => {
    for (const { name, title: words, meaning: more } of mechanism.connections) {
      all(`.matrix-card [data-value="${CSS.escape(name)}"]`)[0].title = `K${sup(name)}, ${words}: ` + `${more}`;
    }
  });
  store.on("state", () => {
    const words = store.hello.mechanism.connections.find(({ name }) => name === store.state.connection);
    meaning.replaceChildren(el("b", words.title), ` ${words.meaning}`);
  });
  store.on("numbers", update);
  store.on("rows", update);
  return { copyNumpy };
}

/** Numbers and colours: square roots of the entries over the largest of their unit. */
function paint(cells, matrix, unsplit, sizes) {
  const [largest, noise] = [0, 1].map(() => [[0, 0], [0, 0]]);
  const each = (act) =>
    cells.forEach((line, i) => line.forEach((cell, j) => act(cell, i, j, i < 3 ? 0 : 1, j < 3 ? 0 : 1)));
  if (matrix) each((_, i, j, a, b) => {
    largest[a][b] = Math.max(largest[a][b], Math.abs(matrix[i][j]));
    noise[a][b] = Math.max(noise[a][b], UNCOUPLED * Math.sqrt(Math.abs(unsplit[i][i] * unsplit[j][j])));
  });
  each((cell, i, j, a, b) => {
    const x = matrix ? matrix[i][j] : null;
    const vanishes = x === null || Math.abs(x) <= noise[a][b];
    const whole = short(x === null ? null : x / sizes[a][b][0]);
    const text = x !== null && vanishes ? "0" : whole.length > 8 ? short(x / sizes[a][b][0], 3) : whole;
    if (cell.textContent !== text) cell.textContent = text;
    cell.classList.toggle("tight", text.length > 6);
    const sign = vanishes ? "zero" : x > 0 ? "plus" : "minus";
    if (cell.dataset.sign !== sign) cell.dataset.sign = sign;
    cell.style.setProperty("--share", `${vanishes ? 0 : Math.round(100 * Math.sqrt(Math.abs(x) / largest[a][b]))}%`);
  });
}
