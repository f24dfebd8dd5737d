// Verdict, principal values, condition, distance to singularities, notes.

import { angles } from "./algebra.js";
import { button, byId, card, chop, clamp, el, engineering, inSize, openDialog, plainly, short, stateChoice, sure,
  tuple } from "./dom.js";
import { symbol } from "./matrix.js";
import { NEAR_SINGULARITY, PRINTED_AS_ZERO, RANK } from "./numerics.js";

const KINDS = { serial: "singularity", "type-2": "singularity of the drives" };
const ICONS = { good: "✓", warning: "!", bad: "✕", none: "…" };

export function verdictLine(store) {
  const node = byId("verdict");
  const text = byId("verdict-text");
  const set = (level, words, title) => {
    node.dataset.level = level;
    node.firstElementChild.replaceChildren(el("b", ICONS[level]));
    if (text.textContent !== words) text.textContent = words;
    node.title = title ?? words;
  };
  store.on("hello", ({ mechanism }) => {
    byId("name").textContent = mechanism.name;
    byId("kind").textContent = `${mechanism.called}, frame ${mechanism.frame}`;
    document.title = `${mechanism.name} · cartstiff`;
  });
  store.on("numbers", () => {
    const { level, title } = store.numbers.verdict;
    const notes = store.numbers.result.notes.map(({ message }) => message);
    set(level, title, [title, ...notes].join("\n"));
  });
  store.on("refused", (reason) => {
    document.body.classList.toggle("refused", reason !== null);
    if (reason !== null) set("bad", `Last valid posture: ${reason}`,
      `${reason}\nThe numbers and the picture are of the last state that has an answer.`);
  });
  store.on("late", (late) => {
    document.body.classList.toggle("late", late);
    if (late && store.refused === null) set("warning", "Last valid posture: the new one is being computed");
  });
}

/** What the other freedoms do in the principal values of translation, and in those of rotation. */
export const freeness = ({ others }) => [`rotation ${others}`, `translation ${others}`];

