/** The WebSocket of the tab: requests with their answers, events, and reconnection. */

const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 4000;

/** An error document of a daemon or of this server: what happened, and what helps. */
export class RequestError extends Error {
  constructor({ code, what, remedy = "", ...details }) {
    super(remedy ? `${what}; ${remedy}` : what);
    Object.assign(this, { code, what, remedy, details });
  }
}

const NO_CONNECTION = {
  code: "no_connection",
  what: "no connection to piezod web",
  remedy: "the page tries again by itself",
};

/**
 * Connects at once, and again whenever the connection ends.
 *
 * Handlers of `on` get the events of the server under their own names (`telemetry`, `status`,
 * `stage`), and of this object: `open`, `close` with the time since when, and `locked` if the server
 * has another token than this browser.
 */
export class Socket {
  #socket = null;
  #waiting = new Map(); // number of a message: what settles its promise
  #handlers = new Map(); // name of an event: set of handlers
  #number = 0;
  #waitMs = FIRST_WAIT_MS;
  #lostAt = new Date();

  constructor() {
    this.url = new URL("ws", location); // a proxy may have put the page into a folder
    this.url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    this.#connect();
  }

  get connected() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  /** Since when there is no connection. */
  get lostAt() {
    return this.#lostAt;
  }

  /**
   * Send a message; return a promise of its result.
   *
   * @throws {RequestError} If the request is refused, or the connection ends first.
   */
  request(message) {
    if (!this.connected) return Promise.reject(new RequestError(NO_CONNECTION));
    this.#number += 1;
    const id = this.#number;
    const answer = new Promise((resolve, reject) => this.#waiting.set(id, { resolve, reject }));
    this.#socket.send(JSON.stringify({ id, ...message }));
    return answer;
  }

  /** Call a handler with each event of a name; return a function that ends this. */
  on(name, handler) {
    if (!this.#handlers.has(name)) this.#handlers.set(name, new Set());
    this.#handlers.get(name).add(handler);
    return () => this.#handlers.get(name).delete(handler);
  }

  #emit(name, event) {
    for (const handler of [...(this.#handlers.get(name) ?? [])]) handler(event);
  }

  #connect() {
    const socket = new WebSocket(this.url);
    this.#socket = socket;
    socket.onopen = () => {
      this.#waitMs = FIRST_WAIT_MS;
      this.#emit("open");
    };
    socket.onmessage = ({ data }) => this.#take(JSON.parse(data));
    socket.onclose = () => this.#lost();
  }

  #take(message) {
    if (!("id" in message)) {
      this.#emit(message.event, message);
      return;
    }
    const promise = this.#waiting.get(message.id);
    this.#waiting.delete(message.id);
    if (message.ok) promise?.resolve(message.result);
    else promise?.reject(new RequestError(message.error));
  }

  #lost() {
    if (this.#waitMs === FIRST_WAIT_MS) this.#lostAt = new Date();
    for (const { reject } of this.#waiting.values()) reject(new RequestError(NO_CONNECTION));
    this.#waiting.clear();
    this.#emit("close", this.#lostAt);
    this.#later();
  }

  #later() {
    setTimeout(() => this.#again(), this.#waitMs);
    this.#waitMs = Math.min(2 * this.#waitMs, LONGEST_WAIT_MS);
  }

  /** Connect again; a server that was started again asks for its new token first. */
  async #again() {
    const answer = await fetch("static/icon.svg", { cache: "no-store" }).catch(() => null);
    if (answer?.status !== 401) {
      this.#connect();
      return;
    }
    this.#emit("locked");
    this.#later(); // another tab may get the cookie
  }
}
