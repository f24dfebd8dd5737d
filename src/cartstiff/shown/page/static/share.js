// The state in the address, and the page as files.

import { button, byId, copy, download, resting, toast } from "./dom.js";
import { pictureFile } from "./legend.js";

// What stands for the stiffness of a rigid joint, which is null.
const RIGID = "rigid";
// What is null in a state: springs as in the file, a load that they exert.
const NOT_GIVEN = "none";
// Where the address is in a file.
const ADDRESS = '<meta name="address" content="">';
const FIXED = new Set(["gravity", "payload", "command"]);
// Of the plot: names in an address, and in `store.plot`.
const PLOT = [["plot", "of"], ["along", "along"], ["and", "and"], ["values", "values"], ["seen", "seen"]];

/** What of a state differs from the first one, as an address writes it. */
function differing(state, { forms, state: first }) {
  const parts = new URLSearchParams();
  for (const key of Object.keys(forms)) {
    const value = state[key];
    if (value === undefined || JSON.stringify(value) === JSON.stringify(first[key])) continue;
    parts.set(key, Array.isArray(value) ? value.map((x) => x ?? RIGID).join(",") : String(value ?? NOT_GIVEN));
  }
  return parts;
}

/** A value of the state, in the form that the server reads; undefined for what cannot be. */
function valueOf(key, text, { forms, state: first }) {
  const { words, count, optional } = forms[key] ?? {};
  if (words) return !words.includes(text) ? undefined : typeof first[key] === "boolean" ? text === "true" : text;
  if (text === NOT_GIVEN) return optional ? null : undefined;
  const found = text.split(",").map((x) => (key === "stiffness" && x === RIGID ? null : Number(x)));
  if (!found.every((x) => x === null || Number.isFinite(x))) return undefined;
  if (count === 1) return found[0] > 0 ? found[0] : undefined;
  return found.length === (count ?? found.length) ? found : undefined;
}

/** Everything that is shown, as the part of an address after #. */
export function toHash(store) {
  const parts = differing(store.state, store.hello);
  for (const { number, state } of store.kept) parts.set(`kept${number}`, String(differing(state, store.hello)));
  const { frame } = store.hello.mechanism;
  if (frame !== store.firstFrame) parts.set("frame", frame);
  if (store.angle !== "deg") parts.set("angles", store.angle);
  if (String(store.pane.view) !== store.pane.first) parts.set("camera", String(store.pane.view));
  for (const [key, name] of PLOT) if (store.plot
    && String(store.plot[name]) !== String(store.usualPlot[name])) parts.set(key, String(store.plot[name]));
  if (parts.toString()) {
    if (!parts.has("q")) parts.set("q", store.state.q.join(",")); // a page may begin at another posture
    parts.set("of", `${store.hello.mechanism.name}@${store.hello.mechanism.fingerprint}`);
  }
  return parts.toString().replaceAll("%2C", ",").replaceAll("%40", "@");
}

