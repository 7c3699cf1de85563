// The line to the console: what it shows comes by a websocket, what is asked of it goes by POST.

const RETRY_MS = [300, 700, 1500, 3000];
const LOGGED_OUT = 4401;
const EXPIRED = 4402;
const POINTS = 1000;
const ORDER_MS = 9000;

export class Link {
  constructor(changed) {
    this.changed = changed;
    this.common = {};
    this.sections = {};
    this.points = null;
    this.rig = "";
    this.chosen = sessionStorage.getItem("rig") ?? "";
    this.you = null;
    // Of accounts only: the name, the role, and by order why the role may not give it.
    this.name = "";
    this.role = null;
    this.mayNot = {};
    this.expired = false;
    this.heardAt = 0;
    // By how much this browser's clock is ahead of the console's.
    this.aheadMs = 0;
    this.open = false;
    this.lost = true; // whether the console does not answer; the page looks after it
    this.tries = 0;
    this.connect();
  }

  connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    this.socket = new WebSocket(`${scheme}://${location.host}/live`);
    this.socket.onopen = () => {
      // All is sent anew, perhaps by a console that was restarted and knows nothing of earlier runs.
      this.common = {};
      this.sections = {};
      this.points = null;
      this.open = true;
      this.tries = 0;
      if (this.chosen) this.send();
    };
    this.socket.onmessage = (event) => this.take(JSON.parse(event.data));
    this.socket.onclose = (event) => {
      this.open = false;
      if (event.code === LOGGED_OUT) { location.assign("/login"); return; }
      // A login that has expired can still stop: the page stays.
      if (event.code === EXPIRED) { this.expired = true; this.changed(["link"]); return; }
      setTimeout(() => this.connect(), RETRY_MS[Math.min(this.tries++, RETRY_MS.length - 1)]);
      this.changed(["link"]);
    };
  }

  choose(rig) {
    this.chosen = rig;
    sessionStorage.setItem("rig", rig);
    if (this.open) this.send();
  }

  send() {
    this.socket.send(JSON.stringify({ rig: this.chosen }));
  }

  take(message) {
    this.heardAt = performance.now();
    const changed = ["link"];
    if (message.you !== undefined) this.you = message.you;
    if (message.now_ms !== undefined) this.aheadMs = Date.now() - message.now_ms;
    if (message.role !== undefined) {
      [this.name, this.role, this.mayNot] = [message.name, message.role, message.may_not];
      changed.push("role");
    }
    if (message.rig !== undefined && message.rig !== this.rig) {
      this.rig = message.rig;
      this.sections = {};
      this.points = null;
      changed.push("rig");
    }
    Object.assign(this.common, message.common);
    Object.assign(this.sections, message.sections);
    changed.push(...Object.keys(message.common ?? {}), ...Object.keys(message.sections ?? {}));
    if (message.points) {
      this.append(message.points);
      changed.push("points");
    }
    this.changed(changed);
  }

  append(points) {
    const { epoch, ...columns } = points;
    if (!this.points || this.points.epoch !== epoch) this.points = { epoch };
    for (const [name, values] of Object.entries(columns)) {
      const kept = (this.points[name] ??= []);
      kept.push(...values);
      if (kept.length > POINTS) kept.splice(0, kept.length - POINTS);
    }
  }

  // Ask for something; returns {accepted, reason, answered}.
  async order(order, told = {}) {
    const ending = new AbortController();
    const patience = setTimeout(() => ending.abort(), ORDER_MS);
    try {
      const response = await fetch("/order", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ order, rig: this.rig, ...told }),
        signal: ending.signal,
      });
      const answer = await response.json();
      if (response.status === 401 && !answer.expired) location.assign("/login");
      return { ...answer, answered: true };
    } catch {
      return { accepted: false, reason: "the console does not answer", answered: false };
    } finally {
      clearTimeout(patience);
    }
  }
}
