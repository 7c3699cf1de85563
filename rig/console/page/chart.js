// A strip chart: the last ten seconds on a canvas, drawn anew as often as points come.

const SHOWN_S = 10;
const GAP_S = 0.15;
const NICE = [1, 2, 2.5, 5, 10];
// How far below zero is still zero, as a part of the least range of the chart: 0.2 MPa of 1 MPa, which
// are 1 % of a gauge of 20 MPa.
const NEAR_ZERO = 0.2;

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
  // figure: where it goes. told: title, unit, least (range), floor (fixed lower end or null),
  // series: {key, label, colour, dash, width, band: [low, high], digits}.
  constructor(figure, told) {
    this.told = told;
    this.levels = [];
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
    this.canvas.setAttribute("aria-label", `${told.title}, the last ten seconds`);
    figure.append(caption, this.canvas);
    this.under = null; // where the cursor is over the chart, in pixels; null if it is not
    const over = (at) => { this.under = at; if (this.points) this.draw(this.points); };
    this.canvas.addEventListener("pointermove", (event) => over(event.offsetX));
    this.canvas.addEventListener("pointerleave", () => over(null));
    this.resized = true;
    new ResizeObserver(() => { this.resized = true; if (this.points) this.draw(this.points); })
      .observe(this.canvas);
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
    let low = Infinity, high = -Infinity;
    const look = (value) => {
      if (value === null || value === undefined) return;
      if (value < low) low = value;
      if (value > high) high = value;
    };
    for (const series of this.told.series) {
      if (points[series.key]) for (const value of points[series.key]) look(value);
      for (const key of series.band ?? []) for (const value of points[key] ?? []) look(value);
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
    const step = niceStep((high - low) * 1.1, Math.max(2, Math.min(5, Math.floor(this.height / 42))));
    this.ends = {
      low: Math.floor((low - 0.02 * (high - low)) / step) * step,
      high: Math.ceil((high + 0.02 * (high - low)) / step) * step,
      step,
    };
    if (this.told.floor !== null && low >= this.told.floor) this.ends.low = this.told.floor;
    return this.ends;
  }

  draw(points) {
    this.points = points;
    if (this.resized) this.fit();
    if (!this.width) return;
    const context = this.canvas.getContext("2d", { willReadFrequently: true });
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    const ends = this.range(points);
    const left = 46, right = this.width - 8, top = 8, bottom = this.height - 20;
    const time = points.time_s;
    const now = time.length ? time[time.length - 1] : 0;
    const x = (t) => left + (right - left) * (1 - (now - t) / SHOWN_S);
    const y = (v) => bottom - (bottom - top) * (v - ends.low) / (ends.high - ends.low);
    this.grid(context, ends, { left, right, top, bottom }, y);
    if (this.told.empty && time.length && points[this.told.series[0].key].every((value) => value === null)) {
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.font = this.font.replace("11px", "14px");
      context.fillText(this.told.empty, (left + right) / 2, (top + bottom) / 2);
    }
    context.save();
    context.beginPath();
    context.rect(left, top, right - left, bottom - top);
    context.clip();
    for (const series of this.told.series) this.band(context, series, points, x, y);
    for (const level of this.levels) {
      context.strokeStyle = this.palette.warn;
      context.setLineDash([7, 5]);
      context.lineWidth = 1.4;
      context.beginPath();
      context.moveTo(left, y(level.value));
      context.lineTo(right, y(level.value));
      context.stroke();
    }
    for (const series of this.told.series) this.line(context, series, points, x, y);
    context.restore();
    // Under the cursor its own values are told, otherwise the newest ones.
    const at = this.under === null ? time.length - 1 : this.nearest(time, now - (1 - (this.under - left) / (right - left)) * SHOWN_S);
    if (this.under !== null && at >= 0) this.cursor(context, x(time[at]), top, bottom, now - time[at]);
    for (const series of this.told.series) {
      const column = points[series.key];
      const last = column && at >= 0 ? column[at] : null;
      const output = this.values[series.key];
      const text = last === null || last === undefined ? "-" : last.toFixed(series.digits);
      if (output && output.textContent !== text) output.textContent = text;
    }
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

  cursor(context, at, top, bottom, back) {
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
    context.fillText(`-${back.toFixed(2)} s`, at + (at > this.width / 2 ? -4 : 4), top);
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
    for (let back = 0; back <= SHOWN_S; back += 2) {
      const at = box.left + (box.right - box.left) * (1 - back / SHOWN_S);
      context.textAlign = back === 0 ? "right" : back === SHOWN_S ? "left" : "center";
      context.fillText(back === 0 ? "now" : `-${back} s`, at, box.bottom + 6);
    }
  }

  // Calls draw for each stretch without a gap, [begin, end) of the points.
  stretches(points, isThere, draw) {
    const { time_s: time, test } = points;
    let begin = -1;
    for (let k = 0; k <= time.length; k++) {
      const there = k < time.length && isThere(k);
      const joined = begin >= 0 && there && time[k] - time[k - 1] < GAP_S && test[k] === test[k - 1];
      if (begin >= 0 && !joined) { draw(begin, k); begin = -1; }
      if (there && begin < 0) begin = k;
    }
  }

  line(context, series, points, x, y) {
    const column = points[series.key];
    if (!column) return;
    context.strokeStyle = this.palette[series.colour];
    context.lineWidth = series.width ?? 1.8;
    context.lineJoin = "round";
    context.setLineDash(series.dash ?? []);
    this.stretches(points, (k) => column[k] !== null, (begin, end) => {
      context.beginPath();
      for (let k = begin; k < end; k++) context.lineTo(x(points.time_s[k]), y(column[k]));
      context.stroke();
    });
  }

  band(context, series, points, x, y) {
    if (!series.band) return;
    const [low, high] = series.band.map((key) => points[key]);
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
