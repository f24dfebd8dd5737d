// The page: from a server, or from the data that an exported file holds.

import { additionsCard } from "./additions.js";
import { compareCard } from "./compare.js";
import { controls, pictureControls } from "./controls.js";
import { deflectionPanel } from "./deflection.js";
import { all, button, byId, el, loaded, resting } from "./dom.js";
import { enoughCard } from "./enough.js";
import { restore } from "./filters.js";
import { guides } from "./guide.js";
import { hands } from "./hands.js";
import { shortcuts } from "./help.js";
import { legendBox } from "./legend.js";
import { LiveSource, unpack } from "./live.js";
import { matrixPanel } from "./matrix.js";
import { modesPanel } from "./modes.js";
import { notesCard, numbersPanel, verdictLine } from "./numbers.js";
import { ComputingSource, PostureSource } from "./offline.js";
import { Pane } from "./pane.js";
import { picking } from "./pick.js";
import { posePanel } from "./pose.js";
import { linkTo, sharing } from "./share.js";
import { Store } from "./store.js";
import { strip } from "./strip.js";
import { whatIfCard } from "./whatif.js";
import { whichCard } from "./which.js";

// Time (ms) without a change after which the page asks for what it may need later.
const AT_REST = 1200;

// What the page is made of, each after what it follows on its side.
const PARTS = [verdictLine, additionsCard, controls, posePanel, pictureControls, deflectionPanel, enoughCard, whichCard,
  whatIfCard, compareCard, numbersPanel, matrixPanel, notesCard, modesPanel, legendBox, hands, picking, sharing,
  shortcuts, strip, guides];

function build(source) {
  const store = new Store(source, new Pane());
  const acts = {}; // of the parts, for keys
  for (const part of PARTS) Object.assign(acts, part(store, acts));
  banners(store, source);
  for (const card of document.querySelectorAll(".card:not(details, .moved-card, .notes-card)")) foldable(card);
  store.on("hello", () => source.moves || fix());
  for (const event of ["numbers", "error"]) store.on(event, () => loaded(1));
  if (source.live) ownArithmetic(store, source);
  Object.assign(window, { cartstiff: store }); // for tests, and for the curious
  source.start();
}

/** A card of which a phone shows the head alone, until it is unfolded. */
function foldable(card) {
  const fold = button("▸", () => {
    const isFolded = card.classList.toggle("folded");
    fold.textContent = isFolded ? "▸" : "▾";
    fold.setAttribute("aria-expanded", String(!isFolded));
  }, { class: "quiet fold", "aria-expanded": "false", "aria-label": "Unfold" });
  card.classList.add("folded");
  (card.querySelector(".row") ?? card).prepend(fold);
}

/** A file of one posture: what would ask for another is switched off. */
function fix() {
  const controls = "#left input, .which-card input, #left select, #left button:not(.quiet), "
    + ".matrix-card .choices input, .parts > label input, .principal-card .choice input, #map-choice select";
  for (const node of all(controls)) node.disabled = true;
  for (const node of all("#strip, .compare-card, .what-if-card, .setup-card, .posture-card "
    + ".buttons")) node.hidden = true;
}

/** Once the page has come to rest it gets the mechanism's arithmetic, and again for another frame. */
function ownArithmetic(store, source) {
  const atRest = resting();
  let of = null;
  store.on("hello", () => {
    if (of !== store.hello.mechanism.frame) [source.local, of] = [null, null];
  });
  store.on("numbers", () => atRest(() => {
    if (of !== null || source.alone) return;
    of = store.hello.mechanism.frame;
    source.bring(store).catch(() => { of = null; });
  }, AT_REST));
}

/** Errors and a lost connection, where nobody can miss them. */
function banners(store, source) {
  const banner = byId("banner");
  let lost = false;
  const show = (text, level, ...more) => {
    banner.hidden = !text;
    banner.dataset.level = level;
    banner.replaceChildren(text ?? "");
    if (text && (level === "bad" || more.length)) banner.append(" ", ...more,
      button("Dismiss", () => show(null), { class: "quiet" }));
  };
  source.onstatus = (status) => {
    if (status === "lost" && !lost) show(source.alone
      ? "The server does not answer: posture, load and springs are computed in the browser, and HTML saves this "
        + "state. The page tries again by itself …"
      : "The server does not answer. The page shows the last posture and tries again by itself …", "warning");
    if (status === "strange") {
      show("The server has been started anew: the address that it has printed lets you in again, with what is shown "
        + "here. ", "warning");
      banner.append(el("a", { href: linkTo(store) }, "Enter"));
    }
    if (status === "connected" && lost) show(null);
    lost = status !== "connected";
    store.tell("server", !lost);
    document.body.classList.toggle("lost", lost && !source.alone);
    document.body.classList.toggle("alone", lost && Boolean(source.alone));
  };
  store.on("foreign", ({ text, act: [words, act] = [] }) => show(text, "warning", words ? button(words, () => {
    show(null);
    store.remember("address");
    act();
  }) : "", " "));
  store.on("error", (text) => text === store.refused || show(text, "bad")); // a refused state is said by the verdict
  store.on("numbers", () => {
    if (!lost && !store.sticky && !banner.hidden && banner.dataset.level === "bad") show(null);
  });
  if (!source.live) byId("left").prepend(el("p.exported.dim.small", source.words));
}

async function inflate(id) {
  const text = byId(id).textContent.trim();
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function cannot({ message }) {
  byId("verdict-text").textContent = `This page needs a browser of 2023 or newer that draws in three dimensions `
    + `(${message})`;
  loaded(1);
}

async function fromFile() {
  const script = el("script");
  script.textContent = new TextDecoder().decode(await inflate("viewer"));
  document.head.append(script);
  loaded(0.5);
  const [data, commands] = unpack(await inflate("data"));
  restore(commands, data.filters);
  build(new (data.program ? ComputingSource : PostureSource)(data, commands));
}

/** From a server, which begins while the viewer is brought and the page is built.
 *
 * The viewer is imported, so that neither the page nor its load event waits for it.
 */
async function fromServer() {
  const address = new URL("socket", location.href); // beside the page, behind the same token
  address.protocol = "ws:";
  address.hash = "";
  const number = new URLSearchParams(location.search).get("mechanism");
  if (number) address.searchParams.set("mechanism", number);
  const source = new LiveSource(address.href);
  const viewer = import(new URL("viewer.js", location.href).href);
  source.connect();
  await viewer;
  // for links, which hold no secret
  Promise.resolve().then(() => localStorage.setItem("address", location.pathname)).catch(() => {});
  build(source);
}

(byId("data") ? fromFile : fromServer)().catch(cannot);
