// Setup (load, drives, springs, reference point), and what the picture shows.

import { stiffnessBall } from "./ball.js";
import { button, byId, card, checkbox, choice, dropdown, el, heading, hint, stateChoice, tabs, toast } from "./dom.js";
import { fields, sliderRow } from "./inputs.js";
import { NO_LOAD, loadWords, shownLoad } from "./loads.js";
import { NEGLIGIBLE_DIFFERENCE, ZERO_SHARE } from "./numerics.js";
import { pointOfMap, standAt, standAtExtreme, words } from "./pick.js";

const COORDINATES = ["x", "y", "z"];
const AXES = [["body", "tool axes", "Components along the axes of the body frame M"],
  ["world", "room axes", "Components along the axes of the inertial frame F"]];

export function controls(store) {
  const note = el("span.dim.small");
  const panels = ["load", "drives", "springs", "point"].map((name) =>
    [name, name[0].toUpperCase() + name.slice(1), el("div.panel")]);
  const [loadPanel, drives, springPanel, pointPanel] = panels.map(([, , node]) => node);
  const [tab, offer] = tabs("Setup", panels);
  card("left", "div.card.setup-card", heading("Setup", note), tab, ...panels.map(([, , node]) => node));
  const notes = { drives: drivesPanel(store, drives, offer) };

  const axes = stateChoice(store, "axes", "Axes of the numbers", AXES);
  const loadAxes = stateChoice(store, "load_axes", "Axes of the load", AXES);
  const loadKind = stateChoice(store, "load_kind", "While the tool moves the load", [
    ["dead", "fixed in the room", "dead: force and moment keep their direction in the room"],
    ["follower", "turns with the tool", "follower: force and moment turn with the tool"],
    ["conservative", "conservative", "the force keeps its direction in the room, the moment turns by half"]]);
  const [loadPlace, choosePlace] = choice("The load acts at", [
    ["point", "at the point", "The load acts at the reference point, about which its moment is"],
    ["origin", "at M, or at:",
      "The load acts at the origin of M, or at the point of M that is given, about which its moment is"]],
  (value) => store.change({ load_at: value === "point" ? null : [0, 0, 0] }));
  // One of three; mine begins with what is shown.
  const [loadOf, chooseLoad] = choice("Load", [
    ["springs", "from the springs", "What the springs of the file exert at this posture, until it is moved"],
    ["mine", "mine", "Moment and force of the fields below"],
    ["none", "none", "Nothing acts: the springs rest at this posture"]], (value) => {
    isMine = value === "mine";
    const { mechanism } = store.hello;
    if (isMine) store.change(shownLoad(store));
    else store.change({ load: value === "none" && mechanism.may_be_loaded ? NO_LOAD : null });
  });
  const along = hint();
  const acts = el("details.acts");
  let isMine = false; // chosen, while its numbers may all be zero
  let load, springs, point, loadPoint, weight;

  function build(hello) {
    const { mechanism } = hello;
    const { units } = mechanism;
    const moment = `${units.force} ${units.length}`;

    // -- load
    weight = {
      gravity: fields(["gx", "gy", "gz"].map((name) => [name, "m/s²", "gravity"]),
        (values) => store.change({ gravity: values })),
      payload: fields([["mass", "kg", "payload"], ...COORDINATES.map((name) => [name, units.length, "payload at"])],
        (values) => store.change({ payload: values[0] > 0 ? values : null })),
    };
    isMine = false;
    loadOf.querySelector("[data-value=springs]").hidden = !mechanism.may_be_loaded;
    const six = [["mx", moment], ["my", moment], ["mz", moment], ["fx", units.force], ["fy", units.force],
      ["fz", units.force]];
    load = fields(six, (values) => store.change({ ...shownLoad(store), load: values.map((x) => x ?? 0) }),
      six.map(() => ({ called: "0", value: null })));
    loadPoint = fields(COORDINATES.map((name) => [name, units.length, "load at"]),
      (values) => store.change({ load_at: values }));
    loadPoint.node.title = `Where the load acts: from the origin of M along its axes, in ${units.length}`;
    acts.replaceChildren(el("summary", "Axes, place, behaviour, weight"), loadAxes, loadPlace, loadPoint.node,
      loadKind);
    loadPanel.replaceChildren(loadOf, load.node, along, acts);
    // A file weighs what it weighed when it was made.
    if (store.source.live) acts.append(hint("Gravity along the room's axes in m/s²; a mass on the body in kg, "
      + "and its centre in M"), weight.gravity.node, weight.payload.node);

    // -- springs
    springs = mechanism.springs.length ? fields(mechanism.springs.map(({ name, unit }) => [name, unit]),
      (values) => (values.some((x) => x < 0) ? toast("a stiffness must be 0 or more")
        : store.change({ stiffness: values })),
      mechanism.springs.map(({ stiffness, nonlinear }) => (nonlinear || stiffness === null)
        && { called: nonlinear ? "nonlinear" : "rigid", value: stiffness })) : null;
    springs?.node.classList.add("long");
    offer("springs", springs);
    if (springs) springPanel.replaceChildren(
      hint(`In ${[...new Set(mechanism.springs.map(({ unit }) => unit))].join(", ")}`), springs.node,
      button("As in the file", () => store.change({ stiffness: null })));

    // -- reference point
    const frameSelect = dropdown("Frame M", mechanism.frames.map((name) => [name, name]), (name) => {
      store.remember("frame");
      store.ask({ do: "frame", name, kept: store.kept.map(({ state: each }) => each) }).then(() =>
        toast(`The numbers are for the origin of ${name}; posture, load and springs are as before`)).catch((error) => {
        frameSelect.value = mechanism.frame;
        store.tell("error", error.message);
      });
    });
    frameSelect.value = mechanism.frame;
    point = fields([["x", units.length], ["y", units.length], ["z", units.length]],
      (values) => store.change({ point: values }));
    const frames = mechanism.frames.length > 1 && store.source.live
      ? el("label.line", el("span", "frame M"), frameSelect) : "";
    pointPanel.replaceChildren(frames,
      hint(`Point on the body, from the origin of M along its axes, in ${units.length}`), point.node, axes);
  }

  function update() {
    const { state, hello } = store;
    const { units, takes_load: takesLoad, may_be_loaded: mayBeLoaded } = hello.mechanism;
    const ofSprings = state.load === null && mayBeLoaded;
    if (state.load === null) isMine = false;
    chooseLoad(ofSprings ? "springs" : isMine || state.load?.some((x) => x) ? "mine" : "none");
    const shown = shownLoad(store);
    load.set(state.load ?? shown.load.map((x) => Number(x.toPrecision(5))));
    along.textContent = `Moment in ${units.force} ${units.length}, force in ${units.force}, along the `
      + `${shown.load_axes === "world" ? "room's" : "tool's"} axes`;
    for (const { control } of [...loadOf.children]) control.disabled = !takesLoad || !store.source.moves;
    for (const { control } of [...loadAxes.children]) control.disabled = ofSprings || !store.source.moves;
    choosePlace(state.load_at !== null || state.load === null ? "origin" : "point");
    loadPoint.set(state.load_at ?? state.point);
    loadPoint.disable(state.load === null || !store.source.moves);
    load.disable(!store.source.moves || !hello.mechanism.takes_load);
    weight.gravity.set(state.gravity ?? hello.mechanism.gravity ?? [0, 0, 0]);
    weight.payload.set(state.payload ?? [0, 0, 0, 0]);
    springs?.set(state.stiffness ?? hello.mechanism.springs.map(({ stiffness }) => stiffness));
    point.set(state.point);
    notes.springs = state.stiffness ? "springs changed" : "";
    notes.point = [state.point.some((x) => x) && "point moved", state.axes === "world" && "room axes"].filter(Boolean)
      .join(", ");
    note.textContent = note.title = [notes.load, notes.drives(), notes.springs, notes.point].filter(Boolean).join(", ");
  }

  /** The wrench that acts, without what is only rounding beside its other half, or beside the stiffness. */
  function loadNote() {
    const { wrench } = store.numbers.result;
    if (!wrench) return "none can hold it";
    const K = (store.matrix("B", store.numbers, "stiffness") ?? [[1e4]]).flat().map(Math.abs);
    const noise = Math.max(NEGLIGIBLE_DIFFERENCE * Math.max(...wrench.map(Math.abs)), ZERO_SHARE * Math.max(...K));
    return loadWords(store, { load: wrench.map((x) => (Math.abs(x) > noise ? x : 0)) }) || "no load";
  }

  store.on("hello", build);
  store.on("state", update);
  store.on("numbers", () => {
    notes.load = loadNote();
    update();
  });
}

