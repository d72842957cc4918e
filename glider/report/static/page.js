// Draws the charts of a page with plotly.js: the JSON of glider/report/chart.py.
"use strict";
(() => {
  const charts = JSON.parse(document.getElementById("charts").textContent);
  const root = document.documentElement;
  const darkness = window.matchMedia("(prefers-color-scheme: dark)");
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

  // A copy with "@color" and "#column" replaced by what they stand for.
  function resolve(value, columns) {
    if (typeof value === "string") {
      if (value.startsWith("@")) return color(value.slice(1));
      return value.startsWith("#") ? columns[value.slice(1)] : value;
    }
    if (Array.isArray(value)) {
      return typeof value[0] === "number" ? value : value.map((v) => resolve(v, columns));
    }
    if (value === null || typeof value !== "object") return value;
    return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, resolve(v, columns)]));
  }

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

  function toggle(parent, className, isOn, onChange) {
    const button = element("button", className, parent);
    button.type = "button";
    button.setAttribute("aria-pressed", isOn);
    button.addEventListener("click", () => {
      const now = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", now);
      onChange(now);
    });
    return button;
  }

  class Figure {
    constructor(node, chart) {
      this.chart = chart;
      this.hidden = new Set();  // Keys.
      this.flight = null;  // Number of the one that is picked.
      this.plots = [];  // {node, panel}
      this.isZooming = false;
      if (Object.keys(chart.keys).length) this.makeLegend(node);
      if (chart.flights.length) this.makeFlights(node);
      if (chart.choices.length) this.makeChoices(node);
      this.place = element("div", "panels", node);
      this.place.style.setProperty("--least", `${chart.least_width}rem`);
      this.fill();
    }

    makeLegend(node) {
      const legend = element("div", "legend", node);
      for (const [key, label] of Object.entries(this.chart.keys)) {
        const button = toggle(legend, "", true, (isShown) => {
          this.hidden[isShown ? "delete" : "add"](key);
          this.draw();
        });
        button.dataset.key = key;
        const dash = this.chart.dashes[key];
        const dashes = dash && dash !== "solid" ? ` stroke-dasharray="${dash.replaceAll("px", "")}"` : "";
        button.innerHTML = `<svg aria-hidden="true"><line x1="0" y1="5" x2="26" y2="5" stroke-width="4" style="stroke:var(--c-${key})"${dashes}/></svg>`;  // No data.
        element("span", "", button, label);
      }
    }

    makeFlights(node) {
      const tools = element("label", "tools", node, "flights ");
      const select = element("select", "pick", tools);
      element("option", "", select, "all").value = "";
      this.chart.flights.forEach((name, i) => { element("option", "", select, name).value = i; });
      select.addEventListener("change", () => {
        this.flight = select.value === "" ? null : Number(select.value);
        this.draw();
      });
    }

    makeChoices(node) {
      const { choices } = this.chart;
      const tools = element("div", "tools", node, "flights, from the worst to the best:");
      const several = (label, isWanted) => {
        const button = element("button", "pick", tools, label);
        button.type = "button";
        button.addEventListener("click", () => {
          choices.forEach((choice, i) => {
            choice.is_shown = isWanted(i);
            picks.children[i].setAttribute("aria-pressed", choice.is_shown);
          });
          this.fill();
        });
      };
      const first = choices.map((choice) => choice.is_shown);
      several("as at first", (i) => first[i]);
      several("worst three", (i) => i < 3);
      several("best three", (i) => i >= choices.length - 3);
      const picks = element("div", "picks", node);
      for (const choice of choices) {
        const button = toggle(picks, "pick", choice.is_shown, (isShown) => {
          choice.is_shown = isShown;
          this.fill();
        });
        button.append(`${choice.label} `);
        element("small", "", button, choice.note);
      }
    }

    // Makes the panels that are to be seen anew.
    fill() {
      this.plots.forEach(({ node }) => Plotly.purge(node));
      this.place.replaceChildren();
      const shown = this.chart.choices.filter((choice) => choice.is_shown);
      const panels = [...this.chart.panels, ...shown.flatMap((choice) => choice.panels)];
      this.plots = panels.map((panel) => {
        const box = element("div", "panel", this.place);
        writeTitle(element("h4", "", box), panel.title);
        const node = element("div", "plot", box);
        node.style.height = `${panel.height}px`;
        return { node, panel };
      });
      this.draw();
      for (const plot of this.plots) {
        plot.node.on("plotly_relayout", (change) => this.zoomLinked(plot, change));
      }
    }

    draw() {
      for (const { node, panel } of this.plots) {
        // What a reader has zoomed to stays.
        const seen = node.layout && { x: node.layout.xaxis, y: node.layout.yaxis };
        const layout = this.layout(panel);
        // A browser prints at once: the width is set here, not when it has settled.
        if (root.classList.contains("printing")) layout.width = node.clientWidth;
        for (const axis of ["x", "y"]) {
          if (seen && this.isZoomed(node, axis)) {
            layout[`${axis}axis`].range = seen[axis].range.slice();
            layout[`${axis}axis`].autorange = false;
          }
        }
        // What is undefined is left out: plotly.js takes it for a fault.
        Plotly.react(node, this.traces(panel), JSON.parse(JSON.stringify(layout)), CONFIG);
      }
    }

    isZoomed(node, axis) {
      return Boolean(node.zoomed && node.zoomed[axis]);
    }

    traces(panel) {
      return panel.traces.map((trace) => {
        const { key, of, ...rest } = trace;
        const made = resolve(rest, this.chart.columns);
        made.visible = !this.hidden.has(key);
        made.showlegend = false;
        made.hoverlabel = { align: "left" };
        if (of) this.pickRows(made, resolve(of, this.chart.columns));
        return made;
      });
    }

    // Tells flight and time of each row, and leaves out those of other flights.
    pickRows(trace, of) {
      const rows = [...of.flight.keys()].filter((i) => this.flight === null || of.flight[i] === this.flight);
      trace.text = rows.map((i) => {
        const time = of.time && of.time[i] !== null ? `, ${of.time[i].toFixed(3)} s` : "";
        return this.chart.flights[of.flight[i]] + time;
      });
      trace.x = rows.map((i) => trace.x[i]);
      trace.y = rows.map((i) => trace.y[i]);
      if (this.flight !== null && trace.mode === "lines") {
        trace.opacity = 1;
        trace.line = { ...trace.line, width: 2.2 };
      }
    }

    layout(panel) {
      const above = isTouch ? 34 : 8;  // Room for the buttons that a mouse calls up.
      const axis = (a) => ({
        title: { text: a.title, font: { size: 12 }, standoff: 6 },
        gridcolor: color("line"),
        linecolor: color("soft"),
        zeroline: false,
        automargin: true,
        type: a.is_log ? "log" : undefined,
        dtick: a.is_log ? (a.range && a.range[1] - a.range[0] < 1.3 ? "D2" : 1) : undefined,
        tickformat: a.is_log ? ",~r" : undefined,  // 0.001, not 1m.
        exponentformat: "none",
        nticks: 7,
        ...(a.range ? { range: a.range.slice() } : {}),
        ...resolve(a.more, {}),
      });
      return {
        height: panel.height,
        margin: { l: 8, r: 8, t: above, b: 8 },
        paper_bgcolor: "rgba(0,0,0,0)",
        plot_bgcolor: "rgba(0,0,0,0)",
        font: { family: getComputedStyle(document.body).fontFamily, size: 11.5, color: color("ink") },
        hovermode: "closest",
        dragmode: isTouch ? false : "zoom",  // A finger scrolls the page.
        modebar: { bgcolor: "rgba(0,0,0,0)", color: color("soft"), activecolor: color("ink") },
        xaxis: axis(panel.x),
        yaxis: axis(panel.y),
        shapes: resolve(panel.shapes, {}),
        barmode: panel.traces.some((trace) => trace.type === "bar") ? panel.barmode : undefined,
      };
    }

    // Zooms the panels that share an axis with one that was zoomed.
    zoomLinked(plot, change) {
      for (const axis of ["x", "y"]) {
        const name = `${axis}axis`;
        const reset = change[`${name}.autorange`] || change[`${name}.showspikes`] !== undefined;
        if (change[`${name}.range[0]`] === undefined && !change[`${name}.range`] && !reset) continue;
        plot.node.zoomed = { ...plot.node.zoomed, [axis]: true };
        if (this.isZooming || !plot.panel[axis].link) continue;
        this.isZooming = true;
        const { range } = plot.node.layout[name];
        const others = this.plots.filter((p) => p !== plot && p.panel[axis].link === plot.panel[axis].link);
        Promise.all(others.map(({ node }) => {
          node.zoomed = { ...node.zoomed, [axis]: true };
          return Plotly.relayout(node, { [`${name}.range`]: range.slice() });
        })).finally(() => { this.isZooming = false; });
      }
    }

    resize() {
      return Promise.all(this.plots.map(({ node }) => Plotly.Plots.resize(node)));
    }
  }

  const CONFIG = {
    displaylogo: false,
    responsive: true,
    showSendToCloud: false,  // Nothing leaves the page.
    displayModeBar: isTouch ? true : "hover",
    modeBarButtonsToRemove: ["select2d", "lasso2d", "toImage", "sendDataToCloud", "sendChartToCloud", ...(isTouch ? ["zoom2d"] : [])],
  };

  const figures = [...document.querySelectorAll("[data-chart]")].map(
    (node) => new Figure(node, charts[node.dataset.chart]),
  );
  const drawAll = () => figures.forEach((figure) => figure.draw());
  darkness.addEventListener("change", drawAll);

  // On paper: light, and as wide as the sheet.
  function printing(isOn) {
    root.classList.toggle("printing", isOn);
    drawAll();
    if (!isOn) figures.forEach((figure) => figure.resize());
  }
  window.addEventListener("beforeprint", () => printing(true));
  window.addEventListener("afterprint", () => printing(false));
})();
