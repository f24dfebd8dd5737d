// The answer: how far the load moves the point, which way, and what contributes; without a load, where it is softest.

import { button, card, el, engineering, plainly, together, typeset } from "./dom.js";
import { give } from "./give.js";
import { loadWords, wayOf } from "./loads.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";
import { doubts } from "./plotfiles.js";
import { shareBars, sharePicture } from "./shares.js";

// A load to begin with: its size in the unit of force, and directions in the room.
export const EXAMPLE = 100;
const EXAMPLES = [["downwards", [0, 0, -1]], ["along x", [1, 0, 0]], ["along y", [0, 1, 0]]];
// Milliseconds after which a state rests.
const RESTS = 400;

/** How far the load moves the point, in the unit that the page has for it. */
export const displacementWords = (store, numbers = store.numbers, size = store.sizes.displacement) =>
  engineering(Math.hypot(...numbers.moved.displacement), store.unit("length"), 4, size);

/** The same in the picture, with whether that is allowed. */
function judged(store) {
  const { shown: { allowed }, numbers: { moved } } = store;
  const sign = !allowed ? "" : Math.hypot(...moved.displacement) <= allowed ? " \u2713" : " \u2715";
  return `${displacementWords(store)}${sign}`;
}

/** Load, weight and what is taken for granted, in a line. */
function assumptions(store, moved) {
  const { result } = store.numbers;
  const at = moved.acts_at.some((x) => x) ? `${together(moved.acts_at, store.unit("length"))} in M` : "M";
  const held = store.shown.load ? ""
    : "No load is given: this wrench holds the body on its springs, and without it the body moves back as far. ";
  const weighed = store.numbers.weighed ?? store.hello.mechanism.weighed;
  return typeset(`${held}${loadWords(store)} at ${at}: ${result.load.meaning}. ${weighed}. To first order.`);
}

/** The better posture that Python finds, as a pale second mechanism, with what gets worse: to be taken or left. */
function betterPosture(store) {
  const words = el("p.fact.found", { role: "status" });
  const take = button("Take it", () => {
    const { q } = offered;
    leave();
    store.goTo(q);
    store.follow();
  }, { class: "primary" });
  const row = el("div.row.offer", { hidden: true }, take, button("Leave it", () => leave()),
    el("span.dim.small", "pale in the picture"));
  let offered = null;

  function leave() {
    [offered, row.hidden, words.textContent] = [null, true, ""];
    store.apply({ ghost: store.kept[0]?.state.q.slice() ?? null });
  }

  async function ask() {
    const { q, words: said } = await store.ask({ do: "better" });
    if (q) store.apply({ ghost: q });
    [offered, row.hidden] = [q ? { q } : null, !q];
    words.textContent = plainly(said.join(" "));
  }

  const search = button("Better posture", async () => {
    search.disabled = true;
    await ask().catch(({ message }) => { words.textContent = message; });
    search.disabled = false;
  }, { class: "quiet",
    title: "A posture nearby at which the load moves the tip less, while the tip stays where it is" });
  // It is one of the state that it was sought for.
  store.on("state", (patch) => {
    if ("ghost" in patch && Object.keys(patch).length === 1) return;
    words.textContent = "";
    if (offered) Object.assign(store.state, { ghost: store.kept[0]?.state.q.slice() ?? null });
    [offered, row.hidden] = [null, true];
  });
  return { search, node: el("div", words, row) };
}

/** The load as the first control: a size, and directions. */
function firstLoad(store) {
  const size = el("input", { type: "number", value: EXAMPLE, min: 0, step: "any", "aria-label": "Size of the load" });
  const unit = el("span.unit");
  store.on("hello", () => { unit.textContent = store.unit("force"); });
  const act = (way) => {
    const newtons = size.valueAsNumber > 0 ? size.valueAsNumber : EXAMPLE;
    store.change({ load: [0, 0, 0, ...way.map((x) => x && newtons * x)], load_axes: "world" });
    store.follow();
  };
  return el("div.row.first-load", el("span", "Load"), size, unit,
    ...EXAMPLES.map(([words, way]) => button(words, () => act(way),
      { title: `This force ${words} in the room; then drag the arrow, or type numbers on the left` })));
}

