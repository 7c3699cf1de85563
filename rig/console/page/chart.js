// A strip chart: the last ten seconds on a canvas, drawn anew as often as points come, or a stretch
// of the history, of which each step is drawn from its least to its greatest value.

const SHOWN_S = 10;
const GAP_S = 0.15;
// Margins of the axes in pixels.
const LEFT = 46;
const RIGHT = 8;
const NICE = [1, 2, 2.5, 5, 10];
// How far below zero is still zero, as a part of the least range of the chart: 0.2 MPa of 1 MPa, which
// are 1 % of a gauge of 20 MPa.
const NEAR_ZERO = 0.2;

// How a chart shows its points. The history has views of its own (history.js), which have more:
// end_s (time of the right end; the newest point's if left out), mark_s (a moment that is marked) and
// level ({key, value}, a line in the chart of that curve). ticks: [time before the end in s, text].
export const LIVE = {
  span_s: SHOWN_S,
  gap_s: GAP_S,
  step_s: 0,
  ticks: [0, 2, 4, 6, 8, 10].map((back) => [back, back === 0 ? "now" : `-${back} s`]),
  told: (back) => `-${back.toFixed(2)} s`,
};

function niceStep(range, count) {
  const rough = range / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * NICE.find((step) => step * power >= rough * 0.999);
}

function number(value, step) {
  const digits = Math.max(0, Math.min(4, -Math.floor(Math.log10(step) + 1e-9)));
  return value.toFixed(Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6 ? digits + 1 : digits);
}

export class Chart {
  static all = [];

  // figure: where it goes. told: title, unit, least (range), floor (fixed lower end or null),
  // series: {key, label, colour, dash, width, band: [low, high], digits}.
  constructor(figure, told) {
    this.told = told;
    this.levels = [];
    this.empty = told.empty ?? ""; // what stands in it while none of its curves has a value
    this.view = LIVE;
    this.fixed = null; // ends of the axis that were set by hand: {low, high}; null for automatic ones
    const caption = document.createElement("figcaption");
    const title = document.createElement("h2");
    title.textContent = told.title;
    const unit = document.createElement("span");
    unit.className = "unit";
    unit.textContent = told.unit;
    title.append(" ", unit);
    const legend = document.createElement("ul");
    this.values = {};
    for (const series of told.series) {
      if (!series.label) continue;
      const item = document.createElement("li");
      const key = document.createElement("i");
      key.className = `key ${series.colour} ${series.dash ? "dashed" : ""}`;
      const value = document.createElement("output");
      item.append(key, series.label, " ", value);
      legend.append(item);
      this.values[series.key] = value;
    }
    caption.append(title, legend);
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", told.title);
    figure.append(caption, this.canvas);
    this.under = null; // where the cursor is, as a part of the axis of time; null if it is over no chart
    Chart.all.push(this);
    // The cursor is over all charts at once, so that the values of all curves are told of one time.
    const over = (at) => { for (const chart of Chart.all) { chart.under = at; chart.redraw(); } };
    this.canvas.addEventListener("pointermove", (event) =>
      over(Math.min(1, Math.max(0, (event.offsetX - LEFT) / (this.width - RIGHT - LEFT)))));
    this.canvas.addEventListener("pointerleave", () => over(null));
    this.resized = true;
    new ResizeObserver(() => { this.resized = true; this.redraw(); }).observe(this.canvas);
  }

  redraw() {
    if (this.points) this.draw(this.points, this.view);
  }

  colours() {
    const style = getComputedStyle(this.canvas);
    const of = (name) => style.getPropertyValue(`--${name}`).trim();
    this.palette = {};
    for (const series of this.told.series) this.palette[series.colour] = of(series.colour);
    for (const name of ["grid", "quiet", "warn"]) this.palette[name] = of(name);
    this.font = `11px ${style.fontFamily}`;
  }

