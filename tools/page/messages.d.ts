// Written by `python tools/page_messages.py` from the models of `cartstiff.shown.page.messages`,
// which read what a page sends: not to be changed by hand.

declare namespace Messages {
interface Measure {
  kind: "root" | "linear" | "log";
  value_per_length?: number | null;
  cut_at?: number | null;
  zero_at?: number | null;
  length_per_decade?: number | null;
}

interface ViewState {
  q?: (number)[] | null;
  moved?: number | null;
  connection?: "load" | "A" | "B" | "K" | "F" | "+";
  quantity?: "stiffness" | "compliance";
  others?: "free" | "held";
  axes?: "body" | "world";
  point?: [number, number, number];
  stiffness?: (number | null)[] | null;
  load?: [number, number, number, number, number, number] | null;
  load_axes?: "body" | "world";
  load_kind?: "dead" | "follower" | "conservative";
  load_at?: [number, number, number] | null;
  gravity?: [number, number, number] | null;
  payload?: [number, number, number, number] | null;
  command?: (number)[] | null;
  ghost?: (number)[] | null;
  quantity_of_map?: string | null;
  mode?: number | null;
  allowed?: number | null;
  measures?: { [key in "translation" | "rotation"]?: Measure } | null;
  theme?: "light" | "dark";
  translation?: boolean;
  rotation?: boolean;
  scale?: "root" | "linear" | "log";
  labels?: boolean;
  wrench?: boolean;
  deflection?: boolean;
  enlarged?: number | null;
  drawn?: "stiffness" | "compliance" | null;
  centres?: boolean;
  held_forces?: boolean;
}

interface Towards {
  pose: [[number, number, number, number], [number, number, number, number], [number, number, number, number], [number, number, number, number]];
  turning?: boolean;
}

interface Draw {
  state?: ViewState;
  do: "draw";
  towards?: Towards | null;
  lengths?: (number)[] | null;
}

interface Numbers {
  state?: ViewState;
  do: "numbers";
}

interface Result {
  state?: ViewState;
  do: "result";
}

interface Sweep {
  state?: ViewState;
  do: "sweep";
  coordinate: number;
  steps?: number;
}

interface Better {
  state?: ViewState;
  do: "better";
}

interface WhatIf {
  state?: ViewState;
  do: "stiffer";
  to: (number | null)[];
}

interface Series {
  state?: ViewState;
  do: "series";
}

interface Response {
  state?: ViewState;
  do: "response";
  ratio?: number;
}

interface Analysis {
  state?: ViewState;
  do: "analysis";
}

interface Said {
  state?: ViewState;
  do: "answer";
}

interface Export {
  state?: ViewState;
  do: "export";
  address?: string | null;
}

interface Frame {
  state?: ViewState;
  do: "frame";
  name: string;
  kept?: (ViewState)[];
}

interface Bounds {
  state?: ViewState;
  do: "bounds";
}

interface Program {
  state?: ViewState;
  do: "program";
}

interface Slide {
  state?: ViewState;
  do: "slide";
  name: string;
  value: number;
}

/** The store adds its number, and the state that it shows where none is given. */
type Question =
  Draw | Numbers | Result | Sweep | Better | WhatIf | Series | Response | Analysis | Said | Export | Frame | Bounds | Program | Slide;

/** What is sent. */
type Message = Question & { id: number; state: any };

}
