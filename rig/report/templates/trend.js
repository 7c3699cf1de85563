(() => {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const draw = () => {
    const style = getComputedStyle(document.documentElement);
    const colour = (role) => style.getPropertyValue("--" + role).trim();
    const axis = {
      gridcolor: colour("line"), zerolinecolor: colour("line"), linecolor: colour("line"),
      tickfont: { color: colour("quiet"), size: 11 }, automargin: true,
    };
    document.querySelectorAll(".trend").forEach((plot) => {
      const figure = figures[Number(plot.dataset.figure)];
      const traces = [{
        type: "scatter", mode: "markers", x: figure.at, y: figure.values, text: figure.runs,
        hovertemplate: `%{text}: %{y:.4~g} ${figure.unit}<extra></extra>`,
        marker: { color: colour("accent"), size: 8 },
        error_y: { type: "data", array: figure.halves, color: colour("quiet"), thickness: 1.5 },
      }];
      if (figure.line) {
        traces.push({
          type: "scatter", mode: "lines", hoverinfo: "skip",
          x: [figure.at[0], figure.at[figure.at.length - 1]], y: figure.line,
          line: { color: colour("reference"), dash: "dash", width: 2 },
        });
      }
      Plotly.react(plot, traces, {
        margin: { l: 64, r: 12, t: 10, b: 40 }, showlegend: false, height: 220,
        paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
        font: { family: "system-ui, sans-serif", color: colour("ink") },
        xaxis: { ...axis, type: "date" }, yaxis: axis,
      }, { responsive: true, displaylogo: false, displayModeBar: false });
    });
  };
  draw();
  dark.addEventListener("change", draw);
})();
