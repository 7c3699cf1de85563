(() => {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const CONFIG = {
    responsive: true,
    displaylogo: false,
    modeBarButtons: [["toImage"], ["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
  };

  const palette = () => {
    const style = getComputedStyle(document.documentElement);
    return (role) => style.getPropertyValue("--" + role).trim();
  };

  const layout = (colour, across) => {
    const axis = {
      gridcolor: colour("line"), zerolinecolor: colour("line"), linecolor: colour("line"),
      tickfont: { color: colour("quiet"), size: 11 }, automargin: true,
    };
    const title = (text) => ({ title: { text, font: { size: 12, color: colour("quiet") }, standoff: 6 } });
    return {
      margin: { l: 64, r: 12, t: 10, b: 40 }, showlegend: false, hovermode: "closest",
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", color: colour("ink") },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("quiet"), activecolor: colour("ink") },
      xaxis: { ...axis, ...title(across) }, yaxis: { ...axis, ...title("force, N") },
    };
  };
  const dots = (name, x, y, colour, more) => ({
    type: "scatter", mode: "markers", name, x, y, hovertemplate: `${name}: %{x:.4~g}, %{y:.4~g} N<extra></extra>`,
    marker: { color: colour, size: 8, ...more.marker }, ...(more.error_y ? { error_y: more.error_y } : {}),
  });
  const open = (flags, symbol) => flags.map((flag) => (flag ? `${symbol}-open` : symbol));
  const bars = (half, colour) => ({ type: "data", array: half, color: colour, thickness: 1.5 });

  const curve = (colour) => {
    const shown = figures.curve;
    const line = (y, style, name) => ({ type: "scatter", mode: "lines", name, x: shown.x, y, hoverinfo: "skip", line: style });
    const traces = [line(shown.model, { color: colour("reference"), width: 5 }, "model")];
    if (shown.fitted) {
      // A band in two halves: fills do not stop at the gap between them.
      const gap = shown.x.indexOf(null);
      [[0, gap], [gap + 1, shown.x.length]].forEach(([from, to]) => traces.push({
        type: "scatter", mode: "lines", hoverinfo: "skip", line: { width: 0 }, fill: "toself", opacity: 0.35, fillcolor: colour("found"),
        x: [...shown.x.slice(from, to), ...shown.x.slice(from, to).reverse()],
        y: [...shown.upper.slice(from, to), ...shown.lower.slice(from, to).reverse()],
      }));
      traces.push(line(shown.fitted, { color: colour("found"), width: 2 }, "fitted"));
    }
    const { speeds, slowing } = shown;
    traces.push(dots("slowing down, mm/s", slowing.x, slowing.y, colour("quiet"), { marker: { size: 5 } }));
    traces.push(dots("constant speed, mm/s", speeds.x, speeds.y, colour("chamber_1"),
      { marker: { symbol: open(speeds.open, "circle") }, error_y: bars(speeds.half, colour("chamber_1")) }));
    traces.push(dots("break-away", shown.break_away.map(() => 0), shown.break_away, colour("chamber_2"), { marker: { symbol: "diamond" } }));
    return traces;
  };

  const places = (colour) => {
    const { points, levels } = figures.places;
    const own = [colour("chamber_1"), colour("chamber_2")];
    const across = points.flatMap((each) => each.x);
    const ends = [Math.min(...across), Math.max(...across)];
    return [
      ...levels.map((level, index) => ({
        type: "scatter", mode: "lines", hoverinfo: "skip", x: ends, y: [level, level], line: { color: own[index], width: 1, dash: "dash" },
      })),
      ...points.map((each, index) => dots(`${each.name}, mm`, each.x, each.y, own[index],
        { marker: { symbol: open(each.open, "diamond") }, error_y: bars(each.half, own[index]) })),
    ];
  };

  const draw = () => {
    const colour = palette();
    Plotly.react(document.querySelector(".curve"), curve(colour), layout(colour, "velocity, mm/s"), CONFIG);
    Plotly.react(document.querySelector(".places"), places(colour), layout(colour, "position, mm"), CONFIG);
  };
  draw();
  dark.addEventListener("change", draw);
})();
