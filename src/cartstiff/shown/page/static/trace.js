// The way of M along the plot, in the picture: in the colours of what is plotted, bright is good; its worst place is
// named.

import { bright, goodness, isOutside } from "./bright.js";
import { checkbox, engineering, evenly, hues, rgbs } from "./dom.js";
import { both } from "./shapes.js";

// Thickness of the way, and of the ball at its worst place, over the mechanism's size.
const [WAY_THICK, WAY_BALL] = [0.006, 0.014];
const WAY_SIDES = 8;
const WAY_STOPS = 9;
// Height of letters where the picture is one unit away.
const WAY_LETTERS = 0.028;

/** Runs of rows that are reached, one after the other. */
function runsOf(rows) {
  const runs = [[]];
  for (const row of rows) {
    if (row.position) runs.at(-1).push(row);
    else if (runs.at(-1).length) runs.push([]);
  }
  return runs.filter((run) => run.length > 1);
}

/** What shows rows, or with null nothing; and a box that says whether it is wished. */
export function traceOf(store, onchange) {
  const { THREE } = MeshCat;
  const group = new THREE.Group();
  const box = checkbox("Way along the plot", onchange,
    { title: "The way of M along the plot, in the colours of its values" });
  let named = null; // the words at the worst place, and where that is

  /** A tube through places, each with its colour. */
  function tube(rows, colours, radius) {
    const places = rows.map(({ position }) => new THREE.Vector3(...position));
    if (!places.some((place) => place.distanceTo(places[0]) > radius)) return null; // it stays where it is
    const curve = new THREE.Curve();
    curve.getPoint = (t, target = new THREE.Vector3()) => {
      const at = Math.min(t * (places.length - 1), places.length - 1);
      const low = Math.min(Math.floor(at), places.length - 2);
      return target.lerpVectors(places[low], places[low + 1], at - low);
    };
    curve.getUtoTmapping = (u) => u;
    const geometry = new THREE.TubeGeometry(curve, places.length - 1, radius, WAY_SIDES);
    geometry.setAttribute("color", new THREE.Float32BufferAttribute(colours.flatMap((colour) =>
      Array.from({ length: WAY_SIDES + 1 }, () => colour.map((c) => c / 255)).flat()), 3));
    return geometry;
  }

  const add = (geometry, colour = null) => group.add(...both(geometry, colour, 0.4));

  function show(rows, found, allowed) {
    for (const { geometry, material } of group.children) [geometry, material].forEach((one) => one.dispose());
    group.clear();
    named = null;
    const good = rows && store.legend ? goodness(found, rows, allowed) : null;
    store.trace = good && facts(good, found, rows, allowed);
    if (good) draw(good, found, rows);
    store.tell("trace");
    store.pane.viewer.set_dirty();
  }

  function draw(good, found, rows) {
    const { size } = store.legend;
    const [none] = rgbs("rest");
    const colour = (row) => (good.value(row) === null ? none : bright(good.share(row)));
    for (const run of runsOf(rows)) {
      const geometry = tube(run, run.map(colour), WAY_THICK * size);
      if (geometry) add(geometry);
    }
    if (!group.children.length) return;
    const { worst } = good;
    add(new THREE.SphereGeometry(WAY_BALL * size, 16, 12).translate(...worst.position), hues("negative")[0]);
    const [x, y, z] = worst.position;
    named = { at: new THREE.Vector3(x, y, z + 3 * WAY_BALL * size), height: WAY_LETTERS / store.legend.per_length,
      text: `worst ${engineering(good.value(worst), found.unit === "1" ? "" : found.unit, 3)}`, hue: "negative" };
  }

  /** What the colours say, as a map's bar has it. */
  function facts({ value, worst, best, low, high, isLog }, found, rows, allowed) {
    const label = `${found.called} along the way`;
    const colours = (list) => list.map((share) => `rgb(${bright(share).map(Math.round).join(" ")})`);
    if (allowed) {
      const reached = rows.filter(({ q }) => q);
      const [outside, inside] = [true, false].map((is) => reached.filter((row) => isOutside(row, allowed) === is));
      const limit = engineering(allowed, store.unit("length"), 3);
      const [dark, light] = colours([0.1, 0.9]);
      return { label, count: rows.length, kinds: [{ name: `within ${limit}`, count: inside.length, colour: light },
        { name: `beyond ${limit}`, count: outside.length, colour: dark }] };
    }
    const ends = value(best) >= value(worst) ? [0, 1] : [1, 0];
    return { label, better: true, unit: found.unit === "1" ? "" : found.unit, lower: low, upper: high, log: isLog,
      stops: colours(evenly(...ends, WAY_STOPS)) };
  }

  // A new picture begins without it.
  store.pane.before.push(() => {
    const place = store.pane.at("trace");
    if (group.parent !== place) place.add(group);
    store.pane.caption(["trace", "worst"], named);
  });
  return { show, box };
}
