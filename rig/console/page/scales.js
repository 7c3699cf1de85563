// The scales of the charts: automatic, or fixed between two values that can be written beside each chart.

import { element } from "./words.js";

const by = (id) => document.getElementById(id);

export class Scales {
  constructor(charts) {
    this.charts = charts;
    this.fields = {};
    for (const [name, chart] of Object.entries(charts)) this.place(name, chart);
    by("scale").addEventListener("click", () => this.fix(by("scale").getAttribute("aria-pressed") !== "true"));
  }

  place(name, chart) {
    const [low, high] = ["least", "greatest"].map((end) => {
      const input = element("input", "");
      input.type = "number";
      input.step = "any";
      input.setAttribute("aria-label", `${end} value of the scale`);
      input.addEventListener("change", () => this.take(name));
      return input;
    });
    const line = element("p", "ends", "Scale from ", low, " to ", high);
    line.hidden = true;
    chart.canvas.before(line);
    this.fields[name] = { line, low, high };
  }

  // Keeps the scales as they are now, or makes them automatic again.
  fix(isFixed) {
    by("scale").setAttribute("aria-pressed", String(isFixed));
    by("scale").textContent = isFixed ? "Automatic scales" : "Fix the scales";
    for (const [name, chart] of Object.entries(this.charts)) {
      const { line, low, high } = this.fields[name];
      const ends = isFixed ? chart.ends ?? { low: 0, high: chart.told.least } : null;
      line.hidden = !isFixed;
      if (ends) [low.value, high.value] = [ends.low, ends.high].map((value) => Number(value.toPrecision(6)));
      chart.fixed = ends && { low: ends.low, high: ends.high };
      chart.redraw();
    }
  }

  // Takes what was written, if it makes a scale; a field that does not is marked.
  take(name) {
    const { low, high } = this.fields[name];
    const ends = { low: low.valueAsNumber, high: high.valueAsNumber };
    const isScale = ends.high > ends.low;
    for (const input of [low, high]) input.setCustomValidity(isScale ? "" : "the greatest value must be above the least one");
    high.reportValidity();
    if (!isScale) return;
    this.charts[name].fixed = ends;
    this.charts[name].redraw();
  }
}
