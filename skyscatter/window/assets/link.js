// The line to the solver behind the page: questions go out, and messages come back for each by its number.

/** What all links have in common. */
class Link {
  constructor() { this.count = 0; this.waiting = new Map(); this.latest = new Map(); this.failed = () => {}; }

  /** Ask; `heard(message, data)` is called for each message until the answer is complete or a newer question of its kind comes. */
  ask(kind, question, heard) {
    const number = ++this.count, before = this.latest.get(kind);
    if (before) this.waiting.delete(before);
    this.latest.set(kind, number);
    this.waiting.set(number, { heard, question: { ...question, kind, number } });
    this.put({ ...question, kind, number });
    return number;
  }

  /** No answer of this kind is wanted any more. */
  drop(kind) {
    const number = this.latest.get(kind);
    if (number && this.waiting.delete(number)) this.putDrop(kind);
  }

  heard(message, data) {
    const listener = this.waiting.get(message.number)?.heard;
    if (!listener) return;
    if (message.what === "done" || message.what === "error") this.waiting.delete(message.number);
    try { listener(message, data); } catch (error) { console.error(error); this.failed(error); }
  }
}

/** The server on this machine. */
export class Server extends Link {
  constructor() {
    super();
    this.page = Array.from(crypto.getRandomValues(new Uint8Array(12)), b => b.toString(16).padStart(2, "0")).join("");
    this.queue = Promise.resolve();
    this.lost = () => {};
    this.found = () => {};
    this.open();
    addEventListener("pagehide", () => this.events.close());
    addEventListener("pageshow", event => { if (event.persisted) this.open(); });
  }

  open() {
    this.ready = new Promise(resolve => {
      this.events = new EventSource(`events?page=${this.page}`);
      this.events.onopen = () => { resolve(); this.found(); this.again(); };
    });
    this.events.onerror = () => { this.events.readyState === EventSource.CLOSED ? this.refused() : this.lost(); };
    // One after the other, so that a table that is fetched is not overtaken by the word that all is done.
    this.events.onmessage = event => { this.queue = this.queue.then(() => this.take(JSON.parse(event.data))).catch(() => {}); };
  }

  /** What had no answer when a line broke is asked once more, of a program that knows nothing of it. */
  again() {
    if (this.opened) for (const { question } of this.waiting.values()) this.put(question);
    this.opened = true;
  }

  /** Say why there is no line. */
  async refused() {
    const answer = await fetch("room").catch(() => null);
    this.lost(answer && answer.status === 409 ? await answer.text() : undefined);
  }

  async take(message) {
    let data = null;
    if (message.data && this.waiting.has(message.number)) {
      const answer = await fetch(`answer?page=${this.page}&number=${message.data}`);
      if (!answer.ok) return;
      data = await answer.arrayBuffer();
    }
    this.heard(message, data);
  }

  async put(question) {
    await this.ready;
    const answer = await this.post("ask", question);
    if (answer && !answer.ok) this.heard({ number: question.number, what: "error", words: await answer.text() }, null);
  }

  putDrop(kind) { this.ready.then(() => this.post("drop", { kind })); }

  post(route, body) {
    return fetch(`${route}?page=${this.page}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) })
      .catch(() => this.lost());
  }
}

/** The kernel of a notebook, through the model of a widget. */
export class Kernel extends Link {
  constructor(model) {
    super();
    this.model = model;
    model.on("msg:custom", (message, buffers) => {
      const view = buffers && buffers[0];
      const data = view ? (view.buffer ? view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength) : view) : null;
      this.heard(message, data);
    });
  }

  put(question) { this.model.send(question); }

  putDrop(kind) { this.model.send({ kind: "drop", drop: kind }); }
}

/** Nobody: a table that comes with the page, and its model. */
export class Alone extends Link {
  constructor(table, facts) { super(); this.table = table; this.facts = facts; this.alone = true; }

  put(question) {
    const answers = { first: [{ what: "table", quick: false, tolerance: this.facts.tolerance }, this.table], facts: [{ what: "facts", ...this.facts }, null] };
    const answer = answers[question.kind];
    queueMicrotask(() => {
      if (answer) this.heard({ number: question.number, ...answer[0] }, answer[1]);
      this.heard({ number: question.number, what: "done" }, null);
    });
  }

  putDrop() {}
}
