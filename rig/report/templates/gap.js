(() => {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const touch = matchMedia("(pointer: coarse)");
  const CONFIG = {
    responsive: true,
    displaylogo: false,
    modeBarButtons: [["toImage"], ["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
  };

  const palette = () => {
    const style = getComputedStyle(document.documentElement);
    return (role) => style.getPropertyValue("--" + role).trim();
  };

  const finished = (trace, colour) => {
    const own = colour(trace.meta.role);
    const done = { type: "scatter", ...trace };
    if (done.type === "bar") return { ...done, marker: { color: own }, hovertemplate: "%{y:.3~g}" };
    done.line = { width: 2, ...trace.line, color: own };
    done.marker = { color: own, size: 6 };
    if (trace.fill) done.fillcolor = own + "30";
    if (!trace.hoverinfo) done.hovertemplate = `%{y:.4~g} ${trace.meta.unit}`;
    return done;
  };

  const layout = (figure, colour) => {
    const axis = {
      gridcolor: colour("line"), zerolinecolor: colour("quiet"), linecolor: colour("line"),
      tickfont: { color: colour("quiet"), size: 11 }, automargin: true,
    };
    const title = (text) => ({ title: { text, font: { size: 12, color: colour("quiet") }, standoff: 8 } });
    return {
      margin: { l: 60, r: 12, t: 10, b: 44 }, showlegend: false, hovermode: "x unified", barmode: "group",
      dragmode: touch.matches ? false : "zoom",
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", color: colour("ink") },
      hoverlabel: { bgcolor: colour("page"), bordercolor: colour("line"), font: { color: colour("ink"), size: 12 } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("quiet"), activecolor: colour("ink") },
      xaxis: { ...axis, ...title(figure.across), zeroline: false },
      yaxis: { ...axis, ...title(figure.up), nticks: 7, ...(figure.log ? { type: "log" } : {}) },
    };
  };

  const draw = () => {
    const colour = palette();
    document.querySelectorAll("[data-plot]").forEach((plot) => {
      const figure = figures[plot.dataset.plot];
      Plotly.react(plot, figure.traces.map((trace) => finished(trace, colour)), layout(figure, colour), CONFIG);
    });
  };
  draw();
  dark.addEventListener("change", draw);
})();
