"""Steps of a source to its posture, in each language: closing a chain, deflecting links.

They are those of `cartstiff.recorded.assembly` and `closed_chains.settle` for one
posture: from the reference posture where only held coordinates differ, else from where it
is; then the links to rest under the load. A function that does not arrive says so, and
its coordinates do not count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from string import Template
from typing import Any, NamedTuple

import numpy as np

from cartstiff.core import numerics
from cartstiff.core.mechanisms.closures import LONGEST_STEP, MOST_STEPS
from cartstiff.core.potentials.contract import alike
from cartstiff.core.stiffness.settled_links import LAST, ROUNDED
from cartstiff.recorded.closed_chains import MAX_SETTLING_STEPS, STEPS
from cartstiff.recorded.plans import CLOSING, SETTLING, TracedModel, program_for
from cartstiff.recorded.tape import Program
from cartstiff.recorded.untraced import segment_program

#: Bounds of the steps.
_BOUNDS: Mapping[str, Any] = {
    "steps": STEPS,
    "tight": numerics.ATTAINABLE_PRECISION,
    "loose": numerics.ROUNDOFF,
    "smallest": numerics.SMALLEST_STEP,
    "futile": numerics.MAX_FUTILE_STEPS,
    "longest": LONGEST_STEP,
    "most": MOST_STEPS,
    "settling": MAX_SETTLING_STEPS,
    "last": LAST,
    "rounded": ROUNDED,
}


def declared(arguments: Mapping[str, int], moves: bool = False) -> str:
    """Arrays as arguments of a C function, of which the coordinates may change."""
    each = (f"const double {array}[{size}]" for array, size in arguments.items())
    text = ", ".join(each)
    return text.removeprefix("const ") if moves else text


#: Writes a program as a function with a name, of arrays with their sizes.
Write = Callable[[Program, str, Mapping[str, int]], str]


class Before(NamedTuple):
    """Steps that a posture takes before its numbers are computed.

    Attributes
    ----------
    closing : one step that closes a chain: its outputs are "next" and "left".
    settling : one step of links towards rest under a load: "settled" and "moved".
    segments : those of links, whose derivatives are inputs of the programs.
    numbers : reference posture, places of the segments, and bounds of the steps.
    """

    closing: Program | None
    settling: Program | None
    segments: Sequence[Program]
    numbers: Mapping[str, Any]

    @classmethod
    def of(cls, taken: TracedModel, n: int) -> Before:
        """Those of a mechanism with n coordinates."""
        beams, case, home = taken.untraced.beams, taken.case, taken.home
        groups = list(alike(beams))
        kinds = {id(beam): k for k, group in enumerate(groups) for beam in group}
        segments = [(kinds[id(beam)], row) for beam in beams for row in beam.indices]
        # Coordinates that are not held have no size.
        q, sizes = np.zeros(n), np.zeros(n)
        if home is not None:
            q, held = home.q, list(home.held)
            sizes[held] = home.lengths[held]
        numbers = {
            "n": n,
            "home": q.tolist(),
            "sizes": sizes.tolist(),
            "kinds": [k for k, _ in segments],
            "at": [row.tolist() for _, row in segments],
            "count": len(segments),
            "room": max(1, len(segments)),
        }
        return cls(
            program_for(case, CLOSING) if taken.is_closed else None,
            program_for(case, SETTLING) if taken.settles else None,
            [segment_program(group[0].length, group[0].section) for group in groups],
            {**_BOUNDS, **numbers},
        )

    @property
    def moves(self) -> bool:
        """Whether the coordinates change."""
        return self.closing is not None or self.settling is not None

    @property
    def terms(self) -> dict[str, int]:
        """Inputs that links determine, and their sizes: of one segment at least, as C
        has no empty arrays.
        """
        if not self.segments and self.settling is None:
            return {}
        m = self.numbers["room"]
        return {"energies": 1, "segment_gradients": 6 * m, "segment_hessians": 36 * m}

    def text(
        self, language: str, name: str, arguments: Mapping[str, int], write: Write
    ) -> list[str]:
        """The steps in a language.

        Parameters
        ----------
        language : {"c", "jax", "python", "javascript"}
        name : str
            Of the source's function, which those of the steps begin with.
        arguments : mapping of str to int
            Those of the source's function, with their sizes.
        write : callable
            Writes a program as a function of arrays (name, arguments) of all outputs.
        """
        closing, terms, settling = _TEXTS[language]
        names = [f"{name}_segment{k}" for k in range(len(self.segments))]
        words = {
            **self.numbers,
            "name": name,
            "arguments": ", ".join(arguments),
            "declared": declared(arguments, moves=True),
            "segments": f"[{', '.join(names)}]",
        }
        if language == "c":
            braces = str.maketrans("[]", "{}")
            lists = ("home", "sizes", "kinds", "at", "segments")
            words |= {w: str(words[w] or [0]).translate(braces) for w in lists}

        def filled(text: str) -> str:
            return Template(text).substitute(words)

        # A function stands before those that call it.
        parts = list[str]()
        each = zip(self.segments, names, strict=True)
        parts += [write(one, own, {"x": 6}) for one, own in each]
        if self.terms:
            parts.append(filled(terms))
        if self.closing is not None:
            q = {"q": arguments["q"]}
            parts += [write(self.closing, f"{name}_step", q), filled(closing)]
        if self.settling is not None:
            every = {**arguments, **self.terms}
            parts += [write(self.settling, f"{name}_bend", every), filled(settling)]
        return parts


_PYTHON = (
    """
