// The WebSocket: reconnects by itself, acknowledges each image on arrival, and numbers inputs to measure their latency.

const MIN_RETRY_MS = 250, MAX_RETRY_MS = 4000, MAX_LATENCIES = 120;

export class Connection {
  /** `handlers` by message type; `image` receives binary messages as (header, blobs); `open` and `closed` nothing. */
  constructor(handlers) {
    this.handlers = handlers;
    this.retryMs = MIN_RETRY_MS;
    this.lastInput = Date.now(); // differs from the numbers of other pages
    this.pending = new Map(); // send time by input number, until a frame shows the input
    this.latencies = [];
    this.lastAsk = 0;
    this.lastAnswer = Promise.resolve();
    this.asked = new Map(); // what receives the answer, by the number of the question
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/live${location.search}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => { this.retryMs = MIN_RETRY_MS; this.pending.clear(); this.handlers.open(); };
    this.socket.onclose = () => {
      for (const number of [...this.asked.keys()]) this.answer(number, null);
      this.handlers.closed();
      setTimeout(() => this.connect(), this.retryMs);
      this.retryMs = Math.min(2 * this.retryMs, MAX_RETRY_MS);
    };
    this.socket.onmessage = ({data}) => typeof data === "string" ? this.read(JSON.parse(data)) : this.unpack(data);
  }

  get open() { return this.socket.readyState === WebSocket.OPEN; }

  send(message) {
    if (this.open) this.socket.send(JSON.stringify(message));
  }

  /** Send a question after the one before is answered; the promise is that of its answer, or of null if there is none. */
  ask(message) {
    this.lastAnswer = this.lastAnswer.then(() => this.sendQuestion(message));
    return this.lastAnswer;
  }

  sendQuestion(message) {
    if (!this.open) return null;
    this.lastAsk += 1;
    this.send({...message, ask: this.lastAsk});
    return new Promise(resolve => this.asked.set(this.lastAsk, resolve));
  }

  answer(number, message) {
    this.asked.get(number)?.(message);
    this.asked.delete(number);
  }

  /** Send a change of the state with an input number. */
  sendChange(message) {
    this.lastInput += 1;
    this.pending.set(this.lastInput, performance.now());
    this.send({...message, input: this.lastInput});
  }

  /** Record that the displayed frame shows all inputs up to `input`. */
  recordShown(input) {
    const now = performance.now();
    for (const [number, time] of this.pending)
      if (number <= input) { this.latencies.push(now - time); this.pending.delete(number); }
    this.latencies.splice(0, this.latencies.length - MAX_LATENCIES);
  }

  read(message) {
    if (message.ask) this.answer(message.ask, ["rejected", "error"].includes(message.type) ? null : message);
    this.handlers[message.type]?.(message);
  }

  unpack(data) {
    this.send({type: "ack"});
    let start = 4 + new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, start - 4)));
    const blobs = header.lengths.map(n => new Blob([new Uint8Array(data, (start += n) - n, n)], {type: "image/jpeg"}));
    this.handlers.image(header, blobs);
  }
}
