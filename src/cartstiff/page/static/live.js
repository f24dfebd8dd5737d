// Answers from a server over a websocket, with reconnection.

// Close code of a tab that is one too many.
const FULL = 4029;

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
    this.onstatus = () => {};
  }

  start() {
    this.socket = new WebSocket(this.url);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = (event) => {
      this.delay = 500;
      this.onstatus("connected");
      this.onanswer(...unpack(event.data));
    };
    this.socket.onclose = async (event) => {
      this.onlost();
      if (event.code === FULL) return; // the server has said why
      this.onstatus("lost");
      if (await this.strange()) this.onstatus("strange");
      setTimeout(() => this.start(), this.delay);
      this.delay = Math.min(5000, this.delay * 1.5);
    };
  }

  /** Whether a server answers that does not know this page's token. */
  async strange() {
    try {
      return (await fetch(location.pathname, { method: "HEAD", cache: "no-store" })).status === 403;
    } catch {
      return false;
    }
  }

  ask(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
    else this.onlost();
  }
}
