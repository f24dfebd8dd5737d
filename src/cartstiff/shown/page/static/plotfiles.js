// A plot as a file: SVG, PNG of one to four times its size, CSV; each says what it shows and of what.

import { download, dropdown, toast } from "./dom.js";
import { askPrint } from "./print.js";

const SVG_SPACE = "http://www.w3.org/2000/svg";
// What a style sheet says of a line or a word, which a file must say itself.
const OWN = ["fill", "stroke", "stroke-width", "stroke-dasharray", "opacity", "font-size", "font-family", "font-weight",
  "paint-order"];
const ROW = 14;
// Pictures in print: dots per inch, and the height (mm) of a row of letters, about 7 points.
const DPI = 300;
const PRINTED_ROW = 3;
const MM_PER_INCH = 25.4;
// Dots that a plot needs at least, however narrow it is in print.
const LEAST_WIDTH = 240;
/**
 * Kinds of files for print: a column, a page, and what is asked for. Of a kind the words behind its width say what it
 * lacks: "clear" the ground, "bare" the caption, "alone" the other pictures.
 */
const PRINTED = [["mm85", "PNG, 85 mm at 300 dpi"], ["mm180", "PNG, 180 mm at 300 dpi"],
  ["print", "for print …"]];
// Width of a letter below a drawing, and of one in it, about.
export const [LETTER, WIDE_LETTER] = [6, 7];

/** Springs of a state that nobody measured, by kind, in words: those that were replaced are no longer among them. */
export function doubts({ hello: { mechanism } }, { stiffness }) {
  const { springs, is_illustrative: isIllustrative } = mechanism;
  const own = springs.filter(({ stiffness: k }, i) => !stiffness || stiffness[i] === k);
  const sprung = springs.filter(({ stiffness: k }) => k !== 0).length;
  const called = mechanism.called === "cable robot" ? "Cables" : "Springs";
  const words = { assumed: "assumed", illustrative: "illustrative, not measured" };
  const found = Object.keys(words).flatMap((kind) => {
    const count = own.filter(({ doubt }) => doubt === kind).length;
    return count ? [{ kind, words: count < sprung ? `${count} of ${sprung} ${called.toLowerCase()} ${words[kind]}`
      : `${called} ${words[kind]}` }] : [];
  });
  // Springs besides those that can be replaced here.
  const others = isIllustrative && !springs.some(({ doubt }) => doubt === "illustrative");
  return others ? [...found, { kind: "illustrative", words: `${called} ${words.illustrative}` }] : found;
}

/** What a plot is of: mechanism, state and program, in lines. */
export function provenance(store, state, title) {
  const { hello } = store;
  const { mechanism } = hello;
  const q = mechanism.coordinates.map(({ name }, i) => `${name}=${state.q[i].toPrecision(6)}`).join(" ");
  const { load, load_at: at, stiffness, gravity, payload, command } = state;
  const list = (values) => `(${values.map((x) => x ?? "rigid").join(", ")})`;
  const axes = (of) => `${of === "body" ? "tool" : "room"} axes`;
  return [
    title,
    [`${mechanism.name}, frame ${mechanism.frame}, point ${list(state.point)}, ${axes(state.axes)}, connection `
      + `${state.connection}`,
      load && `load ${list(load)} ${state.load_kind}, ${axes(state.load_axes)}, at ${at ? `${list(at)} in M`
        : "the point"}`,
      gravity && `gravity ${list(gravity)}`, payload && `payload ${payload[0]} kg at ${list(payload.slice(1))}`,
      stiffness && `springs ${list(stiffness)}`, command && `drives commanded by ${list(command)}`].filter(Boolean)
        .join(", "),
    `posture ${q}`,
    ...doubts(store, state).map(({ words }) => words),
    `cartstiff ${hello.version}`,
  ];
}

