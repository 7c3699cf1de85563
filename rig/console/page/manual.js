// Manual mode: what a person asks of the ram, the pump and the bypasses, while `rig jog` runs.

import { byHand, capital, element, figure, shortly } from "./words.js";

const by = (id) => document.getElementById(id);
// A holder beats at least every 100 ms; the rig comes to rest 120 ms after the last heartbeat.
const HOLD_MS = 40;
// So often a page that has moved the ram shows that it is still there.
const THERE_MS = 1000;
// So long a slider that was moved stays where it is, until the needle has followed: its stroke takes some seconds.
const SET_MS = 10000;

const WAVE = ["manual-mean", "manual-amplitude", "manual-frequency"];

// What the page calls commands that have a button.
const CALLED = { __proto__: null, "pump high": "Load pump", "pump unloaded": "Unload pump", home: "Home", stop: "Bring to rest" };

export class Manual {
  constructor(link) {
    this.link = link;
    this.card = by("manual-card");
    this.mine = false;
    this.used = false;
    this.waved = false;
    this.held = null;
    this.moved = "";
    this.changing = false;
    // Orders that were given, and the newest whose answer is shown.
    this.asked = this.answered = 0;
    this.rows = new Map();
    for (const button of this.card.querySelectorAll("[data-jog]")) {
      button.addEventListener("click", () => this.ask(button.dataset.jog));
    }
    for (const button of this.card.querySelectorAll("[data-go]")) {
      button.addEventListener("click", () => {
        const length = by(button.dataset.go === "by" ? "manual-step" : "manual-to");
        if (this.lacks(length) || this.lacks(by("manual-speed"))) return;
        this.ask(`${button.dataset.go} ${length.value}mm speed ${by("manual-speed").value}mm/s`);
      });
    }
    for (const button of this.card.querySelectorAll("[data-hold]")) this.holdable(button);
    for (const range of this.card.querySelectorAll("input[type=range]")) {
      const show = () => { range.parentElement.querySelector("output").textContent = range.value; };
      range.addEventListener("input", show);
      range.addEventListener("change", () => { if (this.waved) this.change(); });
      show();
    }
    this.card.querySelector("[data-wave]").addEventListener("click", () => {
      const places = this.places();
      const [upto, sweep] = [by("manual-upto"), by("manual-sweep")];
      const isChirp = by("manual-shape").value === "chirp";
      if (isChirp && (this.lacks(upto) || this.lacks(sweep))) return;
      this.ask(`generator ${by("manual-shape").value} ${this.wave()}${isChirp ? ` upto ${upto.value}Hz sweep ${sweep.value}s` : ""}`)
        .then((answer) => { this.waved = answer.accepted; if (answer.accepted) this.runs = places; });
    });
    by("manual-shape").addEventListener("change", (event) => {
      for (const label of this.card.querySelectorAll(".chirp")) label.hidden = event.target.value !== "chirp";
    });
    // Whatever takes the hand or the eye off the button lets it go.
    addEventListener("blur", () => this.release());
    addEventListener("pagehide", () => this.release());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.release(); });
    setInterval(() => { if (this.used && !this.held && this.on()) this.beat(); }, THERE_MS);
  }

  on() {
    const { life, campaign } = this.link.sections;
    return this.mine && !this.link.lost && life?.life === "live" && campaign?.status === "running" && campaign.activity === "manual";
  }

  show(mine) {
    this.mine = mine;
    const { life, campaign, bypass } = this.link.sections;
    this.card.hidden = !(life?.life === "live" && campaign?.status === "running" && campaign.activity === "manual");
    if (this.card.hidden) { this.used = this.waved = false; }
    this.ended(campaign?.moved ?? "");
    if (this.held && !this.on()) this.release();
    for (const button of this.card.querySelectorAll("button, input, select")) button.disabled = !this.on();
    for (const valve of bypass ?? []) this.bypass(valve);
  }

  // Shows how the last motion ended, in the rig's words; a wave that has ended is begun anew, and not changed.
  ended(moved) {
    if (moved === this.moved) return;
    this.moved = moved;
    if (moved) this.waved = false;
    // Heartbeats do not begin again a motion that the rig has ended; that takes a new press.
    if (moved.startsWith("hold ") && !moved.includes("brought to rest") && this.held?.moves) {
      clearInterval(this.held.beating);
      this.held = null;
      this.say("The ram is at rest; let the button go, and press it again to go on", true, this.asked);
    }
    by("manual-moved").textContent = capital(byHand(moved));
  }

  // Another rig has bypasses of its own.
  clear() {
    this.rows.clear();
    by("manual-bypasses").replaceChildren();
  }

  // A row with the bypass's own buttons, its opening and the reading of its meter.
  bypass(valve) {
    let row = this.rows.get(valve.name);
    if (!row) {
      const needle = element("input");
      Object.assign(needle, { type: "range", min: 0, max: 100, value: 0, title: "needle, %" });
      needle.setAttribute("aria-label", `${shortly(valve.name)}: needle, %`);
      needle.addEventListener("change", () => this.ask(`bypass ${valve.name} ${needle.value}%`));
      const buttons = valve.ball === null ? [] : ["open", "shut"].map((state) => {
        const button = element("button", "", state);
        button.type = "button";
        button.addEventListener("click", () => this.ask(`bypass ${valve.name} ${state}`));
        return button;
      });
      row = { needle, words: element("span", "quiet"), setAt: -Infinity };
      for (const name of ["input", "change"]) needle.addEventListener(name, () => { row.setAt = performance.now(); });
      this.rows.set(valve.name, row);
      by("manual-bypasses").append(element("div", "buttons bypass", element("span", "", shortly(valve.name)), ...buttons, needle, row.words));
    }
    // The slider stands where the needle is, unless somebody has just moved it, whom the needle still follows.
    if (performance.now() - row.setAt > SET_MS && valve.needle !== null) row.needle.value = Math.round(100 * valve.needle);
    const ball = valve.ball === null ? "" : valve.ball > 0.01 ? "open, " : "shut, ";
    const flow = valve.metered_L_per_min ?? valve.shut_L_per_min;
    row.words.textContent = `${ball}${valve.needle === null ? "" : `needle ${figure(100 * valve.needle, 0)} %, `}${flow === null ? "no meter" : `${figure(flow, 2)} L/min`}`;
  }

  wave() {
    return `mean ${by("manual-mean").value}mm amplitude ${by("manual-amplitude").value}mm frequency ${by("manual-frequency").value}Hz`;
  }

  places() {
    return WAVE.map((name) => by(name).value);
  }

  // Puts the sliders back to the wave that runs.
  place(values) {
    WAVE.forEach((name, k) => {
      by(name).value = values[k];
      by(name).parentElement.querySelector("output").textContent = values[k];
    });
  }

  // Says what is to be filled in, if a field holds no number that may be asked for.
  lacks(field) {
    const isMissing = field.value === "" || !field.checkValidity();
    if (isMissing) {
      const allowed = field.min ? `, from ${field.min} to ${field.max}` : "";
      this.say(`${field.parentElement.textContent.trim()}: write a number${allowed}`, true, this.asked += 1);
      field.focus();
    }
    return isMissing;
  }

  // Only the newest place of the sliders is sent, one change after the other.
  async change() {
    if (this.changing) { this.again = true; return; }
    this.changing = true;
    do {
      this.again = false;
      const places = this.places();
      const { accepted } = await this.ask(`generator ${this.wave()}`);
      if (accepted) this.runs = places;
      else if (!this.again && this.waved) this.place(this.runs);
    } while (this.again);
    this.changing = false;
  }

  holdable(button) {
    button.addEventListener("pointerdown", (event) => {
      // What a finger or a pen has pressed keeps it captured, and would not notice that it slides off.
      if (button.hasPointerCapture(event.pointerId)) button.releasePointerCapture(event.pointerId);
      if (event.button === 0 && !button.disabled) this.hold(button.dataset.hold);
    });
    for (const name of ["pointerup", "pointerleave", "pointercancel", "blur"]) {
      button.addEventListener(name, () => this.release());
    }
    button.addEventListener("keydown", (event) => {
      if (event.key === " " && !event.repeat) this.hold(button.dataset.hold);
    });
    button.addEventListener("keyup", () => this.release());
  }

  async hold(way) {
    this.release();
    // Heartbeats begin at once: the answer may take longer than the rig waits for the first.
    const held = { beating: setInterval(() => this.beat(), HOLD_MS) };
    this.held = held;
    const speed = Math.min(by("manual-speed").value, 20);
    const answer = await this.ask(`hold ${way} speed ${speed}mm/s`);
    // Why nothing moved is told to who has let go already as well, and not only that it rests.
    if (!answer.accepted) {
      held.refusal = `hold ${way}: ${answer.reason}`;
      this.say(held.refusal, true, this.asked);
    }
    held.moves = answer.accepted;
    if (this.held !== held || answer.accepted) return;
    clearInterval(held.beating);
    this.held = null;
  }

  release() {
    const held = this.held;
    if (!held) return;
    clearInterval(held.beating);
    this.held = null;
    this.ask("stop").then(() => { if (held.refusal) this.say(held.refusal, true, this.asked); });
  }

  // An answer that comes after that to a later order is not shown: answers may overtake each other.
  say(text, isRefused, number) {
    if (number < this.answered) return;
    this.answered = number;
    by("manual-said").textContent = text;
    by("manual-said").classList.toggle("refused", isRefused);
  }

  beat() {
    this.link.order("beat", { text: String(Math.round(performance.now())) });
  }

  async ask(line) {
    const number = this.asked += 1;
    const answer = await this.link.order("jog", { text: line });
    this.used ||= answer.accepted;
    if (line === "stop" || line.startsWith("pump")) this.waved = false;
    // The rig names commands as they are typed, and its answer begins with the one that it refuses.
    const reason = answer.reason?.replace(new RegExp(`^${line.split(" ")[0]}: `), "")
      .replace("ask for `", "press `").replace(/`([^`]+)`/g, (typed, command) => CALLED[command] ?? typed);
    this.say(`${CALLED[line] ?? line}: ${answer.accepted ? "obeyed" : reason}`, !answer.accepted, number);
    return { ...answer, reason };
  }
}