/** The wishes that an address holds; what cannot be read is left out. */
function fromHash(hash, hello) {
  const wishes = [...new URLSearchParams(hash.replace(/^#/, ""))].filter(([key]) => Object.hasOwn(hello.forms, key))
    .map(([key, text]) => [key, valueOf(key, text, hello)]);
  return Object.fromEntries(wishes.filter(([, value]) => value !== undefined));
}

/** Name and fingerprint of the mechanism that an address is of; null if it names none. */
function origin(hash) {
  const of = new URLSearchParams(hash.slice(1)).get("of");
  const at = of?.lastIndexOf("@");
  return of === null ? null : at < 0 ? [of, ""] : [of.slice(0, at), of.slice(at + 1)];
}

/** What an address asks for, in the form of a step of `store.undo`. */
function stepTo(store, hash) {
  const { state: first } = store.hello;
  const asked = new URLSearchParams(hash.slice(1));
  const { live, shows } = store.source;
  const read = (text) => {
    const found = fromHash(text, store.hello);
    // A file weighs what it weighed when it was made, and draws some parts only.
    for (const key of Object.keys(found)) if (!live && (FIXED.has(key) || typeof first[key] === "boolean"
      && !shows.includes(key))) delete found[key];
    return { ...structuredClone(first), ...found };
  };
  const state = read(hash);
  const kept = [...asked].filter(([key]) => /^kept[1-3]$/.test(key))
    .map(([key, text]) => ({ number: Number(key[4]), state: read(text) }));
  // Another posture under the same load, without a state of its own.
  const { q: ghost } = fromHash(`q=${asked.get("ghost") ?? first.ghost ?? ""}`, store.hello);
  if (!kept.length && ghost) kept.push({ number: 1, state: { ...structuredClone(state), q: ghost } });
  state.ghost = kept[0]?.state.q ?? null;
  /** @type {Record<string, any>} */
  const plot = Object.fromEntries(PLOT.filter(([key]) => asked.has(key)).map(([key, name]) => [name, asked.get(key)]));
  const seen = (plot.seen ?? "").split(",").map(Number);
  plot.seen = [2, 4].includes(seen.length) && seen.every(Number.isFinite) ? seen : null;
  return { state, kept, plot, angle: asked.get("angles") === "rad" ? "rad" : "deg",
    frame: (live && asked.get("frame")) || store.firstFrame };
}

/** The address of what is shown: without the secret of a server, which is new for the next one; it asks for that. */
export const linkTo = (store) => `${store.source.live ? location.origin + "/" + location.search
  : location.href.split("#")[0]}#${toHash(store)}`;

export function sharing(store) {
  const actions = byId("actions");
  /** A button whose answer becomes a file; what prevents it is said. */
  const saved = (text, title, ask) => {
    const node = button(text, async () => {
      node.disabled = true;
      await ask().then((made) => download(...made), (error) => store.tell("error", error.message));
      node.disabled = false;
    }, { title });
    return node;
  };
  const html = saved("HTML", "This page as one file that opens without a network", async () => {
    toast("Writing the page …");
    const { name, text } = await (hasServer ? store.ask({ do: "export", address: toHash(store) }) : fromPrepared());
    return [name, text, "text/html"];
  });
  // A file that was asked for while there was a server: with formulas in it, it opens at any state.
  let prepared = null;
  let hasServer = true;
  const atRest = resting();

  /** What a file cannot change later. */
  const baked = () => JSON.stringify([store.hello.mechanism.frame, ...(store.local ? [...FIXED].map((key) =>
    store.state[key]) : [toHash(store)])]);

  async function fromPrepared() {
    if (prepared?.of !== baked()) throw new Error("the server has ended, and no file of this state was prepared");
    const address = toHash(store).replaceAll("&", "&amp;");
    return { ...prepared, text: prepared.text.replace(ADDRESS, () => ADDRESS.replace('""', `"${address}"`)) };
  }

  async function prepare() {
    const of = baked();
    if (!hasServer || !store.source.live || prepared?.of === of) return;
    const { name, text } = await store.ask({ do: "export", address: toHash(store) });
    prepared = { of, name, text };
    html.dataset.prepared = "";
  }

  store.on("server", (is) => { link.disabled = !(hasServer = is); });
  store.on("numbers", () => atRest(() => prepare().catch(() => {}), store.source.rest));
  const link = button("Link", () => copy(linkTo(store), "Address (without its secret)"),
    { title: "Copy the address of this state, without the secret in it: who opens it is asked for what cartstiff "
      + "has printed" });
  html.id = "export";
  actions.append(
    link,
    pictureFile(store),
    saved("JSON", "The numbers at this posture, as `cartstiff analyse --json` prints them", async () =>
      [`${store.hello.mechanism.name}.json`,
        `${JSON.stringify((await store.ask({ do: "result" })).result, null, 1)}\n`, "application/json"]),
    html);
  store.on("hello", () => { html.hidden = !store.source.live; });

  /** Go where an address leads, unless it is of another mechanism: that is for the user to say. */
  function follow(hash, isFirst = false) {
    const { name, fingerprint } = store.hello.mechanism;
    const [theirs, print] = origin(hash) ?? [name, fingerprint];
    if (theirs !== name) {
      if (isFirst) apply("");
      store.tell("foreign", { text: `This link is of ${theirs}, and this page shows ${name}: it was not applied.`,
        act: ["Apply it here", () => apply(hash)] });
      return;
    }
    apply(hash);
    if (print !== fingerprint) {
      store.tell("foreign",
        { text: `This link was made of another ${name}: its model, springs, masses or load at first were not those of `
          + `this page, and its numbers may have been others.` });
    }
  }

  function apply(hash) {
    const view = (new URLSearchParams(hash.slice(1)).get("camera") ?? "").split(",").map(Number);
    if (view.length === 6 && view.every(Number.isFinite)) store.pane.view = view;
    store.restore(stepTo(store, hash)).catch((error) => store.tell("error", error.message));
  }

  let followed = false;
  store.on("hello", (hello) => {
    if (followed) return;
    followed = true;
    store.firstFrame = hello.mechanism.frame;
    if (location.hash) follow(location.hash, true);
    else { // a file has the address that it was made at, or saved at later
      const later = document.querySelector("meta[name=address]").getAttribute("content");
      apply(`#${later || (hello.address ?? "")}`);
    }
  });
  const settled = resting();
  const settle = () => settled(() => {
    const hash = toHash(store);
    try {
      history.replaceState(null, "", hash ? `#${hash}` : location.pathname + location.search);
    } catch {
      // A file opened from disk may not rewrite its address.
    }
  }, 500);
  store.on("numbers", settle);
  for (const event of ["plot", "kept", "angles"]) store.on(event, () => store.numbers && settle());
  window.addEventListener("hashchange", () => {
    store.remember("address");
    follow(location.hash);
  });
}
