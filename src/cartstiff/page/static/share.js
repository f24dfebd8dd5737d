// The state in the address, and the page as files.

import { byId, copy, download, el, toast } from "./dom.js";
import { pictureFile } from "./legend.js";

// Of the state, what an address holds; the kind of each is that of the first state.
const KEYS = ["q", "connection", "quantity", "others", "axes", "point", "stiffness", "load", "load_axes",
  "load_kind", "load_at", "gravity", "payload", "command",
  "scale", "translation", "rotation", "labels", "wrench", "deflection", "screws", "centres", "quantity_of_map", "mode"];
const NUMBERS = new Set(["q", "point", "stiffness", "load", "load_at", "gravity", "payload", "command"]);
// What stands for the stiffness of a rigid joint, which is null.
const RIGID = "rigid";
const FLAGS = new Set(["translation", "rotation", "labels", "wrench", "deflection", "screws", "centres"]);

const FIXED = new Set(["gravity", "payload", "command"]);

const WORDS = {
  connection: ["load", "A", "B", "K", "F", "+"], quantity: ["stiffness", "compliance"], others: ["free", "held"], axes: ["body", "inertial"],
  load_axes: ["body", "inertial"], load_kind: ["dead", "follower", "conservative"], scale: ["root", "linear", "log"],
};
// Of the plot: names in an address, and in `store.plot`.
const PLOT = [["plot", "of"], ["along", "along"], ["and", "and"], ["values", "values"], ["seen", "seen"]];
const COUNTS = { point: 3, load: 6, load_at: 3, gravity: 3, payload: 4 };

/** What of a state differs from the first one. */
function differing(state, first) {
  const parts = new URLSearchParams();
  for (const key of KEYS) {
    const value = state[key];
    if (value === null || value === undefined || JSON.stringify(value) === JSON.stringify(first[key])) continue;
    parts.set(key, NUMBERS.has(key) ? value.map((x) => x ?? RIGID).join(",") : String(value));
  }
  return parts;
}

/** Everything that is shown, as the part of an address after #. */
export function toHash(store) {
  const parts = differing(store.state, store.hello.state);
  for (const { number, state } of store.kept) parts.set(`kept${number}`, differing(state, store.hello.state));
  const { frame } = store.hello.mechanism;
  if (frame !== store.firstFrame) parts.set("frame", frame);
  if (store.fine) parts.set("lengths", store.fine);
  if (store.angle !== "deg") parts.set("angles", store.angle);
  if (String(store.pane.view) !== store.pane.first) parts.set("camera", String(store.pane.view));
  for (const [key, name] of PLOT) if (store.plot && String(store.plot[name]) !== String(store.usualPlot[name])) parts.set(key, String(store.plot[name]));
  return parts.toString().replaceAll("%2C", ",");
}