export function numbersPanel(store) {
  const [head, table, facts, meters] = [el("h2"), el("table.principal"), el("dl.facts"), el("div.meters")];
  const others = stateChoice(store, "others", "The other freedoms",
    [["free", "free", "Principal values of translation while the body may turn, of rotation while it may move: "
      + "nothing loads the other freedoms"],
      ["held", "held", "Principal values of translation while the body cannot turn, of rotation while it cannot move: "
        + "the diagonal blocks of the stiffness matrix"]]);
  card("right", "div.card.principal-card", el("div.row", head, others,
    button("Full analysis", () => showReport(store), { class: "quiet", title: "Everything that the matrix says (i)" })),
  table, facts, meters);

  /** Principal values of a freedom, in a unit of their size. */
  function row(kind, mark, unit, others) {
    const found = store.numbers.principal?.[kind];
    const values = found ? found.values : [null, null, null];
    const size = Math.max(...values.map(Math.abs));
    const [factor, read] = inSize(store.sizes[kind] ?? 0, unit);
    const cell = (x, i) => {
      const title = `${sure(x, size)} ${unit}\nalong ${tuple(found.axes[i])}${x < 0 ? "\nNEGATIVE: pushes away" : ""}`;
      return el("td", { class: `num${x < -PRINTED_AS_ZERO * size ? " negative" : ""}`, title },
        Math.abs(x) < PRINTED_AS_ZERO * size ? "0" : short(x / factor));
    };
    const none = () => el("td.num", { title: "does not exist here" }, "–");
    return el("tr", { "data-row-of": kind },
      el("th", { scope: "row", tabindex: 0 },
        el("span", { class: `mark ${kind}`, "aria-hidden": "true" }, mark), ` ${kind} `,
        el("span.unit", `${read}, ${others}`)),
      ...values.map((x, i) => (x === null ? none() : cell(x, i))));
  }

  function update() {
    const { numbers, shown } = store;
    if (!numbers) return;
    const stiff = shown.quantity === "stiffness";
    const units = store.blockUnits();
    const [free, turned] = freeness(shown);
    const [low, high] = stiff ? ["softest", "stiffest"] : ["stiffest", "softest"];
    head.textContent = `Principal ${shown.quantity}`;
    table.replaceChildren(
      el("thead", el("tr", el("td.dim", `of ${symbol(store)}`), el("th", { scope: "col" }, low),
        el("td"), el("th", { scope: "col" }, high))),
      el("tbody", row("translation", "●", units[1][1], free), row("rotation", "◆", units[0][0], turned)));
    const { indices } = numbers;
    const length = store.unit("length");
    const fact = (name, value, title = "") => [el("dt", name), el("dd", { title }, value)];
    facts.replaceChildren(
      ...(indices ? fact("Condition number", indices.condition_number === null ? "∞ (singular)"
        : `${short(indices.condition_number)} at length ${engineering(indices.length, length)}`,
      `Angles are multiplied by a length: ${indices.length_reason}. Smallest eigenvalue over largest: `
        + `${indices.eigenvalues.map((x) => short(x)).join(", ")}. Of translation, rotation held `
        + `${short(indices.translational_condition)}; of rotation, translation held `
        + `${short(indices.rotational_condition)}`) : []),
      ...fact("Position", `${tuple(chop(numbers.position, numbers.singularity[0]?.length), 4)} ${length}`,
        `roll, pitch, yaw ${angles(numbers.result.pose).map((a) => short((a * 180) / Math.PI)).join(", ")}°`));
    meters.replaceChildren(...numbers.singularity.map(meter));
  }

  function meter({ kind, ratio, smallest, largest, length }) {
    const words = `Distance to a ${KINDS[kind]}`;
    const share = ratio > 0 ? clamp(1 + Math.log10(ratio) / 4, 0, 1) : 0; // logarithmic from 0.0001 to 1
    return el("div.singular", { "data-level": ratio < RANK ? "bad" : ratio < NEAR_SINGULARITY ? "warning" : "good",
      title: `smallest over largest singular value ${short(smallest)} / ${short(largest)}, lengths over `
        + `${engineering(length, store.unit("length"))}; below ${NEAR_SINGULARITY} is near` },
    el("span.label", words),
    el("span.meter.wide", { role: "meter", "aria-label": words, "aria-valuemin": 0, "aria-valuemax": 1,
      "aria-valuenow": ratio }, el("i", { style: `width: ${100 * share}%` })),
    el("span.num", ratio < RANK ? "singular" : short(ratio, 3)),
    el("span.small.dim", ...["0.0001", "0.01", "1"].map((mark) => el("span", mark))));
  }

  store.on("numbers", update);
}

export function notesCard(store) {
  const notes = el("ul.notes", { "aria-label": "Notes" });
  const own = card("right", "div.card.notes-card", notes);
  store.on("numbers", () => {
    const { doubts, result } = store.numbers;
    const rank = ({ code }) => (doubts.includes(code) ? doubts.indexOf(code) : doubts.length);
    const elsewhere = ["force-limits", "stiffness-assumed", "held-by-lines"]; // the answer has these
    if (store.shown.connection !== "F") elsewhere.push("kf-undefined");
    const found = result.notes.filter(({ code }) => !elsewhere.includes(code)).toSorted((a, b) => rank(a) - rank(b));
    notes.replaceChildren(...found.map(({ message }) => el("li",
      plainly(`${message[0].toUpperCase()}${message.slice(1)}`))));
    own.hidden = !found.length;
  });
}

/** The analysis as text, in a dialog. */
export async function showReport(store) {
  if (byId("report").open) return byId("report").close();
  const text = el("pre", "…");
  const { firstChild: head } = openDialog("report", "Analysis", text);
  const answer = await store.ask({ do: "analysis" }).catch(({ message }) => ({ title: "Analysis", text: message }));
  head.firstChild.textContent = answer.title;
  text.textContent = answer.text;
}