  fit() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth, clientHeight } = this.canvas;
    this.canvas.width = Math.round(clientWidth * ratio);
    this.canvas.height = Math.round(clientHeight * ratio);
    this.width = clientWidth;
    this.height = clientHeight;
    this.ratio = ratio;
    this.resized = false;
    this.colours();
  }

  range(points) {
    const count = Math.max(2, Math.min(5, Math.floor(this.height / 42)));
    if (this.fixed) return { ...this.fixed, step: niceStep(this.fixed.high - this.fixed.low, count) };
    let low = Infinity, high = -Infinity;
    const look = (value) => {
      if (value === null || value === undefined) return;
      if (value < low) low = value;
      if (value > high) high = value;
    };
    for (const series of this.told.series) {
      for (const key of [series.key, ...(series.band ?? [])]) {
        for (const column of [points[key], points.high?.[key]]) for (const value of column ?? []) look(value);
      }
    }
    // A level that is far off would flatten the curves: it is said in words instead.
    for (const level of this.levels) if (level.value < 4 * Math.max(high, this.told.least)) look(level.value);
    if (low > high) [low, high] = [0, this.told.least];
    // A gauge without pressure reads a little below its zero: that does not open an axis below it.
    if (this.told.floor !== null && low > this.told.floor - NEAR_ZERO * this.told.least) low = this.told.floor;
    const middle = (low + high) / 2;
    if (high - low < this.told.least) {
      const half = this.told.least / 2;
      [low, high] = this.told.floor === null ? [middle - half, middle + half] : [low, low + this.told.least];
    }
    const now = this.ends;
    // The axis stays while the curves fill it; as much as half of it may be empty.
    const isKept = now && low >= now.low && high <= now.high && high - low > 0.5 * (now.high - now.low)
      && !(this.told.floor !== null && low >= this.told.floor && now.low < this.told.floor);
    if (isKept) return now;
    const step = niceStep((high - low) * 1.1, count);
    this.ends = {
      low: Math.floor((low - 0.02 * (high - low)) / step) * step,
      high: Math.ceil((high + 0.02 * (high - low)) / step) * step,
      step,
    };
    if (this.told.floor !== null && low >= this.told.floor) this.ends.low = this.told.floor;
    return this.ends;
  }

  // points: times, and a column for each curve; those of the history also have high, with the
  // greatest values by the same names, where the columns themselves hold the least ones.
  draw(points, view = LIVE) {
    this.points = points;
    this.view = view;
    if (this.resized) this.fit();
    if (!this.width) return;
    const context = this.canvas.getContext("2d", { willReadFrequently: true });
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    const ends = this.range(points);
    const left = LEFT, right = this.width - RIGHT, top = 8, bottom = this.height - 20;
    const time = points.time_s;
    const now = view.end_s ?? (time.length ? time[time.length - 1] : 0);
    const x = (t) => left + (right - left) * (1 - (now - t) / view.span_s);
    const y = (v) => bottom - (bottom - top) * (v - ends.low) / (ends.high - ends.low);
    this.grid(context, ends, { left, right, top, bottom }, y);
    if (this.empty && time.length && this.told.series.every(({ key }) => (points[key] ?? []).every((value) => value === null))) {
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.font = this.font.replace("11px", "14px");
      context.fillText(this.empty, (left + right) / 2, (top + bottom) / 2);
    }
    context.save();
    context.beginPath();
    context.rect(left, top, right - left, bottom - top);
    context.clip();
    for (const series of this.told.series) this.band(context, series, points, x, y);
    const isHere = (key) => this.told.series.some((series) => series.key === key);
    const triggered = view.level && isHere(view.level.key) ? [view.level] : [];
    for (const level of [...this.levels, ...triggered]) {
      context.strokeStyle = this.palette.warn;
      context.setLineDash([7, 5]);
      context.lineWidth = 1.4;
      context.beginPath();
      context.moveTo(left, y(level.value));
      context.lineTo(right, y(level.value));
      context.stroke();
    }
    for (const series of this.told.series) this.line(context, series, points, x, y);
    if (view.mark_s !== undefined) this.mark(context, x(view.mark_s), top, bottom);
    context.restore();
    // Under the cursor its own values are told, otherwise the newest ones.
    const at = this.under === null ? this.newest(points) : this.nearest(time, now - (1 - this.under) * view.span_s);
    if (this.under !== null && at >= 0) this.cursor(context, x(time[at]), top, bottom, view.told(now - time[at]));
    for (const series of this.told.series) {
      const output = this.values[series.key];
      const text = at >= 0 ? this.value(points, series, at) : "-";
      if (output && output.textContent !== text) output.textContent = text;
    }
  }

  // Returns a curve's value at a point as text; of a step of the history from least to greatest.
  value(points, series, at) {
    const low = points[series.key]?.[at] ?? null;
    if (low === null) return "-";
    const [least, most] = [low, points.high?.[series.key]?.[at] ?? low].map((value) => value.toFixed(series.digits));
    return least === most ? least : `${least} to ${most}`;
  }

  // Returns the index of the newest point; in the history of the newest step that has a value.
  newest(points) {
    let at = points.time_s.length - 1;
    const isEmpty = () => this.told.series.every((series) => (points[series.key]?.[at] ?? null) === null);
    if (points.high) while (at > 0 && isEmpty()) at -= 1;
    return at;
  }

  // Returns the index of the point that is nearest to a time; -1 if there is none.
  nearest(time, wanted) {
    let low = 0, high = time.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (time[middle] < wanted) low = middle + 1; else high = middle;
    }
    return low > 0 && wanted - time[low - 1] < time[low] - wanted ? low - 1 : Math.min(low, time.length - 1);
  }

  mark(context, at, top, bottom) {
    context.strokeStyle = this.palette.warn;
    context.setLineDash([]);
    context.lineWidth = 1.4;
    context.beginPath();
    context.moveTo(at, top);
    context.lineTo(at, bottom);
    context.stroke();
  }

  cursor(context, at, top, bottom, text) {
    context.strokeStyle = this.palette.quiet;
    context.fillStyle = this.palette.quiet;
    context.setLineDash([]);
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(at, top);
    context.lineTo(at, bottom);
    context.stroke();
    context.textAlign = at > this.width / 2 ? "right" : "left";
    context.textBaseline = "top";
    context.font = this.font;
    context.fillText(text, at + (at > this.width / 2 ? -4 : 4), top);
  }

  grid(context, ends, box, y) {
    context.setLineDash([]);
    context.lineWidth = 1;
    context.strokeStyle = this.palette.grid;
    context.fillStyle = this.palette.quiet;
    context.font = this.font;
    context.textAlign = "right";
    context.textBaseline = "middle";
    context.beginPath();
    for (let value = ends.low; value <= ends.high + ends.step / 2; value += ends.step) {
      const at = Math.round(y(value)) + 0.5;
      context.moveTo(box.left, at);
      context.lineTo(box.right, at);
      context.fillText(number(Math.abs(value) < 1e-9 ? 0 : value, ends.step), box.left - 6, at);
    }
    context.stroke();
    context.textBaseline = "top";
    // From the newest on; a label that would touch the one beside it is left out.
    let free = box.right + 1;
    this.labels = [];
    for (const [back, text] of [...this.view.ticks].sort((one, other) => one[0] - other[0])) {
      const at = box.left + (box.right - box.left) * (1 - back / this.view.span_s);
      const width = context.measureText(text).width;
      const begin = Math.max(box.left, Math.min(at - width / 2, box.right - width));
      if (begin + width > free) continue;
      free = begin - 8;
      context.textAlign = "left";
      context.fillText(text, begin, box.bottom + 6);
      this.labels.push([begin, begin + width]);
    }
  }

  // Calls draw for each stretch without a gap, [begin, end) of the points.
  stretches(points, isThere, draw) {
    const { time_s: time, test } = points; // stretches of the history have no tests
    let begin = -1;
    for (let k = 0; k <= time.length; k++) {
      const there = k < time.length && isThere(k);
      const joined = begin >= 0 && there && time[k] - time[k - 1] < this.view.gap_s && test?.[k] === test?.[k - 1];
      if (begin >= 0 && !joined) { draw(begin, k); begin = -1; }
      if (there && begin < 0) begin = k;
    }
  }

  line(context, series, points, x, y) {
    const column = points[series.key];
    if (!column) return;
    const high = points.high?.[series.key];
    context.strokeStyle = this.palette[series.colour];
    context.lineWidth = series.width ?? 1.8;
    context.lineJoin = "round";
    context.setLineDash(high ? [] : series.dash ?? []);
    // Long spans are filled from least to greatest; a curve behind another one is still to be seen.
    context.globalAlpha = high ? 0.75 : 1;
    this.stretches(points, (k) => column[k] !== null, (begin, end) => {
      context.beginPath();
      for (let k = begin; k < end; k++) {
        context.lineTo(x(points.time_s[k]), y(column[k]));
        // The end of the step, so that one that stands alone between two gaps is seen as well.
        if (high) context.lineTo(x(points.time_s[k] + this.view.step_s), y(high[k]));
      }
      context.stroke();
    });
    context.globalAlpha = 1;
  }

  band(context, series, points, x, y) {
    if (!series.band) return;
    const low = points[series.band[0]], high = (points.high ?? points)[series.band[1]];
    if (!low || !high) return;
    context.fillStyle = this.palette[series.colour];
    context.globalAlpha = 0.18;
    this.stretches(points, (k) => low[k] !== null && high[k] !== null, (begin, end) => {
      context.beginPath();
      for (let k = begin; k < end; k++) context.lineTo(x(points.time_s[k]), y(high[k]));
      for (let k = end - 1; k >= begin; k--) context.lineTo(x(points.time_s[k]), y(low[k]));
      context.fill();
    });
    context.globalAlpha = 1;
  }
}
