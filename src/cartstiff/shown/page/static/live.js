// Answers from a server over a websocket, with reconnection.

import { el, loaded } from "./dom.js";
import { ComputingSource } from "./offline.js";

// Close code of a tab that is one too many.
const FULL = 4029;
// Shares of the loading bar at which the page's own files, and the first answer, have come.
const [FILES, PICTURE] = [0.4, 0.95];

/** Split a message into its JSON object and the viewer's commands. */
export function unpack(buffer) {
  const view = new DataView(buffer);
  const chunks = [];
  for (let at = 0; at < buffer.byteLength;) {
    const size = view.getUint32(at);
    chunks.push(new Uint8Array(buffer, at + 4, size));
    at += 4 + size;
  }
  return [JSON.parse(new TextDecoder().decode(chunks[0])), chunks.slice(1)];
}

export class LiveSource {
  constructor(url) {
    this.url = url;
    this.live = true;
    this.moves = true;
    this.shows = null; // everything
    this.delay = 500;
    this.rest = 10_000; // time (ms) without a change after which a file is asked for that may be needed later
    this.onstatus = (_status) => {};
    this.onanswer = (_data, _commands) => {};
    this.onlost = () => {};
    this.onalone = () => {};
    this.local = null; // the page's own arithmetic, once it is there
    this.alone = false; // whether it answers for the server
    /** There is a page to show what happens. */
    this.ready = new Promise((done) => { this.begin = done; });
  }

  /** Have the arithmetic brought: it answers when the server has gone. */
  async bring(store) {
    const { frame } = store.hello.mechanism;
    const data = await store.ask({ do: "program" });
    if (!data.script) return;
    await new Promise((done, fail) => document.head.append(el("script",
      { src: data.script, onload: done, onerror: fail })));
    if (store.hello.mechanism.frame !== frame) return;
    const local = new ComputingSource(data, data.packed);
    local.cannot = "the server does not answer, and the browser cannot do that";
    local.onanswer = (...answer) => this.onanswer(...answer);
    this.local = local;
    store.tell("local", local);
  }

  /** The server has gone: the page goes on by itself, if it can. */
  goAlone() {
    if (!this.local || this.alone) return;
    this.alone = true;
    this.onalone();
  }

  /** The mechanism of another number from the same server; each has its own picture. */
  beside(number) {
    const address = new URL(this.url);
    address.searchParams.set("mechanism", number);
    return new LiveSource(address.href);
  }

  close() {
    this.closed = true;
    if (this.socket?.readyState === WebSocket.CONNECTING) this.socket.onopen = () => this.socket.close();
    else this.socket?.close();
  }

  /** Answer from now on, beginning with what has come already. */
  start() {
    if (!this.socket) this.connect();
    this.begin();
  }

  /** Have the server begin; its words are kept until `start`. */
  connect() {
    this.socket = new WebSocket(this.url);
    this.socket.binaryType = "arraybuffer";
    this.whole = null; // of a large answer what has come, behind its size
    loaded(FILES);
    this.socket.onmessage = ({ data }) => this.ready.then(() => this.hear(data));
    this.socket.onclose = ({ code }) => this.ready.then(() => this.lose(code));
  }

  /** The socket has closed: try again, unless that was wanted. */
  async lose(code) {
    this.onlost();
    if (this.closed || code === FULL) return; // a full server has said why
    this.goAlone();
    this.onstatus("lost");
    if (await this.strange()) this.onstatus("strange");
    setTimeout(() => this.connect(), this.delay);
    this.delay = Math.min(5000, this.delay * 1.5);
  }

  /** A message of the server: an answer, or a piece of one. */
  hear(data) {
    this.delay = 500;
    this.alone = false;
    this.onstatus("connected");
    let { whole } = this;
    if (typeof data === "string") this.whole = whole = { bytes: new Uint8Array(Number(data)), filled: 0 };
    else if (whole) {
      whole.bytes.set(new Uint8Array(data), whole.filled);
      whole.filled += data.byteLength;
      loaded(FILES + ((PICTURE - FILES) * whole.filled) / whole.bytes.length);
    }
    if (whole && whole.filled < whole.bytes.length) return;
    this.whole = null;
    this.onanswer(...unpack(whole ? whole.bytes.buffer : data));
  }

  /** Whether a server answers that does not know this page's token. */
  async strange() {
    const answer = await fetch(location.pathname, { method: "HEAD", cache: "no-store" }).catch(() => null);
    return answer?.status === 403;
  }

  ask(message) {
    if (this.alone) return this.local.ask(message);
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
    else this.onlost();
  }
}