/** Commands of the drives: how far each moves from the posture. */
function drivesPanel(store, node, offer) {
  let rows = [];
  store.on("hello", ({ mechanism }) => {
    const { springs, coordinates, platform, size, units } = mechanism;
    offer("drives", store.source.live && springs.some(({ driven }) => driven));
    rows = springs.flatMap(({ name, driven }, i) => {
      const isLength = platform || coordinates[i]?.is_length;
      const most = isLength ? COMMAND_SHARE * (size ?? 1) : COMMAND_TURN;
      const move = (x) => {
        const command = (store.state.command ?? springs.map(() => 0)).with(i, Math.abs(x) < most / 200 ? 0 : x);
        store.change({ command: command.some((told) => told) ? command : null });
      };
      return driven ? [sliderRow(store, { id: `drive-${i}`, name: `command of ${name}`, label: name, lower: -most,
        upper: most, unit: isLength ? units.length : "rad", is_length: isLength, digits: 5,
        value: () => store.state.command?.[i] ?? 0, move })] : [];
    });
    node.replaceChildren(hint("How far each drive is commanded to move from the posture; what results under the load "
      + "is shown."),
      el("div.sliders", ...rows.map((row) => row.node)),
        button("None", () => store.change({ command: null })));
  });
  const set = () => rows.forEach((row) => {
    row.relabel();
    row.set();
  });
  store.on("state", set);
  store.on("angles", set);
  return () => (store.state.command ? "drives commanded" : "");
}