export function svg(tag, attributes = {}, ...children) {
  const node = document.createElementNS(SVG_SPACE, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

/** A text in lines of at most so many letters. */
export const wrapped = (text, most) => text.match(new RegExp(`.{1,${most}}(?:\\s|$)|\\S{${most}}`, "g"))
  .map((line) => line.trim());

/** The width (mm) of a kind of file for print; null for another. */
export const printed = (kind) => Number(kind.match(/^(?:mm|svg)([\d.]+)/)?.[1]) || null;

/** How many times as large letters are as on the page: in print they are legible. */
export const legible = (kind, width) => (printed(kind)
  ? Math.max(1, (PRINTED_ROW * width) / printed(kind) / ROW) : 1);

/** How many times as fine as the page a file of some kind is. */
export const timesOf = (kind, width) => (printed(kind) ? (printed(kind) * DPI) / MM_PER_INCH / width
  : Number(kind.slice(3)));

/** A drawing of its own: an SVG with words below, each a text or {text, colour}; in print they are legible. */
export function sheet(copy, { width, height, ink, paper, kind = "svg" }, words) {
  const letters = legible(kind, width);
  const rows = words.flatMap((word) => wrapped(word.text ?? word, Math.floor((width - 12) / LETTER / letters))
    .map((text) => [text, word.colour ?? ink]));
  const total = height + (rows.length ? letters * ROW * (rows.length + 0.6) : 0);
  if (!kind.includes("clear")) copy.prepend(svg("rect", { width, height: total, fill: paper }));
  rows.forEach(([text, fill], i) => copy.append(svg("text", { x: 6, y: height + letters * ROW * (i + 1),
    "font-size": 10.5 * letters, "font-family": "sans-serif", fill }, text)));
  const size = (x) => (/^svg[\d.]/.test(kind) ? `${(x * printed(kind)) / width}mm` : x);
  for (const [name, value] of Object.entries({ xmlns: SVG_SPACE, width: size(width), height: size(total),
    viewBox: `0 0 ${width} ${total}` })) copy.setAttribute(name, value);
  return { text: `<?xml version="1.0"?>\n${new XMLSerializer().serializeToString(copy)}\n`, width, height: total };
}

/** A plot on the page as a drawing of its own, what it shows below; in print it is laid out for the width on paper. */
function drawing(plot, lines, legend, kind) {
  const { node: shown, width: wide, height: high } = plot;
  const width = printed(kind) ? Math.max(LEAST_WIDTH, (ROW * printed(kind)) / PRINTED_ROW) : wide;
  const height = high * Math.max(1, width / wide);
  Object.assign(plot, { width, height }).draw();
  const copy = shown.cloneNode(true);
  const [from, to] = [shown, copy].map((node) => [...node.querySelectorAll("*")]);
  from.forEach((node, i) => {
    const style = getComputedStyle(node);
    to[i].setAttribute("style", OWN.map((name) => `${name}:${style.getPropertyValue(name)}`).join(";"));
  });
  Object.assign(plot, { width: wide, height: high }).draw();
  copy.removeAttribute("class");
  const [ink, paper] = [getComputedStyle(shown).color, getComputedStyle(shown.parentElement).backgroundColor];
  // In print a caption: what it is of, and what is assumed.
  const [title, subject, , ...rest] = lines;
  const words = kind.includes("bare") ? [] : printed(kind) ? [title, subject, ...rest.slice(0, -1)]
    : [title, ...legend, ...lines.slice(1)];
  return sheet(copy, { width, height, ink, paper, kind }, words);
}

/**
 * Words that no spreadsheet runs: an apostrophe before = + - @ where a cell may begin, unless a plain number follows.
 */
export const safeCell = (text) => text.replace(/\s+/g, " ")
  .replace(/(^|[,;])(\s*)(?=[=@+-].)(?=[=@]|[+-](?![\d.]+(?:[eE][+-]?\d+)?\)?(?:[\s,;]|$)))/g, "$1$2'");

/** Rows of numbers, every digit, under comments and a line of names. */
export function table(lines, names, rows) {
  const words = (text) => (/[",;]/.test(text) ? `"${safeCell(text).replaceAll('"', '""')}"` : safeCell(text));
  const cell = (x) => (x === null || x === undefined ? "" : typeof x === "string" ? words(x) : String(x));
  return [...lines.map((line) => `# ${safeCell(line)}`), names.map(words).join(","),
    ...rows.map((row) => row.map(cell).join(","))].join("\n") + "\n";
}

/** A list of kinds of files, which saves one of them; `asks`: what is asked of one for print. */
export function saveList(what, kinds, save, title, asks) {
  const node = dropdown(`Save the ${what}`, [...kinds, ...PRINTED], (kind) => {
    node.value = "";
    if (kind === "print") askPrint(`The ${what} for print`, save, asks());
    else if (kind) save(kind);
  }, { class: "save", title });
  return node;
}

/** A plot as a file of a kind: its rows under names, with why a value is missing, or what is drawn. */
export function savePlot(kind, name, plot, { lines, legend, names, rows }) {
  if (kind !== "csv") return saveDrawing(kind, name, drawing(plot, lines, legend, kind));
  download(`${name}.csv`, table(lines, [...names, "why there is no value"], rows), "text/csv");
}

export async function saveDrawing(kind, name, { text, width, height }) {
  if (kind.startsWith("svg")) return download(`${name}.svg`, text, "image/svg+xml");
  const times = timesOf(kind, width);
  const image = new Image();
  image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
  const isDrawn = await image.decode().then(() => true, () => false);
  if (!isDrawn) return toast("This browser does not draw the plot as a picture; SVG holds it");
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [Math.round(times * width), Math.round(times * height)];
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  canvas.toBlob((blob) => download(`${name}.png`, printed(kind) ? inPrint(blob) : blob), "image/png");
}

/** The part "pHYs" of a PNG for DPI: 11811 (0x2e23) dots a metre across and up, with the checksum of these bytes. */
const DOTS = Uint8Array.of(0, 0, 0, 9, 0x70, 0x48, 0x59, 0x73, 0, 0, 0x2e, 0x23, 0, 0, 0x2e, 0x23, 1, 0x78, 0xa5, 0x3f,
  0x76);

/** A PNG that says how many dots an inch has: behind its first part, which takes 33 bytes. */
const inPrint = (blob) => new Blob([blob.slice(0, 33), DOTS, blob.slice(33)], { type: "image/png" });
