// The socket: comes back by itself, acknowledges each picture when it arrives, and numbers inputs to tell their latency.

const FIRST_WAIT = 250, LONGEST_WAIT = 4000; // milliseconds

export class Connection {
  /** `handlers` by message type; `picture` takes binary messages as (header, blobs), `open` and `closed` nothing. */
  constructor(handlers) {
    this.handlers = handlers;
    this.wait = FIRST_WAIT;
    this.sent = Date.now(); // no other page's numbers
    this.times = new Map(); // of inputs that no frame has shown yet
    this.latencies = [];
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/live${location.search}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.wait = FIRST_WAIT; this.times.clear(); this.handlers.open(); };
    this.socket.onclose = () => {
      this.handlers.closed();
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(2 * this.wait, LONGEST_WAIT);
    };
    this.socket.onmessage = ({data}) => typeof data === "string" ? this.read(JSON.parse(data)) : this.unpack(data);
  }

  get open() { return this.socket.readyState === WebSocket.OPEN; }

  send(message) {
    if (this.open) this.socket.send(JSON.stringify(message));
  }

  /** Send a change of what is seen, numbered. */
  change(message) {
    this.sent += 1;
    this.times.set(this.sent, performance.now());
    this.send({...message, input: this.sent});
  }

  /** The picture on the screen shows all inputs up to this one. */
  shown(input) {
    const now = performance.now();
    for (const [number, time] of this.times)
      if (number <= input) { this.latencies.push(now - time); this.times.delete(number); }
    this.latencies.splice(0, this.latencies.length - 120);
  }

  read(message) {
    this.handlers[message.type]?.(message);
  }

  unpack(data) {
    this.send({type: "ack"});
    const end = 4 + new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, end - 4)));
    let at = end;
    const blobs = header.parts.map(n => new Blob([new Uint8Array(data, (at += n) - n, n)], {type: "image/jpeg"}));
    this.handlers.picture(header, blobs);
  }
}
