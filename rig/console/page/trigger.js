// The trigger: shows the curves around the moment at which a curve has crossed a level.
//
// It looks at the history in its finest steps, of 0.01 s, each with its least and greatest value, so that
// a peak of one sample is seen. Nothing crosses a level in a gap: a step without a value begins anew.

import { FURTHER_KEYS, stretch } from "./history.js";
import { clock } from "./words.js";

const by = (id) => document.getElementById(id);

const CHANNELS = [
  ["position_mm", "Position, mm"], ["setpoint_mm", "Setpoint, mm"],
  ["pressure_1_MPa", "Pressure 1, MPa"], ["pressure_2_MPa", "Pressure 2, MPa"], ["supply_MPa", "Supply, MPa"],
  ["estimate_1_MPa", "Estimate 1, MPa"], ["estimate_2_MPa", "Estimate 2, MPa"],
  ["average_1_kPa", "Residual 1, kPa"], ["average_2_kPa", "Residual 2, kPa"], ["leak_L_per_min", "Leak flow, L/min"],
  ...FURTHER_KEYS,
];
const LOOK_MS = 500;
// A look is as long as 1000 of the finest steps: the console joins more than 1200 of them, and a step
// that is joined of several could hide a gap.
const LOOK_S = 10;
const FINEST_MS = 10;
// Whoever is further behind than a look goes on by parts that are past, so that all of them has come.
const PART_S = 8;
const COME_MS = 1000;
// Shown after the moment: half of the span, and half a minute at most, so that it does not take hours.
const AFTER_S = 30;

// Returns the index of the first step, of those from `from` on, by which the level was crossed; -1 if
// there is none. The step before it must be there, and on the other side by one of its values at least.
export function crossing(low, high, level, rises, from = 1) {
  for (let k = Math.max(1, from); k < low.length; k++) {
    if (low[k] === null || low[k - 1] === null) continue;
    if (rises ? low[k - 1] < level && high[k] >= level : high[k - 1] > level && low[k] <= level) return k;
  }
  return -1;
}

export class Trigger {
  constructor(link, history) {
    this.link = link;
    this.history = history;
    this.state = "off"; // off, armed or fired
    this.timer = 0;
    by("trigger-channel").replaceChildren(...CHANNELS.map(([key, name]) => new Option(name, key)));
    by("trigger").addEventListener("submit", (event) => {
      event.preventDefault();
      if (this.state === "armed") this.disarm("Off.");
      else this.arm();
    });
  }

  arm() {
    const option = by("trigger-channel").selectedOptions[0];
    this.key = option.value;
    this.level = by("trigger-level").valueAsNumber;
    this.rises = by("trigger-direction").value === "rising";
    this.words = `${option.text} ${this.rises ? "rising through" : "falling through"} ${this.level}`;
    this.rig = this.link.rig;
    this.seen_ms = 0; // all steps that begin before this were looked at
    this.state = "armed";
    if (FURTHER_KEYS.some(([key]) => key === this.key)) this.history.further(this.key);
    this.history.goOn();
    this.tell(`Armed: waits for ${this.words}.`);
    clearTimeout(this.timer);
    this.look();
  }

  // With another rig, or when it is taken off.
  disarm(text) {
    clearTimeout(this.timer);
    if (this.state === "off") return;
    this.state = "off";
    this.tell(text);
  }

  tell(text) {
    by("trigger-arm").textContent = { off: "Arm", armed: "Disarm", fired: "Rearm" }[this.state];
    by("trigger").dataset.state = this.state;
    by("trigger-said").textContent = text;
  }

  async look() {
    const { key, rig } = this;
    let wait = LOOK_MS;
    try {
      const end_ms = this.seen_ms ? this.seen_ms + 1000 * PART_S : 0;
      const isBehind = end_ms > 0 && end_ms + COME_MS < (await this.history.now());
      const found = await stretch(rig, isBehind ? end_ms : 0, LOOK_S, 1200, [key]);
      if (this.state !== "armed" || this.key !== key || this.rig !== rig) return;
      if (isBehind) wait = 0; // a browser that slept, as in a tab that is not seen, catches up with ten minutes
      if (this.judge(found, isBehind)) return;
      this.tell(`Armed: waits for ${this.words}.`);
    } catch (error) {
      if (this.state !== "armed") return;
      this.tell(`Armed, but the history cannot be read: ${error.message}.`);
    }
    this.timer = setTimeout(() => this.look(), wait);
  }

  // Looks at the steps of a stretch that were not looked at yet; returns whether the trigger has fired.
  judge(found, isPast) {
    const { begin_ms, step_ms, count } = found;
    // So long ago was what comes next that the console has it in longer steps, which could hide a gap.
    if (step_ms > FINEST_MS) { this.seen_ms = 0; return false; }
    const [low, high] = [found.low[this.key] ?? [], found.high[this.key] ?? []];
    // The newest step with a value may still grow. Of what is past everything has come.
    let end = count;
    if (!isPast) { while (end > 0 && (low[end - 1] ?? null) === null) end -= 1; end -= 1; }
    const before = this.seen_ms;
    if (end > 0) this.seen_ms = Math.max(before, begin_ms + end * step_ms);
    if (!before) { if (end <= 0) this.seen_ms = 0; return false; }
    const from = Math.round((before - begin_ms) / step_ms);
    const at = crossing(low.slice(0, Math.max(0, end)), high, this.level, this.rises, from);
    if (at < 0) return false;
    this.fire(begin_ms + at * step_ms);
    return true;
  }

  fire(mark_ms) {
    this.state = "fired";
    const part = String(Math.floor((mark_ms % 1000) / 10)).padStart(2, "0");
    this.tell(`Fired at ${clock(Math.floor(mark_ms / 1000) * 1000)}.${part}: ${this.words}.`);
    this.history.freeze(mark_ms, { key: this.key, value: this.level }, Math.min(this.history.span_s / 2, AFTER_S));
  }
}
