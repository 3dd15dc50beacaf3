// The WebSocket to the host: it is opened again whenever it was lost.

const FIRST_PAUSE_MS = 250;
const LONGEST_PAUSE_MS = 2000;

export class Link {
  // `hear` takes each message as an object; `rows` messages carry their numbers in `columns`, one array for each name.
  constructor(hear, changed) {
    this.hear = hear;
    this.changed = changed;
    this.isOpen = false;
    this.pause = FIRST_PAUSE_MS;
    this.open();
  }

  open() {
    const address = new URL("line", location.href);
    address.protocol = address.protocol.replace("http", "ws");
    address.search = "";
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.onopen = () => this.became(true);
    this.socket.onmessage = event => this.hear(typeof event.data === "string" ? JSON.parse(event.data) : numbers(event.data));
    this.socket.onclose = () => {
      this.became(false);
      setTimeout(() => this.open(), this.pause);
      this.pause = Math.min(2 * this.pause, LONGEST_PAUSE_MS);
    };
  }

  became(isOpen) {
    if (isOpen) this.pause = FIRST_PAUSE_MS;
    this.isOpen = isOpen;
    this.changed();
  }

  send(message) {
    if (this.isOpen) this.socket.send(JSON.stringify(message));
    return this.isOpen;
  }
}

function numbers(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const message = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const values = new Float64Array(buffer, 4 + size);
  const count = message.rows ? values.length / message.rows : 0;
  message.columns = Array.from({length: count}, (_, index) => values.subarray(index * message.rows, (index + 1) * message.rows));
  return message;
}
