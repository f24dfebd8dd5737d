// Written by `python tools/page_messages.py` from the models of `cartstiff.page.messages`, which
// read what a page sends: not to be changed by hand.

/**
 * @typedef {object} Measure How large values are drawn, as `cartstiff.scene.scales` says it in a legend.
 * @property {"root" | "linear" | "log"} kind
 * @property {number | null} [value_per_length]
 * @property {number | null} [cut_at]
 * @property {number | null} [zero_at]
 * @property {number | null} [length_per_decade]
 */
/**
 * @typedef {object} ViewState Everything that decides what a tab shows; the default is what it shows at first.
 * @property {number[] | null} [q]
 * @property {number | null} [moved]
 * @property {"load" | "A" | "B" | "K" | "F" | "+"} [connection]
 * @property {"stiffness" | "compliance"} [quantity]
 * @property {"free" | "held"} [others]
 * @property {"body" | "world"} [axes]
 * @property {[number, number, number]} [point]
 * @property {(number | null)[] | null} [stiffness]
 * @property {[number, number, number, number, number, number] | null} [load]
 * @property {"body" | "world"} [load_axes]
 * @property {"dead" | "follower" | "conservative"} [load_kind]
 * @property {[number, number, number] | null} [load_at]
 * @property {[number, number, number] | null} [gravity]
 * @property {[number, number, number, number] | null} [payload]
 * @property {number[] | null} [command]
 * @property {number[] | null} [ghost]
 * @property {string | null} [quantity_of_map]
 * @property {number | null} [mode]
 * @property {number | null} [allowed]
 * @property {Record<"translation" | "rotation", Measure> | null} [measures]
 * @property {"light" | "dark"} [theme]
 * @property {boolean} [translation]
 * @property {boolean} [rotation]
 * @property {"root" | "linear" | "log"} [scale]
 * @property {boolean} [labels]
 * @property {boolean} [wrench]
 * @property {boolean} [deflection]
 * @property {number | null} [enlarged]
 * @property {"stiffness" | "compliance" | null} [drawn]
 * @property {boolean} [centres]
 */
/**
 * @typedef {object} Towards A pose that a hand pulls M to, ``T_F_M``, and whether it turns M as well.
 * @property {[[number, number, number, number], [number, number, number, number], [number, number, number,
 *   number], [number, number, number, number]]} pose
 * @property {boolean} [turning]
 */
/**
 * @typedef {object} Draw The numbers and the picture of a state; of the posture that follows a hand,
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"draw"} do
 * @property {Towards | null} [towards]
 * @property {number[] | null} [lengths]
 */
/**
 * @typedef {object} Numbers The numbers of a state alone: the picture stays.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"numbers"} do
 */
/**
 * @typedef {object} Result All that `analyse` says of a state, as JSON.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"result"} do
 */
/**
 * @typedef {object} Sweep Principal values while one coordinate runs through its range.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"sweep"} do
 * @property {number} coordinate
 * @property {number} [steps]
 */
/**
 * @typedef {object} Better A better posture under the load of the state, as the report has it.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"better"} do
 */
/**
 * @typedef {object} WhatIf How far the load moves the point with another stiffness of one spring,
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"stiffer"} do
 * @property {(number | null)[]} to
 */
/**
 * @typedef {object} Series Principal values along the trajectory that the page was started with.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"series"} do
 */
/**
 * @typedef {object} Swing Pictures along the swing of the mode that the state names.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"swing"} do
 * @property {number} [share]
 */
/**
 * @typedef {object} Response Receptance at the reference point over frequency, all modes damped by one ratio.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"response"} do
 * @property {number} [ratio]
 */
/**
 * @typedef {object} Analysis The analysis of the matrix, as text.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"analysis"} do
 */
/**
 * @typedef {object} Said The answer at a posture in sentences, its displacement checked by the
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"answer"} do
 */
/**
 * @typedef {object} Export The page at this state as one file.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"export"} do
 * @property {string | null} [address]
 */
/**
 * @typedef {object} Frame Another frame of the mechanism as the frame of interest; `kept` states go along.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"frame"} do
 * @property {string} name
 * @property {ViewState[]} [kept]
 */
/**
 * @typedef {object} Bounds How much room the picture of a state takes.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"bounds"} do
 */
/**
 * @typedef {object} Program The arithmetic of the mechanism, for the page itself.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"program"} do
 */
/**
 * @typedef {object} Slide A slider that the user's code has added is somewhere else.
 * @property {number} id
 * @property {ViewState} [state]
 * @property {"slide"} do
 * @property {string} name
 * @property {number} value
 */
/** Model of each message, by its `do`. */
export const MESSAGES = {
  draw: "Draw",
  numbers: "Numbers",
  result: "Result",
  sweep: "Sweep",
  better: "Better",
  stiffer: "WhatIf",
  series: "Series",
  swing: "Swing",
  response: "Response",
  analysis: "Analysis",
  answer: "Said",
  export: "Export",
  frame: "Frame",
  bounds: "Bounds",
  program: "Program",
  slide: "Slide",
};

/** Fields of each model: their model, the words that they may be, or null. */
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
  Draw: { id: null, state: "ViewState", do: ["draw"], towards: "Towards", lengths: null },
  Numbers: { id: null, state: "ViewState", do: ["numbers"] },
  Result: { id: null, state: "ViewState", do: ["result"] },
  Sweep: { id: null, state: "ViewState", do: ["sweep"], coordinate: null, steps: null },
  Better: { id: null, state: "ViewState", do: ["better"] },
  WhatIf: { id: null, state: "ViewState", do: ["stiffer"], to: null },
  Series: { id: null, state: "ViewState", do: ["series"] },
  Swing: { id: null, state: "ViewState", do: ["swing"], share: null },
  Response: { id: null, state: "ViewState", do: ["response"], ratio: null },
  Analysis: { id: null, state: "ViewState", do: ["analysis"] },
  Said: { id: null, state: "ViewState", do: ["answer"] },
  Export: { id: null, state: "ViewState", do: ["export"], address: null },
  Frame: { id: null, state: "ViewState", do: ["frame"], name: null, kept: "ViewState" },
  Bounds: { id: null, state: "ViewState", do: ["bounds"] },
  Program: { id: null, state: "ViewState", do: ["program"] },
  Slide: { id: null, state: "ViewState", do: ["slide"], name: null, value: null },
};

/** Fields that may not be left out. */
export const NEEDED = {
  Measure: ["kind"],
  ViewState: [],
  Towards: ["pose"],
  Draw: ["id", "do"],
  Numbers: ["id", "do"],
  Result: ["id", "do"],
  Sweep: ["id", "do", "coordinate"],
  Better: ["id", "do"],
  WhatIf: ["id", "do", "to"],
  Series: ["id", "do"],
  Swing: ["id", "do"],
  Response: ["id", "do"],
  Analysis: ["id", "do"],
  Said: ["id", "do"],
  Export: ["id", "do"],
  Frame: ["id", "do", "name"],
  Bounds: ["id", "do"],
  Program: ["id", "do"],
  Slide: ["id", "do", "name", "value"],
};
