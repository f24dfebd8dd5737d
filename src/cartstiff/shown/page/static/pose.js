// Sliders and numbers of the coordinates, a platform's legs, the pose of the tool.

import { angles, motion, moving, product, rotation } from "./algebra.js";
import { button, card, chop, clamp, el, hint, resting, short, tabs, toast } from "./dom.js";
import { DEGREES, fields, sliderRow } from "./inputs.js";
import { NEGLIGIBLE_DIFFERENCE } from "./numerics.js";

// From so many sliders on there is a field to find one.
const MANY = 10;
// Range of the length of a leg without limits, and the time (ms) for which its fellows are held.
const LEG_SHARE = 0.25;
const HELD = 600;
const TURNS = ["roll", "pitch", "yaw"];

export function posePanel(store) {
  let rows = [];
  let stretching = null; // lengths while one is changed by hand
  const letGo = resting();
  const list = el("div.sliders");
  const legs = el("div.legs");
  const meaning = hint();
  const filter = el("input.filter", { type: "search", placeholder: "Find a joint",
    "aria-label": "Find a joint", hidden: true,
    oninput: () => narrow() });
  const unitButton = button("", () => flipAngle(), { title: "Degrees or radians (d)", class: "quiet" });
  const home = button("Home", () => toHome(store), { title: "The posture of the file (h)" });
  const zero = button("Zero", () => toZero(store), { title: "All coordinates zero, where the limits allow it (0)" });
  const random = button("Random", () => toRandom(store), { title: "A random posture within the limits (r)" });
  const [joints, tool, note] = [el("div"), el("div.panel"), el("span.dim.small")];
  const [tab, offer] = tabs("Posture by", [["joints", "Joints", joints], ["tool", "Tool", tool]]);
  card("left", "div.card.posture-card", el("div.row.head", el("h2", "Posture"), tab, el("span.grow"), unitButton),
    el("div.row.buttons", home, zero, random), note, joints, tool);
  joints.append(filter, list, legs, meaning);
  toolPanel(store, tool, note, offer);

  function flipAngle() {
    store.remember("angle");
    setAngle(store.angle === "deg" ? "rad" : "deg");
  }

  function setAngle(unit) {
    store.angle = unit;
    unitButton.textContent = unit === "deg" ? "° → rad" : "rad → °";
    for (const row of rows) row.relabel();
    if (store.state) update();
  }

  function build(hello) {
    const { coordinates, sliders, platform } = hello.mechanism;
    zero.hidden = platform || sliders.length !== coordinates.length || !store.source.moves;
    random.hidden = !store.source.moves;
    rows = sliders.map((index) => sliderRow(store, { ...coordinates[index], index, value: () => store.state.q[index],
      move: (x) => store.move(index, x) }));
    list.replaceChildren(...rows.map(({ node }) => node));
    legs.replaceChildren();
    filter.hidden = sliders.length < MANY;
    filter.value = "";
    const passive = coordinates.length - sliders.length;
    if (passive) list.append(hint(`${passive} more coordinates follow from closures or flexible links.`));
    setAngle(store.angle);
  }

  /** Show the coordinates whose names hold what is looked for. */
  function narrow() {
    const wanted = filter.value.trim().toLowerCase();
    for (const { node, index } of rows) node.hidden = !store.hello.mechanism.coordinates[index].name.toLowerCase()
      .includes(wanted);
  }

  function update() {
    for (const row of rows) row.set();
    meaning.hidden = !store.source.moves;
    meaning.textContent = store.hello.mechanism.takes_load
      ? `The sliders move the drives: the springs' rest positions follow, and the load stays as it is under `
        + `Load.${store.given().load ? " Until something is moved, the springs rest as in the file." : ""}`
      : "The sliders move the mechanism against its potentials: it has no drives with springs.";
  }

  function showLegs() {
    const found = store.numbers.legs;
    legs.hidden = !found;
    if (!found) return;
    const unit = store.unit("length");
    if (legs.childElementCount !== found.length + 1) {
      const range = (i) => el("input", { type: "range", step: "any", "aria-label": `length of leg ${i + 1}`,
        disabled: !store.source.moves, oninput: ({ target }) => stretch(i, target.valueAsNumber) });
      legs.replaceChildren(el("div.leg.leg-head.dim.small", el("span", "leg"), el("span", `length ${unit}`),
        el("span", ""), el("span", `tension ${store.unit("force")}`)),
      ...found.map((_, i) => el("div.leg", el("span", String(i + 1)), el("span.num"), range(i), el("span.num"))));
    }
    found.forEach((leg, i) => {
      const row = legs.children[i + 1];
      const [, length, range, tension] = row.children;
      length.textContent = short(leg.length, 5);
      tension.textContent = short(leg.tension);
      const limited = leg.lower !== null && leg.upper !== null;
      const beyond = limited && (leg.length < leg.lower || leg.length > leg.upper);
      row.classList.toggle("beyond", beyond);
      // Without limits a share of the length that it had at first.
      const [low, high] = limited ? [leg.lower, leg.upper]
        : [1 - LEG_SHARE, 1 + LEG_SHARE].map((x) => x * (range.first ??= leg.length));
      if (Number(range.min) !== low || Number(range.max) !== high) [range.min, range.max] = [low, high];
      if (document.activeElement !== range || !stretching) range.value = leg.length;
      row.title = limited ? `leg ${i + 1}: limits ${short(leg.lower)} … ${short(leg.upper)} ${unit}${beyond
        ? ": BEYOND ITS LIMIT" : ""}` : `leg ${i + 1} has no limits`;
    });
  }

  /** Another length of one leg, the others as they are: the pose follows. */
  function stretch(i, length) {
    stretching ??= store.numbers.legs.map((leg) => leg.length);
    stretching[i] = length;
    letGo(() => { stretching = null; }, HELD);
    store.remember(`leg ${i}`);
    store.reach({ lengths: stretching.slice() });
  }

  store.on("angles", setAngle);
  store.on("hello", build);
  store.on("state", update);
  store.on("numbers", () => {
    update();
    showLegs();
  });
  store.on("error", () => {
    stretching = null; // a leg that cannot be so long goes back
    if (store.numbers) showLegs();
  });
  return { flipAngle };
}

