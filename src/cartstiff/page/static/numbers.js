// Verdict, principal values, condition, distance to singularities, notes.

import { byId, chop, choice, clamp, el, engineering, inSize, sure, short } from "./dom.js";
import { sup } from "./matrix.js";
import { BLANK, NEAR, RANK } from "./numerics.js";

const ICONS = { good: "✓", warning: "!", bad: "✕", none: "…" };

export function verdictLine(store) {
  const node = byId("verdict");
  const text = byId("verdict-text");
  const set = (level, words, title) => {
    node.dataset.level = level;
    node.firstElementChild.replaceChildren(el("b", {}, ICONS[level]));
    if (text.textContent !== words) text.textContent = words;
    node.title = title ?? words;
  };
  store.on("hello", ({ mechanism }) => {
    byId("name").textContent = mechanism.name;
    byId("kind").textContent = `${mechanism.kind}, frame ${mechanism.frame}`;
    document.title = `${mechanism.name} · cartstiff`;
  });
  store.on("numbers", () => {
    const { level, title } = store.numbers.verdict;
    const notes = store.numbers.result.notes.map(({ message }) => message);
    set(level, title, [title, ...notes].join("\n"));
  });
  store.on("refused", (reason) => {
    document.body.classList.toggle("refused", reason !== null);
    if (reason !== null) set("bad", `Last valid posture: ${reason}`, `${reason}\nThe numbers and the picture are of the last state that has an answer.`);
  });
  store.on("late", (late) => {
    document.body.classList.toggle("late", late);
    if (late && store.refused === null) set("warning", "Last valid posture: the new one is being computed");
  });
}

/** What the other freedoms do in the principal values of translation, and in those of rotation. */
export const freeness = ({ others }) => [`rotation ${others}`, `translation ${others}`];

