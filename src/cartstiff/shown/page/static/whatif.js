// What if one spring were stiffer? A slider for each, with how far the load moves the point then; the largest gain
// comes first.

import { button, el, engineering, folded, hint, short, typeset } from "./dom.js";
import { wayOf } from "./loads.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { mechanicsOf } from "./store.js";

// Ends of a slider, as powers of two of the stiffness in the file; rows.
const DOUBLINGS = 2;
const MOST_SPRINGS = 10;

export function whatIfCard(store) {
  const [said, list, all] = [el("span.dim.small", { role: "status" }), el("div.what-if"), el("p")];
  const reset = button("As in the file", () => store.change({ stiffness: null }), { class: "quiet" });
  const card = folded("what-if", "What if?", said, () => refresh(), list, all,
    hint("One spring is stiffer or softer; the others, posture and load stay. To first order."), reset);
  let rows = [];
  let ranked = null; // of which state the order and the displacement in the file are
  let first = null;
  let [asking, again] = [false, false];

  const inFile = () => store.hello.mechanism.springs.map(({ stiffness }) => stiffness);
  const ofState = (state) => state.stiffness ?? inFile();
  const factor = (i, state = store.shown) => ofState(state)[i] / inFile()[i];
  const isPlain = (x) => Math.abs(x - 1) < NEGLIGIBLE_DIFFERENCE;
  const way = (x) => engineering(x, store.unit("length"), 3);
  const percent = (x) => (Math.abs(x) < NEGLIGIBLE_DIFFERENCE ? "no change"
    : typeset(`${x > 0 ? "+" : ""}${short(100 * x, 2)} %`));

  /** A spring that is as in the file is tried twice as stiff, a changed one as in the file. */
  function tried() {
    return store.hello.mechanism.springs.map(({ stiffness, nonlinear }, i) =>
      (!stiffness || nonlinear ? null : isPlain(factor(i)) ? 2 * stiffness : stiffness));
  }

  function row(i) {
    const { name, unit } = store.hello.mechanism.springs[i];
    const range = el("input", { type: "range", min: -DOUBLINGS, max: DOUBLINGS, step: 0.05, id: `what-if-${i}`,
      "aria-label": `Stiffness of ${name}`, oninput: () => {
        const springs = ofState(store.state).with(i, inFile()[i] * 2 ** Number(range.value));
        const same = springs.every((k, j) => k === inFile()[j]);
        store.change({ stiffness: same ? null : springs });
      } });
    const text = el("output.num", { for: range.id });
    const set = ({ here, sizes }) => {
      const times = factor(i);
      if (document.activeElement !== range) range.value = Math.log2(times);
      range.setAttribute("aria-valuetext", `${short(times, 3)} times, ${engineering(ofState(store.shown)[i], unit)}`);
      const [at, by] = isPlain(times) ? [sizes[i], sizes[i] / here - 1] : [here, here / sizes[i] - 1];
      text.replaceChildren(isPlain(times) ? "twice as stiff: " : `${short(times, 3)} × as stiff: `,
        ...(sizes[i] === null || here === null ? ["the load is not held"] : [way(at), ", ", el("b", percent(by))]));
    };
    return { i, set, node: el("div", el("label", { for: range.id }, name), range, text) };
  }

  async function refresh() {
    if (!card.open || !store.numbers) return;
    const isMoved = Boolean(wayOf(store.numbers));
    list.hidden = !isMoved;
    if (!isMoved) said.textContent = "needs a load that moves the point";
    all.textContent = "";
    again = isMoved;
    if (asking) return;
    asking = true;
    while (again) {
      again = false;
      await answered(structuredClone(store.shown)).catch(({ message }) => { all.textContent = message; });
    }
    asking = false;
  }

  async function answered(state) {
    const { q } = store.numbers;
    const mine = JSON.stringify([q, store.hello.mechanism.name, mechanicsOf({ ...state, stiffness: null })]);
    const found = await store.ask({ do: "stiffer", state, to: tried() });
    if (mine !== ranked) {
      const asFile = { do: "numbers", state: { ...state, stiffness: null } };
      first = wayOf(state.stiffness ? (await store.ask(asFile)).numbers : store.numbers);
      ranked = mine;
      rows = found.order.slice(0, MOST_SPRINGS).map(row);
      list.replaceChildren(...rows.map(({ node }) => node));
      const [best] = found.order;
      said.textContent = best === undefined || !isPlain(factor(best, state)) ? ""
        : `${store.hello.mechanism.springs[best].name} twice: ${percent(found.sizes[best] / found.here - 1)}`;
    }
    for (const one of rows) one.set(found);
    reset.disabled = !state.stiffness;
    if (state.stiffness && found.here !== null) all.replaceChildren("With these springs ",
      el("b", way(found.here)), ` instead of ${way(first)}, `, el("b", percent(found.here / first - 1)));
  }

  store.on("numbers", refresh);
}
