(() => {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const roles = {
    all: "ink", "external_leakage_1": "chamber_1", "external_leakage_2": "chamber_2",
    "internal_leakage": "internal",
  };
  const words = (place) => (place === "all" ? "all leaks" : place.replaceAll("_", " "));
  const draw = () => {
    const style = getComputedStyle(document.documentElement);
    const colour = (role) => style.getPropertyValue("--" + role).trim();
    const axis = (title, more) => ({
      title: { text: title, font: { size: 12 } }, gridcolor: colour("line"), zerolinecolor: colour("line"),
      linecolor: colour("line"), tickfont: { color: colour("quiet"), size: 11 }, automargin: true, ...more,
    });
    // A flow's axis, with ticks at 1, 2 and 5 of each decade, in full.
    const flowAxis = (title) => {
      const ticks = [];
      for (let decade = -6; decade < 4; decade += 1) {
        for (const step of [1, 2, 5]) ticks.push(Number(`${step}e${decade}`));
      }
      return axis(title, { type: "log", tickmode: "array", tickvals: ticks, ticktext: ticks.map(String), tickangle: 0 });
    };
    const plot = (id, traces, layout) => {
      const place = document.getElementById(id);
      if (!place) return;
      Plotly.react(place, traces, {
        margin: { l: 56, r: 14, t: 12, b: 46 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
        font: { family: "system-ui, sans-serif", color: colour("ink"), size: 12 },
        legend: { orientation: "h", y: -0.24, x: 0 }, ...layout,
      }, { responsive: true, displaylogo: false, displayModeBar: false });
    };

    const power = [];
    // Without a curve of all leaks, as of an adaptive sweep, each place is shown at once.
    const shown = (place) => (place === "all" || !("all" in figures.power) ? true : "legendonly");
    const wanted = Math.max(0, ...Object.values(figures.power).map((curve) => curve.wanted));
    for (const [place, curve] of Object.entries(figures.power)) {
      const shade = colour(roles[place] || "accent");
      power.push({
        type: "scatter", mode: "markers", name: words(place), legendgroup: place, x: curve.flow, y: curve.part,
        text: curve.text, hovertemplate: `%{x:.3~g} L/min: %{text} (%{y:.0f} %)<extra>${words(place)}</extra>`,
        marker: { color: shade, size: 7 }, visible: shown(place),
        error_y: { type: "data", array: curve.above, arrayminus: curve.below, color: shade, thickness: 1 },
      });
      if (curve.curve) {
        power.push({
          type: "scatter", mode: "lines", legendgroup: place, showlegend: false, hoverinfo: "skip",
          x: curve.curve.flow, y: curve.curve.part, line: { color: shade, width: 1.5 },
          visible: shown(place),
        });
      }
    }
    plot("power", power, {
      xaxis: flowAxis("leak flow, L/min"), yaxis: axis("named right, %", { range: [-3, 103] }),
      shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: wanted, y1: wanted, line: { color: colour("quiet"), dash: "dash", width: 1 } }],
    });

    const roc = Object.entries(figures.roc).map(([place, curve]) => ({
      type: "scatter", mode: "lines", name: `${words(place)} (${curve.area})`, x: curve.alarms, y: curve.found,
      line: { color: colour(roles[place] || "accent"), width: place === "all" ? 2.5 : 1.5, shape: "hv" },
      hovertemplate: "%{y:.1f} % found, %{x:.1f} % accused<extra></extra>",
    }));
    plot("roc", roc, {
      xaxis: axis("healthy cases accused, %", { range: [-1, 101] }), yaxis: axis("leaks found, %", { range: [-1, 101] }),
      shapes: [{ type: "line", x0: 0, x1: 100, y0: 0, y1: 100, line: { color: colour("reference"), dash: "dot", width: 1 } }],
    });

    const matrix = figures.confusion;
    // Which of ink and page is read better on a mixture of surface and accent (WCAG 2.1 contrast).
    const rgb = (role) => {
      const canvas = document.createElement("canvas").getContext("2d");
      canvas.fillStyle = colour(role);
      canvas.fillRect(0, 0, 1, 1);
      return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3);
    };
    const luminance = (parts) => parts
      .map((part) => (part / 255 <= 0.04045 ? part / 255 / 12.92 : ((part / 255 + 0.055) / 1.055) ** 2.4))
      .reduce((sum, part, k) => sum + part * [0.2126, 0.7152, 0.0722][k], 0);
    const [surface, accent, ink, page] = ["surface", "accent", "ink", "page"].map(rgb);
    const readable = (share) => {
      const back = luminance(surface.map((part, k) => part + share * (accent[k] - part)));
      const contrast = (text) => {
        const [low, high] = [luminance(text), back].sort((one, other) => one - other);
        return (high + 0.05) / (low + 0.05);
      };
      return colour(contrast(ink) >= contrast(page) ? "ink" : "page");
    };
    const notes = [];
    matrix.counts.forEach((row, i) => row.forEach((count, j) => {
      if (!count) return;
      notes.push({
        x: matrix.verdicts[j], y: matrix.injected[i], text: matrix.right[i][j] ? `<b>${count}</b>` : String(count),
        showarrow: false, font: { color: readable(matrix.parts[i][j] / 100), size: 13 },
      });
    }));
    plot("confusion", [{
      type: "heatmap", x: matrix.verdicts, y: matrix.injected, z: matrix.parts, zmin: 0, zmax: 100, showscale: false,
      colorscale: [[0, colour("surface")], [1, colour("accent")]], xgap: 2, ygap: 2,
      hovertemplate: "injected %{y}, verdict %{x}: %{z:.1f} %<extra></extra>",
    }], {
      annotations: notes, margin: { l: 130, r: 14, t: 12, b: 90 },
      xaxis: axis("", { tickangle: -25, side: "bottom", showgrid: false }), yaxis: axis("", { autorange: "reversed", showgrid: false }),
    });

    const single = document.getElementById("single");
    if (single) {
      const cases = figures.cases;
      const sized = cases.estimate.some((value) => value !== null);
      const latent = cases.latency.some((value) => value !== null);
      if (!sized && !latent) {
        single.closest("figure").hidden = true;
        return;
      }
      const values = sized ? cases.estimate : cases.latency;
      const unit = sized ? "L/min" : "s";
      document.getElementById("single-title").textContent = sized ? "Leaks as sized" : "Time to the right verdict";
      document.getElementById("single-words").textContent = sized
        ? "Estimated against true flow of every leak that was sized; the line is where they agree."
        : "From the onset to the verdict held at the end, of leaks named right.";
      const traces = [...new Set(cases.fault)].sort().map((fault) => {
        const at = cases.fault.map((name, i) => (name === fault && values[i] !== null ? i : -1)).filter((i) => i >= 0);
        return {
          type: "scatter", mode: "markers", name: fault, x: at.map((i) => cases.flow[i]), y: at.map((i) => values[i]),
          text: at.map((i) => `case ${cases.case[i]}: ${cases.verdict[i]}`),
          hovertemplate: `%{text}<br>%{x:.3~g} L/min, %{y:.3~g} ${unit}<extra></extra>`,
          marker: {
            color: colour(roles[fault.replaceAll(" ", "_")] || "accent"), size: 5, opacity: 0.75,
            symbol: at.map((i) => (cases.right[i] ? "circle" : "x")),
          },
        };
      });
      const flows = cases.flow.filter((value) => value !== null);
      if (sized && flows.length) {
        const ends = [Math.min(...flows), Math.max(...flows)];
        traces.push({ type: "scatter", mode: "lines", x: ends, y: ends, showlegend: false, hoverinfo: "skip", line: { color: colour("reference"), dash: "dot", width: 1.5 } });
      }
      plot("single", traces, {
        xaxis: flowAxis("true flow, L/min"),
        showlegend: true, yaxis: sized ? flowAxis("estimated flow, L/min") : axis("latency, s", { rangemode: "tozero" }),
      });
    }
  };
  draw();
  dark.addEventListener("change", draw);
})();