export function deflectionPanel(store) {
  const title = el("h2");
  const head = el("div.moved-head");
  const detail = el("div.moved-detail");
  const line = el("p.moved-line.dim.small");
  const first = firstLoad(store);
  const settled = el("p.fact.settled", { hidden: true });
  const bars = shareBars(store);
  const { node: play, line: factor, toggle } = give(store, () => judged(store));
  sharePicture(store);
  let asked = null;
  /** What the library says of the equilibrium, where it differs from the first order; asked for at rest. */
  async function settle() {
    const mine = structuredClone(store.shown);
    asked = mine;
    settled.hidden = true;
    if (!store.shown.load?.some((x) => x)) return;
    await new Promise((resolve) => setTimeout(resolve, RESTS));
    if (asked !== mine) return;
    const found = await store.ask({ do: "answer", state: mine }).catch(() => null);
    if (asked !== mine || !found) return;
    store.tell("said", found);
    if (!found.settled) return;
    settled.textContent = plainly(found.settled);
    settled.hidden = false;
  }
  const [softest, doubt, advice] = ["softest", "doubt", "advice"].map((name) => el("p", { class: `fact ${name}` }));
  const { search, node: offer } = betterPosture(store);
  card("right", "div.card.moved-card", el("div.row.head", title, el("span.grow"), search, play),
    first, head, advice, factor, settled, offer, bars, softest, doubt, detail, line);

  /** What is true with a load or without: the softest direction, how sure the springs are. */
  function facts() {
    const { softest: soft, result, moved, verdict } = store.numbers;
    softest.hidden = !soft;
    const where = soft?.which ? plainly(soft.which) : "along more than one direction alike";
    if (soft) {
      softest.replaceChildren("Softest ", el("b", engineering(soft.stiffness,
        `${store.unit("force")}/${store.unit("length")}`)), ` ${where}`,
      el("span.dim", ", free to turn"));
    }
    const found = doubts(store, store.shown);
    const [assumed, onLines, beyond] = ["stiffness-assumed", "held-by-lines", "force-limits"]
      .map((name) => result.notes.find(({ code }) => code === name)?.message);
    const words = [onLines, ...found.map(({ kind, words: own }) =>
      (kind === "assumed" && assumed ? `${own}: ${assumed}` : own))].filter(Boolean);
    doubt.hidden = !words.length;
    doubt.textContent = plainly(words.join("; "));
    doubt.title = found.some(({ kind }) => kind === "illustrative") ? store.hello.mechanism.source : "";
    // Where the answer is here, what to try instead is not said.
    const tried = moved?.resisted ? null : verdict.advice;
    const said = [beyond?.replace(/^b/, "B"), tried].filter(Boolean);
    advice.textContent = plainly(said.join(". "));
    advice.hidden = !said.length;
  }

  store.on("numbers", () => {
    const { moved, result } = store.numbers;
    const { wrench } = result;
    facts();
    settle();
    const { isLoaded } = store;
    title.textContent = isLoaded ? "Under this load" : "Stiffness here";
    first.hidden = isLoaded || !store.source.moves || !store.hello.mechanism.takes_load;
    search.hidden = !store.source.live || !store.shown.load || !wayOf(store.numbers);
    for (const node of [detail, line]) node.replaceChildren();
    head.hidden = false;
    const say = (kind, ...words) => {
      head.className = `moved-head ${kind}`;
      head.replaceChildren(...words);
    };
    if (!moved) {
      if (!wrench) return say("dim", "No load can be held here");
      if (isLoaded) return say("dim", "No compliance exists here: how far the load moves it is not known");
      head.hidden = true;
      return;
    }
    if (!moved.resisted) { // which the verdict says, and what to try
      head.hidden = Boolean(store.numbers.verdict.advice);
      return say("bad", "Unstable: the load pushes it away");
    }
    // A turn that is rounding beside the way is none.
    const [way, turn] = [moved.displacement, moved.rotation].map((v) => Math.hypot(...v));
    const turned = turn * store.hello.mechanism.size > NEGLIGIBLE_DIFFERENCE * way ? turn : 0;
    const what = store.shown.point.some((x) => x) ? "The point" : "M";
    say("", `${what} moves `, el("b", displacementWords(store)), moved.which ? ` ${plainly(moved.which)}` : "",
      turned ? "; turns " : "", turned ? el("b", engineering(turned, "rad")) : "");
    head.title = "To first order, from where the springs rest without this load";
    const row = (name, value, title) => el("div", { title }, el("span.dim", name), el("span.num", value));
    const { displacement } = store.sizes;
    const isTurned = moved.in_room.some((x, i) => Math.abs(x - moved.displacement[i]) > NEGLIGIBLE_DIFFERENCE * way);
    detail.append(
      ...(isTurned ? [row("tool axes", together(moved.displacement, store.unit("length"), displacement),
        "along the axes of M")] : []),
      row(isTurned ? "room axes" : "tool and room axes", together(moved.in_room, store.unit("length"), displacement),
        "along the axes of F"),
      ...(moved.acts_at.some((x) => x) ? [row("wrench at M", [0, 3]
        .map((i) => together(wrench.slice(i, i + 3), store.unit(i ? "force" : "moment"))).join(";  "),
      "moment and force about the origin of M, along its axes")] : []),
      row("energy", engineering(moved.energy, store.unit("moment")), "that the load puts into the springs"),
      ...moved.notes.map((note) => el("div.dim.small", note)));
    line.textContent = line.title = assumptions(store, moved);
  });
  return { showMove: toggle };
}
