// The history of the curves, which the console keeps: spans up to eight hours, scrolling back and pause.

import { LIVE } from "./chart.js";
import { Scales } from "./scales.js";
import { clock, element } from "./words.js";

const by = (id) => document.getElementById(id);

// The spans that are offered, in s. The first one is drawn live, from the points that the page has.
const SPANS = [[10, "10 s"], [60, "1 min"], [600, "10 min"], [3600, "1 h"], [28800, "8 h"]];
// Steps asked for: a chart is some 600 pixels wide, and narrower steps cannot be told apart.
const STEPS = 600;
const KEPT_MS = 8 * 3600 * 1000; // what the console keeps
const OFTEN_MS = 1000; // between two looks at least, when the newest end is shown
const PATIENCE_MS = 9000;
// Magnitudes from here on are no reading; the console leaves them out of the live points as well.
const LARGEST = 1e9;
// Distances of the marks on the axis of time, s; the axis has five of them at most.
const TICKS = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200];
const MOST_TICKS = 5;

// Curves that only the history has: key, name, unit, least range, digits.
const MORE = [
  ["load_kN", "Load", "kN", 1, 2], ["command_V", "Command", "V", 1, 2], ["spool_mm", "Spool", "mm", 0.2, 3],
  ["compensation_V", "Compensation", "V", 0.5, 2], ["tank_C", "Tank temperature", "°C", 2, 1],
  ["oil_C", "Oil temperature", "°C", 2, 1],
];
const told = ([key, title, unit, least, digits]) => ({
  title, unit, least, floor: null, empty: "nothing measured", series: [{ key, label: "value", colour: "first", digits }],
});
export const FURTHER = told(MORE[0]);
export const FURTHER_KEYS = MORE.map(([key, title, unit]) => [key, `${title}, ${unit}`]);

// Asks the console for a stretch of a rig's history; gives {begin_ms, step_ms, count, low, high}, both
// of them columns by the curves' names with null for what is not there, or throws with the reason.
export async function stretch(rig, end_ms, span_s, steps, names = []) {
  if (!rig) throw new Error("no rig is heard yet");
  const asked = new URLSearchParams({ rig, end_ms: Math.round(end_ms), span_s: Math.ceil(span_s), steps, names: names.join(",") });
  const response = await fetch(`/history?${asked}`, { signal: AbortSignal.timeout(PATIENCE_MS) });
  if (!response.ok) throw new Error((await response.json()).reason);
  const head = JSON.parse(response.headers.get("X-History"));
  const body = new DataView(await response.arrayBuffer());
  const column = (place) => Array.from({ length: head.count }, (_, k) => {
    const value = body.getFloat32(4 * (place * head.count + k), true);
    return Math.abs(value) < LARGEST ? value : null;
  });
  const columns = (first) => Object.fromEntries(head.names.map((name, k) => [name, column(first + k)]));
  return { ...head, low: columns(0), high: columns(head.names.length) };
}

// How a chart shows a stretch: its axis of time has the clock's time.
function viewOf(found, span_s, more) {
  const end_s = (found.count * found.step_ms) / 1000;
  const at = (back) => found.begin_ms + 1000 * (end_s - back);
  const step = 1000 * TICKS.find((each) => span_s / each <= MOST_TICKS);
  // Marks are at whole minutes or hours of the clock that the reader has.
  const zone = 60000 * new Date(at(0)).getTimezoneOffset();
  const ticks = [];
  for (let ms = Math.ceil((at(span_s) - zone) / step) * step + zone; ms <= at(0); ms += step) {
    const text = clock(ms);
    ticks.push([(at(0) - ms) / 1000, step < 60000 ? text : text.slice(0, 5)]);
  }
  const digits = found.step_ms < 1000 ? 2 : 0;
  const told = (back) => {
    const ms = at(back), part = ((ms % 1000) / 1000).toFixed(digits).slice(1);
    return `${clock(Math.floor(ms / 1000) * 1000)}${part.startsWith("0") ? "" : part}`;
  };
  const step_s = found.step_ms / 1000;
  const marks = more.mark_ms === undefined ? {} : { mark_s: (more.mark_ms - found.begin_ms) / 1000 };
  // Neighbouring steps are joined; a step without any value is a gap.
  return { span_s, end_s, step_s, gap_s: 1.5 * step_s, ticks, told, level: more.level, ...marks };
}

export class History {
  constructor(link, charts) {
    this.link = link;
    this.charts = charts;
    this.span_s = SPANS[0][0];
    this.end_ms = 0; // right end of what is shown, by the console's clock; 0 for the newest
    this.paused = false;
    this.frozen = null; // what a trigger has found: {mark_ms, level}; drawn on all charts
    this.newest_ms = 0; // the console's clock at its last answer, and when that was by performance.now
    this.heardAt = 0;
    this.timer = 0;
    this.asked = 0; // number of the last question, as answers to older ones come too late
    by("span").replaceChildren(...SPANS.map(([span, name]) => new Option(name, span)));
    by("span").addEventListener("change", () => this.show(Number(by("span").value)));
    by("earlier").addEventListener("click", () => this.scroll(-1));
    by("later").addEventListener("click", () => this.scroll(1));
    by("pause").addEventListener("click", () => (this.paused ? this.goOn() : this.pause()));
    this.scales = new Scales(charts);
    this.chooseFurther();
  }

