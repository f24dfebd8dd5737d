// Written by `python tools/page_messages.py` from the models of `cartstiff.page.messages`, which
// read what a page sends: not to be changed by hand.

/** Fields of each message, by its `do`, beside those of every message: the model that a
 * field holds, the words that it may be, or null. */
export const MESSAGES = {
  draw: { towards: "Towards", lengths: null },
  numbers: {},
  result: {},
  sweep: { coordinate: null, steps: null },
  better: {},
  stiffer: { to: null },
  series: {},
  swing: { share: null },
  response: { ratio: null },
  analysis: {},
  answer: {},
  export: { address: null },
  frame: { name: null, kept: "ViewState" },
  bounds: {},
  program: {},
  slide: { name: null, value: null },
};

/** The same of each model that a message holds. */
export const FIELDS = {
  Measure: { kind: ["root", "linear", "log"], value_per_length: null, cut_at: null, zero_at: null,
    length_per_decade: null },
  ViewState: { q: null, moved: null, connection: ["load", "A", "B", "K", "F", "+"],
    quantity: ["stiffness", "compliance"], others: ["free", "held"], axes: ["body", "world"], point: null,
    stiffness: null, load: null, load_axes: ["body", "world"], load_kind: ["dead", "follower", "conservative"],
    load_at: null, gravity: null, payload: null, command: null, ghost: null, quantity_of_map: null, mode: null,
    allowed: null, measures: "Measure", theme: ["light", "dark"], translation: null, rotation: null,
    scale: ["root", "linear", "log"], labels: null, wrench: null, deflection: null, enlarged: null,
    drawn: null, centres: null },
  Towards: { pose: null, turning: null },
};

/** Fields that may not be left out. */
export const NEEDED = {
  Measure: ["kind"],
  Towards: ["pose"],
  sweep: ["coordinate"],
  stiffer: ["to"],
  frame: ["name"],
  slide: ["name", "value"],
};
