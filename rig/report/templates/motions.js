(() => {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const CONFIG = { responsive: true, displaylogo: false, modeBarButtons: [["toImage"], ["zoom2d", "pan2d", "resetScale2d"]] };

  const draw = () => {
    const style = getComputedStyle(document.documentElement);
    const colour = (role) => style.getPropertyValue("--" + role).trim();
    const axis = (text) => ({
      title: { text, font: { size: 12, color: colour("quiet") }, standoff: 6 },
      gridcolor: colour("line"), zerolinecolor: colour("line"), linecolor: colour("line"),
      tickfont: { color: colour("quiet"), size: 11 }, automargin: true,
    });
    document.querySelectorAll(".plot").forEach((plot, index) => {
      const traces = figures[index].traces.map((trace) => ({
        ...trace, line: { ...trace.line, color: colour(trace.meta.role) },
        hovertemplate: "%{x:.3f} s, %{y:.4~g} " + figures[index].unit,
      }));
      Plotly.react(plot, traces, {
        margin: { l: 56, r: 12, t: 30, b: 40 }, hovermode: "closest",
        // Above the plot: below it the legend would cover the axis's title in small plots.
        legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: { color: colour("ink") } },
        paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
        font: { family: "system-ui, sans-serif", color: colour("ink") },
        modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("quiet"), activecolor: colour("ink") },
        xaxis: axis("time, s"), yaxis: axis(figures[index].unit),
      }, CONFIG);
    });
  };
  draw();
  dark.addEventListener("change", draw);
})();