/** The wishes that an address holds; what cannot be read is left out. */
export function fromHash(hash, first) {
  const found = {};
  for (const [key, text] of new URLSearchParams(hash.replace(/^#/, ""))) {
    if (!KEYS.includes(key)) continue;
    if (key === "mode") {
      if (/^[1-9]\d?$/.test(text)) found.mode = Number(text);
    } else if (NUMBERS.has(key)) {
      const numbers = text.split(",").map((x) => (key === "stiffness" && x === RIGID ? null : Number(x)));
      const count = key in COUNTS ? COUNTS[key] : ["stiffness", "command"].includes(key) ? numbers.length : first.q.length;
      const fits = numbers.length === count;
      if (fits && numbers.every((x) => x === null || Number.isFinite(x))) found[key] = numbers;
    } else if (FLAGS.has(key)) found[key] = text === "true";
    else if (key in WORDS ? WORDS[key].includes(text) : first[key] !== null) found[key] = text;
  }
  return found;
}

/** The address of what is shown: without the secret of a server, which is new for the next one; it asks for that. */
export const linkTo = (store) => `${store.source.live ? location.origin + "/" + location.search : location.href.split("#")[0]}#${toHash(store)}`;

export function sharing(store) {
  const actions = byId("actions");
  const button = (text, title, onclick) => el("button", { type: "button", title, onclick }, text);
  /** A button whose answer becomes a file; what prevents it is said. */
  const saved = (text, title, ask) => {
    const node = button(text, title, async () => {
      node.disabled = true;
      await ask().then((made) => download(...made), (error) => store.tell("error", error.message));
      node.disabled = false;
    });
    return node;
  };
  const html = saved("HTML", "This page as one file that opens without a network", async () => {
    toast("Writing the page …");
    const { name, text } = await store.ask({ do: "export", address: toHash(store) });
    return [name, text, "text/html"];
  });
  html.id = "export";
  actions.append(
    button("Link", "Copy the address of this state, without the secret in it: who opens it is asked for what cartstiff has printed", () => copy(linkTo(store), "Address (without its secret)")),
    pictureFile(store, () => file(store)),
    saved("JSON", "The numbers at this posture, as `cartstiff analyse --json` prints them", async () =>
      [`${file(store)}.json`, `${JSON.stringify((await store.ask({ do: "result" })).result, null, 1)}\n`, "application/json"]),
    html);
  store.on("hello", () => { html.hidden = !store.source.live; });

  /** Units and camera as an address has them. */
  function lookAs(asked) {
    store.readIn(asked.get("lengths"));
    store.tell("angles", asked.get("angles") === "rad" ? "rad" : "deg");
    const view = (asked.get("camera") ?? "").split(",").map(Number);
    if (view.length === 6 && view.every(Number.isFinite)) store.pane.view = view;
    store.wishedPlot = Object.fromEntries(PLOT.filter(([key]) => asked.has(key)).map(([key, name]) => [name, asked.get(key)]));
    const seen = (store.wishedPlot.seen ?? "").split(",").map(Number);
    store.wishedPlot.seen = [2, 4].includes(seen.length) && seen.every(Number.isFinite) ? seen : null;
    if (applied && store.plot) store.tell("replot");
  }

  let timer = null;
  let applied = false;
  store.on("hello", (hello) => {
    if (applied) return;
    applied = true;
    store.firstFrame = hello.mechanism.frame;
    const hash = location.hash || `#${hello.address ?? ""}`; // a file has the address that it was made at
    const asked = new URLSearchParams(hash.slice(1));
    const read = (text) => {
      const found = fromHash(text, hello.state);
      // A file weighs what it weighed when it was made, and draws some parts only.
      const { live, shows } = store.source;
      for (const key of Object.keys(found)) if (!live && (FIXED.has(key) || FLAGS.has(key) && !shows.includes(key))) delete found[key];
      return found;
    };
    lookAs(asked);
    const wishes = read(hash);
    const kept = [...asked].filter(([key]) => /^kept[1-3]$/.test(key)).map(([key, text]) => ({ number: Number(key[4]), state: { ...structuredClone(hello.state), ...read(text) } }));
    // Another posture under the same load, without a state of its own.
    const ghost = fromHash(`q=${asked.get("ghost") ?? hello.state.ghost ?? ""}`, hello.state).q;
    if (!kept.length && ghost) kept.push({ number: 1, state: { ...structuredClone(hello.state), ...wishes, q: ghost } });
    const frame = asked.get("frame");
    if (frame && frame !== hello.mechanism.frame && store.source.live) {
      store.ask({ do: "frame", name: frame }).then(() => {
        store.apply(wishes);
        store.setKept(kept, false);
      }, (error) => store.tell("error", error.message));
    } else {
      store.kept = kept;
      Object.assign(store.state, wishes, { ghost: kept[0]?.state.q ?? null });
      store.tell("kept", kept);
    }
  });
  const settle = () => {
    clearTimeout(timer);
    timer = setTimeout(() => {
      const hash = toHash(store);
      try {
        history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
      } catch {
        // A file opened from disk may not rewrite its address.
      }
    }, 500);
  };
  store.on("numbers", settle);
  for (const event of ["units", "plot", "kept", "angles"]) store.on(event, () => store.numbers && settle());
  window.addEventListener("hashchange", () => {
    const asked = new URLSearchParams(location.hash.slice(1));
    if ([...asked.keys()].some((key) => /^(frame|kept[1-3])$/.test(key))) return location.reload();
    lookAs(asked);
    const wishes = fromHash(location.hash, store.hello.state);
    store.change({ ...store.hello.state, theme: store.state.theme, ...wishes });
    store.setKept([], false);
  });
}

const file = (store) => `${store.hello.mechanism.name}`.replaceAll(/[^\w.-]+/g, "_");
