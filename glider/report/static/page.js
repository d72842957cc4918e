// Draws the figures of a page with plotly.js: the JSON of glider/report/as_page.py.
"use strict";

// Draws figures into the elements that name them; until the signal, if any, it redraws
// them when the colors change.
function drawFigures({ figures }, signal) {
  const root = document.documentElement;
  const isTouch = window.matchMedia("(pointer: coarse)").matches;

  // A color of the page: "key" or, translucent, "key/0.2".
  function color(name) {
    const [key, opacity] = name.split("/");
    const style = getComputedStyle(root);
    const hex = (style.getPropertyValue(`--c-${key}`) || style.getPropertyValue(`--${key}`)).trim();
    if (opacity === undefined) return hex;
    const channel = (i) => parseInt(hex.slice(i, i + 2), 16);
    return `rgba(${channel(1)},${channel(3)},${channel(5)},${opacity})`;
  }

  const scatter = ({ x, y, hover, opacity = 1 }) => ({
    type: "scatter", x, y, opacity,
    ...(hover ? { hoverinfo: "all", hovertemplate: `${hover}<extra></extra>` } : { hoverinfo: "skip" }),
  });

  // Traces of plotly.js for each kind of mark of glider/report/plots/figure.py.
  const TRACES = {
    Band: ({ key, x, low, high }) => {
      const edge = { type: "scatter", mode: "lines", x, hoverinfo: "skip", line: { width: 0, color: color(key) } };
      return [{ ...edge, y: low }, { ...edge, y: high, fill: "tonexty", fillcolor: color(`${key}/0.17`) }];
    },
    Line: (mark) => {
      const { key, line_width: width, dashes, has_dots, extra } = mark;
      const dash = dashes.map((part) => `${Number((part * width).toPrecision(3))}px`).join() || "solid";
      return [{
        ...scatter(mark), mode: has_dots ? "lines+markers" : "lines",
        line: { color: color(key), width, dash },
        ...(has_dots ? { marker: { color: color(key), size: 8 } } : {}),
        ...(extra ? { customdata: extra } : {}),
      }];
    },
    Points: (mark) => {
      const { key, size } = mark;
      return [{ ...scatter(mark), mode: "markers", marker: { color: color(key), size } }];
    },
  };

  // Shapes of plotly.js for what lies behind the axes.
  const SHAPES = {
    Level: ({ value, is_dotted }) => ({
      type: "line", xref: "paper", x0: 0, x1: 1, y0: value, y1: value, layer: "below",
      line: { color: color("soft"), width: 1, ...(is_dotted ? { dash: "dot" } : {}) },
    }),
    Ground: ({ key, start, end }) => ({
      type: "rect", layer: "below", line: { width: 0 }, fillcolor: color(`${key}/0.14`),
      yref: "paper", y0: 0, y1: 1, x0: start, x1: end,
    }),
  };

  function element(tag, className, parent, text) {
    const made = document.createElement(tag);
    if (className) made.className = className;
    if (text !== undefined) made.textContent = text;
    parent.append(made);
    return made;
  }

  // Titles may hold names of files: never HTML. "$C_n$" is a C with a subscript.
  function writeTitle(node, title) {
    title.split(/\$(C_\w)\$/).forEach((part, i) => {
      node.append(i % 2 ? part[0] : part);
      if (i % 2) element("sub", "", node, part[2]);
    });
  }

  function button(parent, className, label, onClick) {
    const made = element("button", className, parent, label);
    made.type = "button";
    made.addEventListener("click", onClick);
    return made;
  }

  function toggle(parent, className, isOn, onChange) {
    const made = button(parent, className, "", () => {
      const now = made.getAttribute("aria-pressed") !== "true";
      made.setAttribute("aria-pressed", now);
      onChange(now);
    });
    made.setAttribute("aria-pressed", isOn);
    return made;
  }

  class Figure {
    constructor(node, figure) {
      Object.assign(this, figure);
      this.hidden = new Set();  // Keys.
      this.flight = null;  // Number of the one that is picked.
      this.plots = [];  // {node, panel, zoomed}
      this.isZooming = false;
      this.every = [...this.panels, ...this.choices.flatMap((choice) => choice.panels)];
      if (Object.keys(this.keys).length) this.makeLegend(element("div", "legend", node));
      if (this.flights.length) this.makeFlights(element("label", "tools", node, "flights "));
      if (this.choices.length) this.makeChoices(node);
      this.place = element("div", "panels", node);
      this.place.style.setProperty("--least", "18.5rem");
      this.fill();
    }

    makeLegend(legend) {
      const marks = this.every.flatMap((panel) => panel.marks);
      for (const [key, label] of Object.entries(this.keys)) {
        const dashed = marks.find((mark) => mark.key === key && mark.dashes?.length);
        const dash = dashed ? dashed.dashes.map((part) => 2 * part).join() : "";
        const made = toggle(legend, "", true, (isShown) => {
          this.hidden[isShown ? "delete" : "add"](key);
          this.draw();
        });
        // Keys and dashes are the program's own, never data.
        made.innerHTML = `<svg aria-hidden="true"><line x1="0" y1="5" x2="26" y2="5" stroke-width="4" style="stroke:var(--c-${key})" stroke-dasharray="${dash}"/></svg>`;
        element("span", "", made, label);
      }
    }

    makeFlights(tools) {
      const select = element("select", "pick", tools);
      ["all", ...this.flights].forEach((name, i) => { element("option", "", select, name).value = i - 1; });
      select.addEventListener("change", () => {
        this.flight = select.value < 0 ? null : Number(select.value);
        this.draw();
      });
    }

    makeChoices(node) {
      const { choices } = this;
      const tools = element("div", "tools", node, "flights, from the worst to the best:");
      const picks = element("div", "picks", node);
      const show = (isWanted) => {
        choices.forEach((choice, i) => {
          choice.is_shown = isWanted(i);
          picks.children[i].setAttribute("aria-pressed", choice.is_shown);
        });
        this.fill();
      };
      const first = choices.map((choice) => choice.is_shown);
      button(tools, "pick", "initial choice", () => show((i) => first[i]));
      button(tools, "pick", "worst three", () => show((i) => i < 3));
      button(tools, "pick", "best three", () => show((i) => i >= choices.length - 3));
      for (const choice of choices) {
        const made = toggle(picks, "pick", choice.is_shown, (isShown) => {
          choice.is_shown = isShown;
          this.fill();
        });
        made.append(`${choice.label} `);
        element("small", "", made, choice.note);
      }
    }

    // Makes the panels that are to be seen.
    fill() {
      this.plots.forEach(({ node }) => Plotly.purge(node));
      this.place.replaceChildren();
      const shown = this.choices.filter((choice) => choice.is_shown).flatMap((choice) => choice.panels);
      this.plots = [...this.panels, ...shown].map((panel) => {
        const box = element("div", "panel", this.place);
        writeTitle(element("h4", "", box), panel.title);
        const node = element("div", "plot", box);
        node.style.height = `${panel.height}px`;
        return { node, panel, zoomed: {} };
      });
      this.draw();
      for (const plot of this.plots) {
        plot.node.on("plotly_relayout", (change) => this.zoomLinked(plot, change));
      }
    }

    draw() {
      for (const { node, panel, zoomed } of this.plots) {
        const layout = makeLayout(panel);
        // A browser prints at once: the width is set here, not when it has settled.
        if (root.classList.contains("printing")) layout.width = node.clientWidth;
        for (const axis of Object.keys(zoomed)) {  // What a reader has zoomed to stays.
          layout[axis].range = node.layout[axis].range.slice();
          layout[axis].autorange = false;
        }
        Plotly.react(node, panel.marks.flatMap((mark) => this.makeTraces(mark)), layout, CONFIG);
      }
    }

    makeTraces(mark) {
      const all = { visible: !this.hidden.has(mark.key), showlegend: false, hoverlabel: { align: "left" } };
      const traces = (TRACES[mark.is]?.(mark) ?? []).map((trace) => ({ ...trace, ...all }));
      if (mark.flight) this.pickFlight(mark, traces[0]);
      return traces;
    }

    // Each row has its flight and time; those of other flights are hidden.
    pickFlight({ flight, time }, trace) {
      const rows = [...flight.keys()].filter((i) => this.flight === null || flight[i] === this.flight);
      const said = (t) => (t === null ? "" : `, ${t.toFixed(3)} s`);
      trace.text = rows.map((i) => this.flights[flight[i]] + said(time[i]));
      for (const axis of ["x", "y"]) trace[axis] = rows.map((i) => trace[axis][i]);
    }

    // Zooms the panels that share an axis with one that was zoomed.
    zoomLinked(plot, change) {
      ["xaxis", "yaxis"].forEach((axis, i) => {
        if (!Object.keys(change).some((name) => name.startsWith(`${axis}.`))) return;
        plot.zoomed[axis] = true;
        const { link } = plot.panel["xy"[i]];
        if (this.isZooming || !link) return;
        this.isZooming = true;
        const { range } = plot.node.layout[axis];
        const others = this.plots.filter((p) => p !== plot && p.panel["xy"[i]].link === link);
        Promise.all(others.map((other) => {
          other.zoomed[axis] = true;
          return Plotly.relayout(other.node, { [`${axis}.range`]: range.slice() });
        })).finally(() => { this.isZooming = false; });
      });
    }
  }

  function makeAxis({ label, range, is_log }) {
    const axis = {
      title: { font: { size: 12 }, standoff: 6, ...(label ? { text: label } : {}) },
      gridcolor: color("line"),
      linecolor: color("soft"),
      zeroline: false,
      automargin: true,
      exponentformat: "none",
      nticks: 7,
    };
    if (range) axis.range = is_log ? range.map(Math.log10) : range.slice();
    if (is_log) {  // 0.001, not 1m; steps of two where the range is short.
      const dtick = range && axis.range[1] - axis.range[0] < 1.3 ? "D2" : 1;
      Object.assign(axis, { type: "log", tickformat: ",~r", dtick });
    }
    return axis;
  }

  function makeLayout(panel) {
    return {
      height: panel.height,
      margin: { l: 8, r: 8, t: isTouch ? 34 : 8, b: 8 },  // Above: buttons that a mouse calls up.
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: getComputedStyle(document.body).fontFamily, size: 11.5, color: color("ink") },
      hovermode: "closest",
      dragmode: isTouch ? false : "zoom",  // A finger scrolls the page.
      modebar: { bgcolor: "rgba(0,0,0,0)", color: color("soft"), activecolor: color("ink") },
      xaxis: makeAxis(panel.x),
      yaxis: makeAxis(panel.y),
      shapes: panel.marks.filter((mark) => SHAPES[mark.is]).map((mark) => SHAPES[mark.is](mark)),
    };
  }

  const CONFIG = {
    displaylogo: false,
    responsive: true,
    showSendToCloud: false,  // Nothing leaves the page.
    toImageButtonOptions: { format: "svg" },
    displayModeBar: isTouch ? true : "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "sendDataToCloud", "sendChartToCloud", ...(isTouch ? ["zoom2d"] : [])],
  };

  const drawn = [...document.querySelectorAll("[data-figure]")]
    .filter((node) => node.dataset.figure in figures)
    .map((node) => new Figure(node, figures[node.dataset.figure]));
  const drawAll = () => drawn.forEach((figure) => figure.draw());
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll, { signal });

  // On paper: light, and as wide as the sheet.
  function printing(isOn) {
    root.classList.toggle("printing", isOn);
    drawAll();
    if (!isOn) drawn.forEach((figure) => figure.plots.forEach(({ node }) => Plotly.Plots.resize(node)));
  }
  window.addEventListener("beforeprint", () => printing(true), { signal });
  window.addEventListener("afterprint", () => printing(false), { signal });
}

{
  const data = document.getElementById("figures");  // Of a page that is a file.
  if (data) drawFigures(JSON.parse(data.textContent));
}