  // Whether the charts show the last seconds, which are drawn as points come.
  get isLive() { return this.span_s === SPANS[0][0] && !this.paused; }

  // Begins anew with another rig.
  begin() {
    this.newest_ms = 0;
    this.goOn();
  }

  show(span_s) {
    // The middle of what is looked at stays where it is.
    if (this.paused && this.end_ms) this.end_ms += 500 * (span_s - this.span_s);
    this.span_s = span_s;
    by("span").value = span_s;
    for (const chart of Object.values(this.charts)) chart.ends = null;
    this.turn();
  }

  async pause() {
    this.paused = true;
    // Curves that were live stay exactly as they are; where they end, the console's clock knows.
    const wasLive = this.span_s === SPANS[0][0];
    this.end_ms = 0;
    this.turn(wasLive);
    const end_ms = await this.now();
    if (this.paused && !this.end_ms) this.end_ms = end_ms;
    this.tell();
  }

  goOn() {
    this.paused = false;
    this.frozen = null;
    this.end_ms = 0;
    this.turn();
  }

  async scroll(direction) {
    const newest = await this.now();
    if (!newest) return;
    if (!this.paused) { this.paused = true; this.end_ms = newest; }
    this.end_ms = (this.end_ms || newest) + direction * 500 * this.span_s;
    this.end_ms = Math.max(newest - KEPT_MS + 1000 * this.span_s, this.end_ms);
    if (this.end_ms >= newest) { this.goOn(); return; }
    this.turn();
  }

  // Shows a moment that a trigger has found, with the time before and after it.
  freeze(mark_ms, level, after_s) {
    this.paused = true;
    this.frozen = { mark_ms, level };
    this.end_ms = mark_ms + 1000 * after_s;
    this.turn();
  }

  // Returns the console's clock, ms since 1970; 0 if it cannot be asked.
  async now() {
    if (!this.newest_ms) await this.look(1, 1, 0).catch(() => null);
    return this.newest_ms ? this.newest_ms + performance.now() - this.heardAt : 0;
  }

  async look(span_s, steps, end_ms) {
    const found = await stretch(this.link.rig, end_ms, span_s, steps);
    if (!end_ms) {
      this.newest_ms = found.begin_ms + found.count * found.step_ms;
      this.heardAt = performance.now();
    }
    return found;
  }

  // Shows what is to be shown now; asIs: what is drawn stays.
  turn(asIs = false) {
    clearTimeout(this.timer);
    this.asked += 1;
    by("pause").textContent = this.paused ? "Go on" : "Pause the curves";
    by("pause").setAttribute("aria-pressed", String(this.paused));
    by("later").disabled = !this.paused;
    document.querySelector('[data-chart="further"]').hidden = this.isLive || asIs;
    this.tell();
    if (asIs) return;
    if (!this.isLive) { this.fetch(this.asked); return; }
    for (const chart of Object.values(this.charts)) if (this.link.points) chart.draw(this.link.points, LIVE);
  }

  async fetch(number) {
    const [span_s, end_ms] = [this.span_s, this.end_ms];
    let problem = "";
    try {
      const found = await this.look(span_s, STEPS, end_ms);
      if (number !== this.asked) return;
      const points = { time_s: Array.from({ length: found.count }, (_, k) => (k * found.step_ms) / 1000), high: found.high, ...found.low };
      const view = viewOf(found, span_s, this.frozen ?? {});
      for (const chart of Object.values(this.charts)) chart.draw(points, view);
      this.shown = { begin_ms: found.begin_ms, end_ms: found.begin_ms + found.count * found.step_ms };
    } catch (error) {
      problem = error.message;
    }
    if (number !== this.asked) return;
    this.tell(problem);
    // The newest end moves on by a step; an end after a trigger is still to come.
    const comes = !this.paused || problem || end_ms > this.newest_ms + performance.now() - this.heardAt - OFTEN_MS;
    if (comes) this.timer = setTimeout(() => this.fetch(number), Math.max(OFTEN_MS, (1000 * span_s) / STEPS));
  }

  tell(problem = "") {
    let text = "";
    if (problem) text = `The history cannot be read: ${problem}.`;
    else if (this.frozen) text = "";
    else if (this.paused) text = `The curves end at ${clock(this.end_ms || Date.now())}; all else is live.`;
    by("pause-why").textContent = text;
  }

  // The further chart shows one of the curves that only the history has.
  chooseFurther() {
    const select = element("select", "");
    select.setAttribute("aria-label", "Curve of this chart");
    select.replaceChildren(...FURTHER_KEYS.map(([key, name]) => new Option(name, key)));
    const heading = document.querySelector('[data-chart="further"] h2');
    heading.replaceChildren(select);
    this.further = (key) => {
      const chart = this.charts.further;
      const output = Object.values(chart.values)[0];
      chart.told = told(MORE.find((each) => each[0] === key));
      chart.values = { [key]: output };
      chart.ends = null;
      select.value = key;
      chart.redraw();
    };
    select.addEventListener("change", () => this.further(select.value));
  }
}
