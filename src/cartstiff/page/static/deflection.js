// The first question: how far does the load move the point, and what gives way.

import { button, byId, el, engineering, heading, hint, short, together, tuple, typeset } from "./dom.js";
import { symbol } from "./matrix.js";
import { differences } from "./principal.js";
import { doubts } from "./plotfiles.js";
import { NEGLIGIBLE_DIFFERENCE, ROUNDOFF } from "./numerics.js";
import { sway } from "./sway.js";

// Loads to begin with: a size in the unit of force, and directions in the room.
export const EXAMPLE = 100;
const EXAMPLES = [["downwards", [0, 0, -1]], ["sideways along x", [1, 0, 0]], ["along y", [0, 1, 0]]];
// Milliseconds after which a state rests.
const RESTS = 400;

/** Load, weight and what is taken for granted, in a line. */
function assumptions(store, moved) {
  const { result } = store.numbers;
  const [m, f] = [0, 3].map((i) => Math.hypot(...(store.shown.load ?? result.wrench).slice(i, i + 3)));
  const load = [[f, "force"], [m, "moment"]].filter(([x]) => x > 0).map(([x, kind]) => engineering(x, store.unit(kind)))
    .join(", ");
  const at = moved.acts_at.some((x) => x) ? `${together(moved.acts_at, store.unit("length"))} in M` : "M";
  const held = store.shown.load ? ""
    : "No load is given: this wrench holds the body on its springs, and without it the body moves back as far. ";
  return `${held}${load} at ${at}: ${result.load.meaning}. ${store.numbers.weighed
    ?? store.hello.mechanism.weighed}. To first order.`;
}

/** Go to the better posture that Python finds; resolves with what it says of it. */
async function better(store) {
  const { q, words } = await store.ask({ do: "better" });
  if (!q) return words.join(" ");
  store.goTo(q);
  return [...words, "(u goes back.)"].join(" ");
}

