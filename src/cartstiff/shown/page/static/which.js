// Which connection? The matrices of all of them side by side where they differ, and why; the load as large as a slider
// says, from zero.

import { dot, largest } from "./algebra.js";
import { EXAMPLE } from "./deflection.js";
import { clamp, el, engineering, folded, inSize, short, sure, typeset } from "./dom.js";
import { loadWords, shownLoad } from "./loads.js";
import { SHORT, cellOf } from "./matrix.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { differences } from "./principal.js";

// The others are compared with B, which is symmetric and exists wherever one of them does.
const COMPARED_NAMES = ["A", "B", "K", "F"];
// Cells in the table; the small pictures show all.
const MOST_CELLS = 6;
const MOST_DIGITS = 5;
// Largest size of the load on the slider, of the load that was given.
const LARGEST_LOAD = 2;

export function whichCard(store) {
  const [most, why, take, rest] = ["most", "why", "take", "dim small"].map((name) => el("p", { class: name }));
  const table = el("table.which");
  const size = el("input", { type: "range", min: 0, max: LARGEST_LOAD, step: 0.01, "aria-label": "Size of the load",
    oninput: () => {
      const times = Number(size.value);
      store.change({ ...base, load: base.load.map((x) => x * times) });
    } });
  const said = el("span.dim.small", { role: "status" });
  const read = el("output.num");
  const card = folded("which", "Which connection?", said, () => update(), take,
    el("label.row", el("span", "load"), size, read), table, most, why, rest);

  // The load at which the slider is at 1: that which was given, or one to begin with.
  let base = null;

  /** Keep the base while the load is a multiple of it; the slider goes where the load is. */
  function follow() {
    const now = shownLoad(store);
    const times = base ? dot(now.load, base.load) / dot(base.load, base.load) : NaN;
    const off = base ? Math.hypot(...now.load.map((x, i) => x - times * base.load[i])) : Infinity;
    const same = base && ["load_axes", "load_at"].every((key) => String(now[key]) === String(base[key]));
    const isMultiple = same && off <= NEGLIGIBLE_DIFFERENCE * Math.hypot(...base.load);
    if (!isMultiple || times < 0 || times > LARGEST_LOAD) {
      base = now.load.some((x) => x) ? now : { load: [0, 0, 0, 0, 0, -EXAMPLE], load_axes: "world", load_at: null };
      size.value = now.load.some((x) => x) ? 1 : 0;
    } else if (document.activeElement !== size) size.value = times;
    read.textContent = loadWords(store, { load: now.load, digits: 3 }) || engineering(0, store.unit("force"));
  }

  const cellWords = (cell) => cellOf(store.shown, cell);
  const called = (name) => (name.length > 1 && name !== "load" ? el("span", name)
    : el("span", store.shown.quantity === "stiffness" ? "K" : "C", el("sup", name)));
  const sized = (cell) => short(100 * cell.share, 2);

  /** What a connection supposes of the load, in the words of the library. */
  function supposes(name) {
    const { mechanism: { connections }, own_connections: own } = store.hello;
    return [called(name), ` ${[...connections, ...own].find((one) => one.name === name).load || "is your own"}`];
  }

  function update() {
    if (!store.numbers) return;
    const names = [...COMPARED_NAMES, ...store.hello.own_connections.map(({ name }) => name)];
    const matrices = Object.fromEntries(names.map((name) => [name, store.matrix(name)]));
    const found = differences(matrices);
    said.textContent = found.length ? `they differ by up to ${sized(found[0])} %` : matrices.B
      ? "the same without a load" : "no matrix here";
    if (!card.open) return;
    follow();
    const seen = found.slice(0, MOST_CELLS);
    draw(names, matrices, found, seen);
    const [first] = found;
    const [a, b] = first ? [first.high, first.low] : [];
    most.replaceChildren(...(first ? ["Largest difference: ", el("b", cellWords(first)), ", ", called(a), " − ",
      called(b), " = ", el("b", engineering(first.values[a] - first.values[b], store.unitOf(first.i, first.j))), ", ",
      el("span", { title: "of the square root of the product of the two diagonal entries beside it" },
        `${sized(first)} %`)] : [matrices.B
      ? "Without a load there is no difference: all connections have the same matrix. Move the slider."
      : "There is no matrix here to compare"]));
    why.replaceChildren(...(first ? ["Why: ", ...supposes(a), "; ", ...supposes(b), "."] : []));
    rest.textContent = found.length > seen.length
      ? `${found.length - seen.length} more cells differ by less; the small squares show all 36` : "";
    choose(names, matrices, found.length);
  }

  /** Which of them is the stiffness under the load as it is stated. */
  function choose(names, matrices, isAny) {
    const load = store.matrix("load");
    const same = names.filter((name) => load && matrices[name]
      && !(differences({ load, other: matrices[name] })[0]?.share > NEGLIGIBLE_DIFFERENCE));
    const meaning = store.numbers.result.load?.meaning;
    const all = same.flatMap((name, k) => [...(k ? [" = "] : []), called(name)]);
    take.hidden = !isAny || !load;
    take.replaceChildren("Under this load take ", ...(same.length ? [] : ["none of them, but "]),
      el("b", ...(same.length ? all : [called("load")])), `: ${meaning}.`);
    for (const head of table.querySelectorAll("thead th")) head.classList.toggle("taken", isAny > 0
      && same.includes(head.dataset.name));
  }

  function draw(names, matrices, found, seen) {
    const top = found[0]?.share;
    const times = Math.min(1, Number(size.value) / LARGEST_LOAD);
    const tint = (share) => Math.round(100 * Math.sqrt((times * share) / top)) || 0;
    const apart = (cell, name) => (cell.values[name] ?? cell.values.B) - cell.values.B;
    const scale = (cell) => cell.share / (cell.values[cell.high] - cell.values[cell.low]);
    const square = (name) => {
      const cells = found.filter((cell) => apart(cell, name));
      const words = !matrices[name] ? "does not exist here" : name === "B" ? "is what the others are compared with"
        : `differs from B in ${cells.length} of 36 cells`;
      const dots = cells.map((cell) => {
        const x = apart(cell, name);
        return `<rect x="${cell.j}" y="${cell.i}" width="0.92" height="0.92" class="${x > 0 ? "plus" : "minus"}" `
          + `style="opacity:${tint(Math.abs(x) * scale(cell)) / 100}"/>`;
      });
      const svg = el("span", { class: `square${matrices[name] ? "" : " absent"}`, role: "img",
        "aria-label": `${name} ${words}`, title: words });
      svg.innerHTML = `<svg viewBox="0 0 6 6" aria-hidden="true"><path d="M3 0V6M0 3H6"/>${dots.join("")}</svg>`;
      return svg;
    };
    const row = (cell) => {
      const { values } = cell;
      const [most, own] = [largest([Object.values(values)]), store.unitOf(cell.i, cell.j)];
      const [factor, unit] = inSize(most, own);
      // As many digits as show the difference.
      const spread = (values[cell.high] - values[cell.low]) / factor;
      const decimals = clamp(1 - Math.floor(Math.log10(spread)), 0, MOST_DIGITS);
      return el("tr", el("th", { scope: "row", title: cellWords(cell) }, cellOf(store.shown, cell, SHORT), " ",
        el("span.unit", unit)),
      ...names.map((name) => {
        if (!(name in values)) return el("td.num.dim", "–");
        const x = apart(cell, name);
        const isMost = cell === found[0] && [cell.high, cell.low].includes(name);
        const node = el("td", { class: `num cell${isMost ? " most" : ""}`, title: `${sure(values[name], most)} ${own}`,
          "data-sign": x > 0 ? "plus" : x < 0 ? "minus" : "zero" }, typeset((values[name] / factor).toFixed(decimals)));
        node.style.setProperty("--share", `${tint(Math.abs(x) * scale(cell))}%`);
        return node;
      }));
    };
    table.replaceChildren(el("thead", el("tr", el("td"), ...names.map((name) =>
      el("th", { scope: "col", "data-name": name }, el("b", called(name)), square(name))))),
    el("tbody", ...seen.map(row)));
  }

  store.on("numbers", update);
}
