(() => {
  "use strict";
  const root = document.documentElement;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const touch = matchMedia("(pointer: coarse)");
  // On a touch screen the plot's buttons are always there and need their own line.
  const MARGIN = { l: 58, r: 10, t: touch.matches ? 30 : 8, b: 28 };
  const DASHES = { injected: "solid", removed: "solid", onset: "dash", detected: "dot", gone: "dash" };
  const CONFIG = {
    responsive: true,
    displaylogo: false,
    // Named one by one: the default bar offers to send the plot to a server.
    modeBarButtons: [["toImage"], ["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
    doubleClick: "reset+autosize",
  };
  const PAPER = { width: 680, height: 190, autosize: false };

  const palette = () => {
    const style = getComputedStyle(root);
    return (role) => style.getPropertyValue("--" + role).trim();
  };

  const finished = (trace, unit, colour) => {
    const own = colour(trace.meta.role);
    if (!trace.hoverinfo) trace.hovertemplate = `%{y:.4~g} ${unit}`;
    if (trace.line) trace.line.color = own;
    if (trace.marker) trace.marker.color = own;
    if (trace.fill) trace.fillcolor = own + "40";
    return trace;
  };

  const vertical = (mark, colour) => ({
    type: "line", xref: "x", yref: "paper", x0: mark.time, x1: mark.time, y0: 0, y1: 1,
    line: {
      width: mark.kind === "detected" ? 2 : 1.5,
      dash: DASHES[mark.kind],
      color: colour(["onset", "detected", "gone"].includes(mark.kind) ? "found" : "ink"),
    },
  });

  // What was planned and not run, as a shaded stretch.
  const unrecorded = (figures, colour) => figures.end - figures.recorded < 0.05 ? [] : [{
    type: "rect", xref: "x", yref: "paper", x0: figures.recorded, x1: figures.end, y0: 0, y1: 1,
    line: { width: 0 }, fillcolor: colour("line"), opacity: 0.5, layer: "below",
    label: { text: "not recorded", font: { color: colour("quiet"), size: 12 } },
  }];

  // What the loop did about a fault, as a shaded stretch.
  const reactions = (figures, first, colour) => figures.spans.map((span) => ({
    type: "rect", xref: "x", yref: "paper", x0: span.start, x1: span.end, y0: 0, y1: 1,
    line: { width: 0 }, fillcolor: colour("accent") + "18", layer: "below",
    ...(first ? { label: { text: span.text, textposition: "bottom center", font: { color: colour("accent"), size: 12 } } } : {}),
  }));

  // Labels of times that are near each other stand one above the other, each in the lowest row that has room for it.
  // Those for which no row is left are in the list above the plots only.
  const ROWS = 6;
  const placed = (figures, width) => {
    const ends = [];
    return figures.marks.flatMap((mark) => {
      const at = width * (mark.time - figures.start) / (figures.end - figures.start);
      const late = at > 0.8 * width, size = 6.2 * mark.text.length + 10;
      const from = late ? at - size : at;
      let row = ends.findIndex((end) => end <= from);
      if (row < 0) row = ends.length;
      if (row >= ROWS) return [];
      ends[row] = from + size;
      return [{ mark, row, late }];
    });
  };

  const labels = (all, colour) => all.map(({ mark, row, late }) => ({
    xref: "x", yref: "paper", x: mark.time, y: 1, yanchor: "bottom", yshift: 1 + 14 * row,
    xanchor: late ? "right" : "left", xshift: late ? -3 : 3, showarrow: false, text: mark.text,
    font: { size: 11.5, color: colour(mark.kind === "injected" || mark.kind === "removed" ? "ink" : "found") },
  }));

  const layout = (panel, figures, first, colour, width) => {
    const axis = {
      gridcolor: colour("line"), zerolinecolor: colour("line"), linecolor: colour("line"),
      tickfont: { color: colour("quiet"), size: 11 },
    };
    const labelled = first ? placed(figures, width) : [];
    const marked = Math.max(0, ...labelled.map(({ row }) => row + 1));
    return {
      margin: { ...MARGIN, t: MARGIN.t + 14 * marked + (marked ? 4 : 0) },
      showlegend: false, autosize: true, hovermode: "x unified",
      dragmode: touch.matches ? false : "zoom",
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", color: colour("ink") },
      hoverlabel: { bgcolor: colour("page"), bordercolor: colour("line"), font: { color: colour("ink"), size: 12 } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("quiet"), activecolor: colour("ink") },
      xaxis: {
        ...axis, ...(panel.across
          ? { ticksuffix: " " + panel.across, hoverformat: ".4~g" }
          : { range: [figures.start, figures.end], ticksuffix: " s", hoverformat: ".3f", zeroline: false }),
      },
      yaxis: {
        ...axis, fixedrange: touch.matches, nticks: 6,
        title: { text: panel.unit, font: { size: 12, color: colour("quiet") }, standoff: 6 },
        ...(panel.limits ? { range: panel.limits } : {}),
      },
      shapes: panel.across ? [] : [...unrecorded(figures, colour), ...reactions(figures, first, colour), ...figures.marks.map((mark) => vertical(mark, colour))],
      annotations: labels(labelled, colour),
    };
  };

  const plotsOf = (section) => [...section.querySelectorAll(".plot")];
  // Plots over another quantity than time.
  const apart = (plot) => plot.classList.contains("apart");

  // The same stretch of time in all plots of a test.
  const share = (section, source, change) => {
    if (section.dataset.sharing) return;
    const changed = Object.keys(change).some((key) => key.startsWith("xaxis.range") || key === "xaxis.autorange");
    if (!changed) return;
    const range = [...source.layout.xaxis.range];
    section.dataset.sharing = "yes";
    const others = plotsOf(section).filter((plot) => plot !== source && !apart(plot));
    Promise.all(others.map((plot) => Plotly.relayout(plot, { "xaxis.range": [...range] })))
      .finally(() => delete section.dataset.sharing);
  };

  const draw = (section) => {
    const store = section.querySelector(".figures");
    if (!store) return;
    // Read anew each time: plotly keeps what it is given.
    const figures = JSON.parse(store.textContent);
    const colour = palette();
    const drawn = section.dataset.drawn;
    section.dataset.drawn = "yes";
    plotsOf(section).forEach((plot, index) => {
      const figure = plot.closest(".panel");
      const panel = figures.panels[figure.dataset.panel];
      const keys = [...figure.querySelectorAll(".key")];
      const traces = panel.traces.map((trace, number) => {
        trace.visible = keys[number].getAttribute("aria-pressed") === "true";
        return finished(trace, panel.unit, colour);
      });
      const arranged = layout(panel, figures, index === 0, colour, plot.clientWidth - MARGIN.l - MARGIN.r);
      if (root.dataset.paper) Object.assign(arranged, PAPER);
      Plotly.react(plot, traces, arranged, CONFIG);
      if (drawn) return;
      plot.classList.toggle("apart", Boolean(panel.across));
      if (!apart(plot)) plot.on("plotly_relayout", (change) => share(section, plot, change));
      keys.forEach((key, number) => key.addEventListener("click", () => {
        const shown = key.getAttribute("aria-pressed") !== "true";
        key.setAttribute("aria-pressed", String(shown));
        Plotly.restyle(plot, { visible: shown }, [number]);
      }));
    });
    if (!drawn) followPointer(section);
  };

  // A hair line at the pointer's time through all plots: their margins are equal, so pixels are too.
  const followPointer = (section) => {
    section.addEventListener("pointermove", (event) => {
      const plot = event.target.closest(".plot");
      const at = plot ? event.clientX - plot.getBoundingClientRect().left : -99;
      const inside = plot && !apart(plot) && at >= MARGIN.l && at <= plot.clientWidth - MARGIN.r;
      section.style.setProperty("--cursor", (inside ? at : -99) + "px");
    });
    section.addEventListener("pointerleave", () => section.style.removeProperty("--cursor"));
  };

  const sections = [...document.querySelectorAll("details.test")];
  const redraw = () => sections.filter((section) => section.dataset.drawn).forEach(draw);

  sections.forEach((section) => {
    section.addEventListener("toggle", () => {
      if (section.open && !section.dataset.drawn) draw(section);
    });
    if (section.open) draw(section);
  });
  document.querySelectorAll("[data-open]").forEach((button) => button.addEventListener("click", () => {
    sections.forEach((section) => { section.open = button.dataset.open === "true"; });
  }));

  const reveal = () => {
    const target = document.getElementById(location.hash.slice(1));
    if (!target || !target.matches("details")) return;
    target.open = true;
    target.scrollIntoView();
  };
  addEventListener("hashchange", reveal);
  reveal();

  dark.addEventListener("change", redraw);
  addEventListener("beforeprint", () => {
    root.dataset.paper = "yes";
    sections.forEach((section) => {
      section.dataset.folded = section.open ? "" : "yes";
      section.open = true;
      draw(section);
    });
  });
  addEventListener("afterprint", () => {
    delete root.dataset.paper;
    redraw();
    sections.forEach((section) => { section.open = !section.dataset.folded; });
  });
})();