export function numbersPanel(store) {
  const head = el("h2", {}, "Principal values");
  const rows = {};
  const body = el("tbody");
  for (const [kind, mark] of [["translation", "●"], ["rotation", "◆"]]) {
    const name = el("th", { scope: "row" }, el("span", { class: `mark ${kind}`, "aria-hidden": "true" }, mark), ` ${kind} `,
      el("span", { class: "unit" }));
    const cells = [0, 1, 2].map(() => el("td", { class: "num" }));
    rows[kind] = { name, cells };
    body.append(el("tr", { "data-row-of": kind }, name, ...cells));
  }
  const [low, high] = [0, 1].map(() => el("th", { scope: "col" }));
  const whose = el("td", { class: "dim" });
  const principal = el("table", { class: "principal" },
    el("thead", {}, el("tr", {}, whose, low, el("td"), high)), body);
  const [others, chooseOthers] = choice("The other freedoms",
    [["free", "free", "Principal values of translation while the body may turn, of rotation while it may move: nothing loads the other freedoms"],
      ["held", "held", "Principal values of translation while the body cannot turn, of rotation while it cannot move: the diagonal blocks of the stiffness matrix"]],
    (value) => store.change({ others: value }));
  store.on("state", () => chooseOthers(store.state.others));

  const [condition, blocks, pose] = ["Condition number", "… translation; rotation (held)", "Position"].map(fact);
  const meters = el("div", { class: "meters" });
  const facts = el("dl", { class: "facts" }, ...condition.nodes, ...blocks.nodes, ...pose.nodes);
  byId("right").append(
    el("div", { class: "card principal-card" }, el("div", { class: "row" }, head, others,
      el("button", { type: "button", class: "quiet", title: "Everything that the matrix says (i)", onclick: () => showReport(store) }, "Full analysis")),
    principal, facts, meters));

  function fact(name) {
    const value = el("dd");
    return { value, nodes: [el("dt", {}, name), value] };
  }

  const reading = (kind, x) => (kind === "translation" ? store.read(x) : x);

  function update() {
    const { numbers, shown } = store;
    if (!numbers) return;
    const stiff = shown.quantity === "stiffness";
    head.textContent = stiff ? "Principal stiffness" : "Principal compliance";
    whose.textContent = `of ${stiff ? "K" : "C"}${sup(shown.connection)}`;
    low.textContent = stiff ? "softest" : "stiffest";
    high.textContent = stiff ? "stiffest" : "softest";
    const units = store.blockUnits();
    const [free, turned] = freeness(shown);
    for (const [kind, unit, others] of [["translation", units[1][1], free], ["rotation", units[0][0], turned]]) {
      const { name, cells } = rows[kind];
      const found = numbers.principal?.[kind];
      const size = found ? Math.max(...found.values.map((x) => Math.abs(reading(kind, x)))) : 0;
      const [factor, read] = !store.fine || kind === "rotation" ? inSize(size, unit) : [1, unit];
      name.lastElementChild.textContent = `${read}, ${others}`;
      cells.forEach((cell, i) => {
        const x = found ? reading(kind, found.values[i]) : null;
        cell.textContent = x !== null && Math.abs(x) < BLANK * size ? "0" : short(x === null ? null : x / factor);
        cell.classList.toggle("negative", x !== null && x < -BLANK * size);
        cell.title = x === null ? "does not exist here"
          : `${sure(x, size)} ${unit}\nalong (${found.axes[i].map((c) => short(c, 3)).join(", ")})${x < 0 ? "\nNEGATIVE: pushes away" : ""}`;
      });
    }
    const { indices } = numbers;
    const length = store.unit("length");
    condition.value.textContent = !indices ? "–" : indices.condition_number === null ? "∞ (singular)"
      : `${short(indices.condition_number)} at length ${engineering(indices.length, length)}`;
    condition.value.title = indices ? `Angles are multiplied by a length: ${indices.length_reason}. Smallest eigenvalue over largest: ${indices.eigenvalues.map((x) => short(x)).join(", ")}` : "";
    blocks.value.textContent = indices ? `${short(indices.translational_condition)}; ${short(indices.rotational_condition)}` : "–";
    const [x, y, z] = chop(numbers.position, numbers.singularity[0]?.length).map((c) => short(c, 4));
    pose.value.textContent = `${x}, ${y}, ${z} ${length}`;
    pose.value.title = `roll, pitch, yaw ${numbers.angles.map((a) => short((a * 180) / Math.PI, 4)).join(", ")}°`;
    showMeters(numbers.singularity);
  }

  const showMeters = (list) => meters.replaceChildren(...list.map(({ kind, ratio, smallest, largest, length }) => {
    const words = `Distance to ${kind} singularity`;
    const share = ratio > 0 ? clamp(1 + Math.log10(ratio) / 4, 0, 1) : 0; // logarithmic from 0.0001 to 1
    return el("div", { class: "singular", "data-level": ratio < RANK ? "bad" : ratio < NEAR ? "warning" : "good",
      title: `smallest over largest singular value ${short(smallest)} / ${short(largest)}, lengths over ${engineering(length, store.unit("length"))}; below ${NEAR} is near` },
    el("span", { class: "label" }, words),
    el("span", { class: "meter wide", role: "meter", "aria-label": words, "aria-valuemin": 0, "aria-valuemax": 1, "aria-valuenow": ratio }, el("i", { style: `width: ${100 * share}%` })),
    el("span", { class: "num" }, ratio < RANK ? "singular" : short(ratio, 3)));
  }));

  store.on("numbers", update);
  store.on("units", update);
}

export function notesCard(store) {
  const notes = el("ul", { class: "notes", "aria-label": "Notes" });
  const card = el("div", { class: "card notes-card" }, notes);
  byId("right").append(card);
  store.on("numbers", () => {
    const found = store.numbers.result.notes;
    notes.replaceChildren(...found.map(({ code, message }) => el("li", {}, el("code", {}, code), ` ${message}`)));
    card.hidden = !found.length;
  });
}

/** The analysis as text, in a dialog. */
export async function showReport(store) {
  const dialog = byId("report");
  if (dialog.open) return dialog.close();
  const text = el("pre", {}, "…");
  const title = el("h2", {}, "Analysis");
  dialog.replaceChildren(el("div", { class: "row" }, title,
    el("span", { class: "grow" }), el("button", { type: "button", onclick: () => dialog.close() }, "Close")), text);
  dialog.showModal();
  try {
    const answer = await store.ask({ do: "analysis" });
    title.textContent = answer.title;
    text.textContent = answer.text;
  } catch (error) {
    text.textContent = error.message;
  }
}