export function toHome(store) {
  store.goTo(store.hello.state.q);
  store.follow();
}

/** Zero, or the nearest to it within the limits and, in a file, within what its formulas cover. */
export function toZero(store) {
  const { coordinates } = store.hello.mechanism;
  const zero = coordinates.map(({ lower, upper }) => clamp(0, lower, upper));
  const q = store.source.covered?.(zero, store.hello.state.q, store.state) ?? zero;
  const away = coordinates.filter((_, i) => zero[i] !== 0).map(({ name }) => name);
  const why = [away.length && `zero is beyond the limits of ${away.join(", ")}`,
    q !== zero && "this file does not compute the singular posture at zero"];
  const words = why.filter(Boolean).join("; ");
  if (words) toast(`The nearest posture: ${words}`);
  store.goTo(q);
  store.follow();
}

export function toRandom(store) {
  const { coordinates, sliders, platform } = store.hello.mechanism;
  const q = store.state.q.slice();
  const home = store.hello.state.q;
  for (const i of sliders) {
    const { lower, upper, limited } = coordinates[i];
    // Without limits, near home: a platform or a closed chain stays assembled.
    const share = platform || !limited ? 0.4 : 1;
    const random = lower + Math.random() * (upper - lower);
    q[i] = home[i] + share * (random - home[i]);
  }
  store.goTo(q);
  store.follow();
}

/** The pose of M as numbers: joints follow, as they do a hand. */
function toolPanel(store, node, note, offer) {
  const words = hint();
  let rows;
  store.on("hello", ({ mechanism }) => {
    offer("tool", !mechanism.platform && store.source.moves);
    const { length } = mechanism.units;
    rows = [fields(["x", "y", "z"].map((name) => [name, length, "tool"]), () => go()),
      fields(TURNS.map((name) => [name, "°", "tool"]), () => go())];
    words.textContent = `Position of M in ${length}; roll, pitch, yaw about the room's axes in degrees. The joints `
      + `follow as near as they can.`;
    node.replaceChildren(rows[0].node, rows[1].node, words);
  });
  store.on("numbers", ({ followed }) => {
    const { numbers } = store;
    const digits = (x) => Number(x.toPrecision(6));
    rows[0].set(chop(numbers.position, numbers.singularity[0]?.length).map(digits));
    rows[1].set(angles(numbers.result.pose)
      .map((x) => digits((Math.abs(x) < NEGLIGIBLE_DIFFERENCE ? 0 : x) * DEGREES)));
    const away = followed && !followed.reached;
    note.textContent = away ? `not reached${followed.stopped.length ? `: ${followed.stopped.join(", ")}` : ""}` : "";
  });

  function go() {
    const [position, turns] = rows.map(({ node: row }) =>
      [...row.querySelectorAll("input")].map((input) => input.valueAsNumber));
    if (![...position, ...turns].every(Number.isFinite)) return;
    const [roll, pitch, yaw] = turns.map((x, i) => rotation(moving([0, 1, 2].map((k) => (k === i ? x / DEGREES : 0))
      .concat([0, 0, 0]))));
    const R = product(yaw, product(pitch, roll));
    store.remember("pose");
    store.reach({ towards: { pose: motion(R, position), turning: true } });
  }
}