def ${name}_near(q):
    size = best = inf
    futile = 0
    for _ in range($steps):
        before, found = size, ${name}_step(q)
        size, step, length, doubt = found[$n:]
        unit = max(1.0, length)
        small = size > 0.1 * before or step <= $smallest
        if size <= $tight * unit or (size <= $loose * unit and small):
            return q
        futile = 0 if size < 0.9 * best else futile + 1
        best = min(best, size)
        vain = futile >= $futile and step < $longest
        if doubt != 0.0 or not step < inf or vain:
            break
        q = found[:$n]
    raise ArithmeticError("these steps do not close the chain")


def ${name}_close(q):
    home, sizes, steps = $home, $sizes, 1
    far = max(abs(a - b) / s if s else 0.0 for a, b, s in zip(q, home, sizes))
    alike = all(a == b for a, b, s in zip(q, home, sizes) if not s)
    if alike and $longest < far <= $most * $longest:
        steps = ceil(far / $longest)
    at = home if steps > 1 else q
    for k in range(1, steps + 1):
        part = k / steps
        ahead = [b + (a - b) * part if k < steps else a for a, b in zip(q, home)]
        at = ${name}_near([a if s else b for a, b, s in zip(ahead, at, sizes)])
    return at

""",
    """
def ${name}_terms(q):
    energy, gradients, hessians = 0.0, [], []
    for kind, at in zip($kinds, $at):
        found = $segments[kind]([q[i] for i in at])
        if found[28] != 0.0:
            raise ArithmeticError("a link bends too far")
        energy += found[0]
        gradients += found[1:7]
        rows = [(max(i, j), min(i, j)) for i in range(6) for j in range(6)]
        hessians += [found[7 + i * (i + 1) // 2 + j] for i, j in rows]
    return [energy], gradients, hessians

""",
    """
def ${name}_settle($arguments):
    for _ in range($settling):
        found = ${name}_bend($arguments, *${name}_terms(q))
        q, (moved, doubt) = found[:$n], found[$n:]
        if doubt != 0.0 or not moved < inf:
            break
        if moved <= $last:
            return q
    if doubt == 0.0 and moved <= $rounded:
        return q
    raise ArithmeticError("the links do not come to rest")

""",
)

_JAVASCRIPT = (
    """
function ${name}_near(q) {
  let size = Infinity, best = Infinity, futile = 0;
  for (let steps = 0; steps < $steps; steps++) {
    const before = size, found = ${name}_step(q);
    const [left, step, length, doubt] = found.slice($n), unit = Math.max(1, length);
    size = left;
    if (size <= $tight * unit
      || (size <= $loose * unit && (size > 0.1 * before || step <= $smallest))) return q;
    futile = size < 0.9 * best ? 0 : futile + 1;
    best = Math.min(best, size);
    if (doubt !== 0 || !(step < Infinity)) return null;
    if (futile >= $futile && step < $longest) return null;
    q = found.slice(0, $n);
  }
  return null;
}
function ${name}_close(q) {
  const home = $home, sizes = $sizes;
  const away = q.map((x, i) => (sizes[i] ? Math.abs(x - home[i]) / sizes[i] : 0));
  const far = Math.max(...away);
  const alike = q.every((x, i) => sizes[i] || x === home[i]);
  const is_led = alike && far > $longest && far <= $most * $longest;
  const steps = is_led ? Math.ceil(far / $longest) : 1;
  let at = is_led ? home : q;
  for (let k = 1; k <= steps && at; k++) {
    const part = k / steps, last = k === steps;
    at = ${name}_near(at.map((x, i) => {
      if (!sizes[i]) return x;
      return last ? q[i] : home[i] + (q[i] - home[i]) * part;
    }));
  }
  return at;
}
""",
    """
function ${name}_terms(q) {
  const segments = $segments, kinds = $kinds;
  const gradients = [], hessians = [];
  let energy = 0;
  for (const [i, at] of $at.entries()) {
    const found = segments[kinds[i]](at.map((j) => q[j]));
    if (found[28] !== 0) return null;
    energy += found[0];
    gradients.push(...found.slice(1, 7));
    for (let a = 0; a < 6; a++) for (let b = 0; b < 6; b++) {
      const row = Math.max(a, b);
      hessians.push(found[7 + (row * (row + 1)) / 2 + Math.min(a, b)]);
    }
  }
  return [[energy], gradients, hessians];
}
""",
    """
function ${name}_settle($arguments) {
  let moved = Infinity;
  for (let steps = 0; steps < $settling; steps++) {
    const terms = ${name}_terms(q), found = terms && ${name}_bend($arguments, ...terms);
    if (!found || found[$n + 1] !== 0 || !(found[$n] < Infinity)) return null;
    moved = found[$n];
    q = found.slice(0, $n);
    if (moved <= $last) return q;
  }
  return moved <= $rounded ? q : null;
}
""",
)

_C = (
    """
/* Closes the chain near q, in place; 1 where these steps do not close it. */
static int ${name}_near(double q[$n])
{
  double out[$n + 4], size = INFINITY, best = INFINITY;
  int i, steps, futile = 0;
  for (steps = 0; steps < $steps; steps++) {
    const double before = size;
    double unit, step;
    ${name}_step(q, out);
    size = out[$n];
    step = out[$n + 1];
    unit = out[$n + 2] > 1.0 ? out[$n + 2] : 1.0;
    if (size <= $tight * unit) return 0;
    if (size <= $loose * unit && (size > 0.1 * before || step <= $smallest)) return 0;
    futile = size < 0.9 * best ? 0 : futile + 1;
    best = size < best ? size : best;
    if (out[$n + 3] != 0.0 || !(step < INFINITY)) return 1;
    if (futile >= $futile && step < $longest) return 1;
    for (i = 0; i < $n; i++) q[i] = out[i];
  }
  return 1;
}

/* The same, led from the reference posture where only held coordinates differ. */
static int ${name}_close(double q[$n])
{
  static const double home[$n] = $home;
  static const double sizes[$n] = $sizes;
  double at[$n], far = 0.0;
  int i, k, steps = 1, alike = 1;
  for (i = 0; i < $n; i++) {
    if (sizes[i] > 0.0) far = larger(far, fabs(q[i] - home[i]) / sizes[i]);
    else if (q[i] != home[i]) alike = 0;
  }
  if (alike && far > $longest && far <= $most * $longest)
    steps = (int)ceil(far / $longest);
  for (i = 0; i < $n; i++) at[i] = steps > 1 ? home[i] : q[i];
  for (k = 1; k <= steps; k++) {
    const double part = (double)k / steps;
    for (i = 0; i < $n; i++)
      if (sizes[i] > 0.0) at[i] = k < steps ? home[i] + (q[i] - home[i]) * part : q[i];
    if (${name}_near(at)) return 1;
  }
  for (i = 0; i < $n; i++) q[i] = at[i];
  return 0;
}
""",
    """
/* Derivatives of the energy of the links; 1 where one bends too far. */
static int ${name}_terms(const double q[$n], double energies[1],
                         double segment_gradients[6 * $room],
                         double segment_hessians[36 * $room])
{
  static void (*const segments[])(const double *, double *) = $segments;
  static const int kinds[$room] = $kinds, at[$room][6] = $at;
  int i, a, b;
  energies[0] = 0.0;
  for (i = 0; i < $count; i++) {
    double x[6], out[29];
    const double *entry = out + 7;
    for (a = 0; a < 6; a++) x[a] = q[at[i][a]];
    segments[kinds[i]](x, out);
    if (out[28] != 0.0) return 1;
    energies[0] += out[0];
    for (a = 0; a < 6; a++) {
      segment_gradients[6*i + a] = out[1 + a];
      for (b = 0; b <= a; b++, entry++)
        segment_hessians[36*i + 6*a + b] = segment_hessians[36*i + 6*b + a] = *entry;
    }
  }
  return 0;
}
""",
    """
/* Moves the links to rest under the load, from q, in place; 1 where they do not. */
static int ${name}_settle($declared)
{
  double energies[1], segment_gradients[6 * $room], segment_hessians[36 * $room];
  double out[$n + 2], moved = INFINITY;
  int i, steps;
  for (steps = 0; steps < $settling; steps++) {
    if (${name}_terms(q, energies, segment_gradients, segment_hessians)) return 1;
    ${name}_bend($arguments, energies, segment_gradients, segment_hessians, out);
    moved = out[$n];
    if (out[$n + 1] != 0.0 || !(moved < INFINITY)) return 1;
    for (i = 0; i < $n; i++) q[i] = out[i];
    if (moved <= $last) return 0;
  }
  return !(moved <= $rounded);
}
""",
)

_JAX = (
    """

def ${name}_near(q):
    def step(state):
        q, before, best, futile, taken, _, _ = state
        found = ${name}_step({"q": q})
        size, step, length, doubt = found[$n:]
        unit = jnp.maximum(1.0, length)
        small = (size > 0.1 * before) | (step <= $smallest)
        is_shut = (size <= $tight * unit) | ((size <= $loose * unit) & small)
        futile = jnp.where(size < 0.9 * best, 0, futile + 1)
        vain = (doubt != 0.0) | ((futile >= $futile) & (step < $longest))
        goes_on = ~is_shut & ~vain & (step < jnp.inf) & (taken < $steps)
        q = jnp.where(goes_on, found[:$n], q)
        return q, size, jnp.minimum(best, size), futile, taken + 1, goes_on, is_shut

    start = q, jnp.inf, jnp.inf, 0, 1, True, False
    found = jax.lax.while_loop(lambda state: state[5], step, start)
    return found[0], found[6]


def ${name}_close(q):
    home, sizes = np.array($home), np.array($sizes)
    held = sizes > 0.0
    away = jnp.abs(q - home) / np.where(held, sizes, 1.0)
    far = jnp.max(jnp.where(held, away, 0.0))
    alike = jnp.all(held | (q == home))
    is_led = alike & (far > $longest) & (far <= $most * $longest)
    steps = jnp.where(is_led, jnp.ceil(far / $longest), 1.0)

    def lead(state):
        k, at, _ = state
        ahead = jnp.where(k < steps, home + (q - home) * (k / steps), q)
        return k + 1.0, *${name}_near(jnp.where(held, ahead, at))

    start = 1.0, jnp.where(is_led, home, q), True
    goes_on = lambda state: (state[0] <= steps) & state[2]
    return jax.lax.while_loop(goes_on, lead, start)[1:]


""",
    """

def ${name}_terms(q):
    kinds, at = np.array($kinds), np.array($at)
    energy, plain = 0.0, True
    gradients, hessians = jnp.zeros((len(at), 6)), jnp.zeros((len(at), 36))
    row, column = np.indices((6, 6)).reshape(2, -1)
    row, column = np.maximum(row, column), np.minimum(row, column)
    lower = 7 + row * (row + 1) // 2 + column
    for kind, segment in enumerate($segments):
        own = np.flatnonzero(kinds == kind)
        found = jax.vmap(lambda x: segment({"x": x}))(q[at[own]])
        energy += found[:, 0].sum()
        gradients = gradients.at[own].set(found[:, 1:7])
        hessians = hessians.at[own].set(found[:, lower])
        plain &= (found[:, 28] == 0.0).all()
    energies = jnp.reshape(energy, 1)
    terms = {"energies": energies, "segment_gradients": gradients}
    return {**terms, "segment_hessians": hessians}, plain


""",
    """

def ${name}_settle(given):
    def step(state):
        q, taken, _, _ = state
        terms, plain = ${name}_terms(q)
        found = ${name}_bend({**given, **terms, "q": q})
        moved = found[$n]
        plain = plain & (found[$n + 1] == 0.0) & (moved < jnp.inf)
        goes_on = plain & (moved > $last) & (taken < $settling)
        at_rest = plain & (moved <= $rounded) & ~goes_on
        return jnp.where(plain, found[:$n], q), taken + 1, goes_on, at_rest

    start = given["q"], 1, True, False
    found = jax.lax.while_loop(lambda state: state[2], step, start)
    return found[0], found[3]


""",
)

_TEXTS = {"c": _C, "jax": _JAX, "python": _PYTHON, "javascript": _JAVASCRIPT}