// Ends of the slider of a command: a share of the mechanism's size, and an angle.
const COMMAND_SHARE = 0.02;
const COMMAND_TURN = Math.PI / 36;

const TOGGLES = [
  ["translation", "Translation ellipsoid"],
  ["rotation", "Rotation ellipsoid"],
  ["labels", "Principal axes and values"],
  ["wrench", "Wrench arrows"],
  ["deflection", "Way from the rest, in grey"],
  ["centres", "Centres of stiffness"],
  ["held_forces", "Forces that the drives hold"],
];

/** What the picture shows, from where, and what its sizes mean. */
export function pictureControls(store) {
  const list = byId("show-list");
  const boxes = TOGGLES.map(([key, text]) => [key, checkbox(text, (is) => store.change({ [key]: is }))]);
  const every = checkbox("All principal values", (is) => {
    store.pane.every = is;
    store.pane.viewer.set_dirty();
  }, { title: "Otherwise the softest value of each, and the others when it is pointed at" });
  const scale = stateChoice(store, "scale", "Scale of the ellipsoids",
    [["root", "√", "Radii grow with the square root of the value: soft and stiff stay visible"],
      ["linear", "linear", "Radii grow with the value"],
      ["log", "log", "Radii grow with the logarithm; a ring for each factor of ten"]]);
  list.append(...boxes.map(([, box]) => box), every, stiffnessBall(store), el("div.line", el("span", "radii"), scale));
  const details = byId("show");
  document.addEventListener("pointerdown", (/** @type {any} */ event) => {
    if (!details.contains(event.target)) details.open = false;
  });

  const cameras = byId("cameras");
  for (const [preset, text] of [["iso", "3D"], ["front", "Front"], ["side", "Side"], ["top", "Top"], ["fit", "Fit"]]) {
    const look = () => store.ask({ do: "bounds" })
      .then(({ bounds }) => store.pane.look(preset, bounds), (error) => store.tell("error", error.message));
    cameras.append(button(text, look, { title: `View: ${text.toLowerCase()}`, "data-preset": preset }));
  }

  store.on("state", () => { for (const [key, { control }] of boxes) control.checked = store.state[key]; });
  store.on("hello", (hello) => {
    // An exported page draws some parts only.
    const fixed = !store.source.live;
    for (const [key, box] of boxes) {
      box.control.disabled = store.source.shows !== null && !store.source.shows.includes(key);
      box.title = box.control.disabled ? "`cartstiff view` draws this" : "";
    }
    for (const { control } of scale.children) control.disabled = !store.source.moves;
    const points = hello.cloud;
    document.querySelector("#map-choice")?.remove();
    if (!points) return;
    const select = dropdown("Quantity of the map",
      points.quantities.map(({ name, unit }) => [name, unit ? `${name} (${unit})` : name]),
      (name) => store.change({ quantity_of_map: name }));
    const thinned = points.thinned > 1 ? `, one of ${points.thinned} in its file: a page shows no more` : "";
    const extreme = (end, sign) => button(end, () => standAtExtreme(store, sign),
      { class: "quiet", disabled: !points.has_postures || !store.source.moves,
        title: `Stand at the point of the map with its ${end} value` });
    const [number, said] = [el("input", { type: "number", min: 1, max: points.count,
      title: "Read a point of the map by its number; Enter makes it the posture" }), el("p.hint", { role: "status" })];
    const numbered = () => pointOfMap(store, number.valueAsNumber - 1);
    number.addEventListener("input", () => { said.textContent = numbered() ? words(store, numbered()) : ""; });
    number.addEventListener("keydown", ({ key }) => { if (key === "Enter" && numbered()) standAt(store, numbered()); });
    list.append(el("div", { id: "map-choice" },
      el("label.line", "map", select),
      el("div.row", extreme("lowest", -1), extreme("highest", 1)),
      el("label.line", "point", number), said,
      hint(`${points.count} points${thinned}`)));
    select.value = store.state.quantity_of_map;
    select.disabled = fixed;
  });
}
