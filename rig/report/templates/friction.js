(() => {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const CONFIG = {
    responsive: true,
    displaylogo: false,
    modeBarButtons: [["toImage"], ["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
  };
  const names = [...document.querySelectorAll(".colour")].map((dot) => dot.parentElement.textContent);

  const palette = () => {
    const style = getComputedStyle(document.documentElement);
    return (role) => style.getPropertyValue("--" + role).trim();
  };
  // From blue to orange in the order of time.
  const ofRun = (run) => `hsl(${210 + (180 * run) / Math.max(names.length - 1, 1)} 70% ${dark.matches ? 65 : 42}%)`;

  const layout = (colour, across, up) => {
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
      xaxis: { ...axis, ...title(across) }, yaxis: { ...axis, ...title(up) },
    };
  };

  const curves = (colour) => figures.curves.map((trace) => {
    const run = trace.meta.run;
    const own = run === null ? colour("reference") : ofRun(run);
    return {
      ...trace, type: "scatter", hovertemplate: "%{x:.4~g} mm/s, %{y:.4~g} N",
      line: { color: own, width: run === null ? 5 : 2 },
      marker: { color: own, size: 6 },
      ...(trace.error_y ? { error_y: { ...trace.error_y, color: own } } : {}),
    };
  });

  const trend = (figure, colour) => [{
    type: "scatter", mode: "lines", hoverinfo: "skip", x: [0.5, names.length + 0.5], y: [figure.model, figure.model],
    line: { color: colour("reference"), dash: "dash", width: 2 },
  }, {
    type: "scatter", mode: "markers", x: names.map((_, run) => run + 1), y: figure.values, text: names,
    hovertemplate: `%{text}: %{y:.4~g} ${figure.unit}<extra></extra>`,
    marker: { color: names.map((_, run) => ofRun(run)), size: 8 },
    error_y: { type: "data", array: figure.halves, color: colour("quiet"), thickness: 1.5 },
  }];

  const draw = () => {
    const colour = palette();
    document.querySelectorAll(".colour").forEach((dot) => { dot.style.background = ofRun(Number(dot.dataset.run)); });
    Plotly.react(document.querySelector(".curves"), curves(colour), layout(colour, "velocity, mm/s", "friction, N"), CONFIG);
    document.querySelectorAll(".trend").forEach((plot, index) => {
      const figure = figures.trends[index];
      const arranged = layout(colour, "recording", figure.unit);
      arranged.xaxis.dtick = Math.ceil(names.length / 12);
      Plotly.react(plot, trend(figure, colour), arranged, CONFIG);
    });
  };
  draw();
  dark.addEventListener("change", draw);
})();
