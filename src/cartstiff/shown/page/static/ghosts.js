// What is added to a picture here: the mechanism a second time, in one colour: where it would be without the load
// ("rest"), and at a state that was
// kept ("ghost"). The places come with a picture; what stands there is copied here.

import { hues } from "./dom.js";
import { LOST_ERROR, NEGLIGIBLE_DIFFERENCE } from "./numerics.js";

const GHOSTS = { rest: 0.45, ghost: 0.22 };

/** Pairs [copy, original] of places below two others that have the same names. */
function* pairs(copy, original) {
  for (const [name, own] of Object.entries(copy.children)) {
    const twin = original.children[name];
    if (!twin || name === "<object>") continue;
    if (Object.keys(own.children).some((one) => one !== "<object>")) yield* pairs(own, twin);
    else yield [own.object, twin.object];
  }
}

/** The same of a picture's ghost; none where it is not shown. */
export function pairsOf(pane, name) {
  const [copy, original] = [name, "mechanism"].map((one) => pane.branch(one));
  return copy?.object.visible && original ? [...pairs(copy, original)] : [];
}

const isSame = (a, b) => a.elements.every((x, k) => Math.abs(x - b.elements[k]) < LOST_ERROR);

/** Copy what is missing at the places of ghosts, and show copies only where the original is elsewhere. */
export function haunt(pane) {
  for (const [name, opacity] of Object.entries(GHOSTS)) {
    for (const [copy, original] of pairsOf(pane, name)) {
      const of = original.children.map(({ uuid }) => uuid).join();
      if (copy.userData.of !== of) {
        copy.clear();
        for (const child of original.children) copy.add(child.clone(true));
        const material = materialOf(pane, name, opacity);
        copy.traverse((node) => { if (node.isMesh) node.material = material; });
        copy.userData.of = of;
      }
      copy.updateMatrix();
      original.updateMatrix();
      copy.visible = !isSame(copy.matrix, original.matrix);
    }
  }
}

function materialOf(pane, name, opacity) {
  pane.ghostly ??= {};
  return pane.ghostly[name] ??= new MeshCat.THREE.MeshPhongMaterial({ color: hues(name)[0], opacity, transparent: true,
    depthWrite: false, side: MeshCat.THREE.DoubleSide });
}

// Length and radius of the heads of principal axes, over the mechanism's size.
const [HEAD_LENGTH, HEAD_RADIUS] = [0.032, 0.011];

/** Make double arrows of the principal axes: a head at each end, whatever the length between. */
export function sharpen(pane) {
  const { Mesh, ConeGeometry } = MeshCat.THREE;
  const { extent } = pane;
  const looks = ["translation", "rotation"].flatMap((freedom) =>
    Object.values(pane.branch(`${freedom} ellipsoid`)?.children ?? {}));
  for (const { children } of looks) for (const i of [1, 2, 3]) {
    const axis = children?.[`axis ${i}`];
    const rod = axis?.children.plus?.children["<object>"]?.object;
    if (!rod?.isMesh || !axis.object.visible) continue;
    rod.userData.heads ??= [1, -1].map((side) => {
      const head = new Mesh(new ConeGeometry(1, 1, 16).translate(0, -0.5, 0).rotateZ((-side * Math.PI) / 2),
        rod.material);
      axis.children.plus.object.add(head);
      return head;
    });
    const length = Math.max(axis.object.scale.x, NEGLIGIBLE_DIFFERENCE);
    rod.userData.heads.forEach((head, k) => {
      head.position.set(k ? 0 : 1, 0, 0);
      head.scale.set(Math.min(HEAD_LENGTH * extent, 0.4 * length) / length, HEAD_RADIUS * extent, HEAD_RADIUS * extent);
    });
  }
}