export function deflectionPanel(store) {
  const head = el("div", { class: "moved-head" });
  const detail = el("div", { class: "moved-detail" });
  const line = el("p", { class: "moved-line dim small" });
  const bars = el("div", { class: "moved-bars", tabindex: 0, role: "group",
    "aria-label": "Shares of the joints or legs" });
  const examples = EXAMPLES.map(([words, way]) => button(words,
    () => store.change({ load: [0, 0, 0, ...way.map((x) => x && EXAMPLE * x)], load_axes: "world" }),
    { title: `A force of ${EXAMPLE} ${words} in the room; then drag the arrow, or type numbers on the left` }));
  store.on("hello", () => { examples[0].textContent = `Add ${EXAMPLE} ${store.unit("force")} downwards`; });
  const settled = el("p", { class: "fact settled", hidden: true });
  let asked = null;
  /**
   * What the library says of the equilibrium, where it differs from the first order; asked for when the state rests.
   */
  async function settle() {
    const mine = structuredClone(store.shown);
    asked = mine;
    settled.hidden = true;
    if (!store.shown.load?.some((x) => x)) return;
    await new Promise((resolve) => setTimeout(resolve, RESTS));
    if (asked !== mine) return;
    const found = await store.ask({ do: "answer", state: mine }).catch(() => null);
    if (asked !== mine || !found?.settled) return;
    settled.textContent = found.settled;
    settled.hidden = false;
  }
  const [softest, resisted, apart, doubt, found] = ["softest", "resisted", "apart", "doubt", "found"]
    .map((name) => el("p", { class: `fact ${name}` }));
  resisted.textContent = "Every small push is resisted";
  apart.title = "Largest difference of two entries, over the square root of the product of the two diagonal entries "
    + "beside it";
  const search = button("Better posture", async () => {
    search.disabled = true;
    const words = await better(store).catch(({ message }) => message);
    search.disabled = false;
    found.textContent = words;
  }, { class: "quiet",
    title: "A posture nearby at which the load moves the tip less, while the tip stays where it is" });
  store.on("state", () => { found.textContent = ""; });
  byId("right").append(el("div", { class: "card moved-card" }, heading("Under this load", search, sway(store)),
    head, settled, found, bars, softest, resisted, apart, doubt, detail, line));

  /**
   * What is true with a load or without: the softest direction, whether a push is resisted, whether A or K matters, how
   * sure the springs are.
   */
  function facts() {
    const { softest: soft, moved, result, verdict } = store.numbers;
    softest.hidden = !soft;
    // without a load all matrices are the same
    resisted.hidden = !soft || !(moved ? moved.resisted : verdict.level !== "bad");
    if (soft) {
      softest.replaceChildren("Softest ", el("span", { class: "dim" }, "(free to turn)"), ": ",
        el("b", {}, engineering(soft.stiffness, `${store.unit("force")}/${store.unit("length")}`)),
        soft.direction ? ` along ${tuple(soft.direction.map((x) => Number(x.toFixed(2))), 2)} of the room`
          : " along more than one direction alike");
    }
    const [A, K] = ["A", "K"].map((name) => store.matrix(name));
    const most = differences({ K, A })[0]?.share ?? 0;
    apart.hidden = !A || !K || !soft;
    const both = `${symbol(store.shown, "A")} and ${symbol(store.shown, "K")}`;
    apart.textContent = most < NEGLIGIBLE_DIFFERENCE ? `${both} are the same here`
      : `${both} differ by up to ${short(100 * most, 2)} %`;
    const found = doubts(store, store.shown);
    const [assumed, onLines] = ["stiffness-assumed", "held-by-lines"]
      .map((name) => result.notes.find(({ code }) => code === name)?.message);
    const words = [onLines,
      ...found.map(({ kind, words: own }) => (kind === "assumed" && assumed ? `${own}: ${assumed}` : own))]
        .filter(Boolean);
    doubt.hidden = !words.length;
    doubt.textContent = words.join("; ");
    doubt.title = found.some(({ kind }) => kind === "illustrative") ? store.hello.mechanism.source : "";
  }

  store.on("numbers", () => {
    const { moved, result } = store.numbers;
    const { wrench } = result;
    facts();
    settle();
    search.hidden = !store.source.live || !store.shown.load || !moved?.resisted || !moved.displacement.some((x) => x);
    for (const node of [bars, detail, line]) node.replaceChildren();
    const say = (kind, ...words) => {
      head.className = `moved-head ${kind}`;
      head.replaceChildren(...words);
    };
    if (!moved) {
      if (!wrench) return say("dim", "no load can be held here");
      if (store.shown.load?.some((x) => x)) return say("dim",
        "no compliance exists here: how far the load moves it is not said");
      return say("dim", "no load", ...(store.source.moves && store.hello.mechanism.takes_load ? [" ", ...examples]
        : []));
    }
    if (!moved.resisted) return say("bad", "Unstable: the load pushes it away");
    // A turn that is rounding beside the way is none.
    const [way, turn] = [moved.displacement, moved.rotation].map((v) => Math.hypot(...v));
    const turned = turn * store.hello.mechanism.size > NEGLIGIBLE_DIFFERENCE * way ? turn : 0;
    const what = store.shown.point.some((x) => x) ? "the point" : "M";
    say("", `${what} moves `, el("b", {}, engineering(way, store.unit("length"))),
      ` and turns `, el("b", {}, engineering(turned, "rad")));
    head.title = "To first order, from where the springs rest without this load";
    const row = (name, value, title) => el("div", { title }, el("span", { class: "dim" }, name),
      el("span", { class: "num" }, value));
    detail.append(
      row("tool axes", together(moved.displacement, store.unit("length")), "along the axes of M"),
      row("room axes", together(moved.in_room, store.unit("length")), "along the axes of F"),
      ...(moved.acts_at.some((x) => x) ? [row("wrench at M",
        [0, 3].map((i) => together(wrench.slice(i, i + 3), store.unit(i ? "force" : "moment"))).join(";  "),
          "moment and force about the origin of M, along its axes")] : []),
      row("energy", engineering(moved.energy, store.unit("moment")), "that the load puts into the springs"));
    const says = assumptions(store, moved);
    line.textContent = says;
    line.title = says;
    const size = ({ share }) => Math.abs(share ?? 0);
    const ordered = moved.shares.filter((entry) => Math.round(100 * size(entry))).toSorted((a, b) => size(b) - size(a));
    for (const entry of ordered) {
      const { name, share } = entry;
      const bar = el("i");
      bar.style.width = `${(100 * size(entry)) / Math.max(size(ordered[0]), ROUNDOFF)}%`;
      bars.append(el("div", { class: "moved-bar", title: `${name}: part of the point's way` },
        el("span", { class: "moved-name" }, name), el("span", { class: `meter wide${share < 0 ? " against" : ""}` },
          bar),
        el("span", { class: "num" }, typeset(`${Math.round(100 * share) || 0} %`))));
    }
    if (moved.shares.length && moved.shares.every(({ share }) => share === null)) {
      bars.append(hint(way ? "No share is known: the springs store no energy" : turned
        ? "The point does not move: nothing has a share of its way"
        : "The structure carries this load: no spring has a share"));
    }
    for (const note of moved.notes) bars.append(el("div", { class: "dim small" }, note));
  });
}
