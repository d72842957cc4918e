// The page of a session: shows each view that the server sends.
"use strict";

const byId = (id) => document.getElementById(id);

/** An element with a text and children; nothing is ever read as HTML. */
function make(tag, text = "", attributes = {}, ...children) {
  const space = ["svg", "path", "line", "circle", "text"].includes(tag)
    ? "http://www.w3.org/2000/svg" : "http://www.w3.org/1999/xhtml";
  const element = document.createElementNS(space, tag);
  element.textContent = text;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

const isNumber = (value) => typeof value === "number";
const millimetres = (value) => (isNumber(value) ? `${(1e3 * value).toFixed(1)} mm` : "");

/** Evidence and coefficients of every effect, by name, against the number of throws. */
function histories(traces) {
  const found = new Map();
  for (const trace of traces) {
    for (const effect of trace.effects) {
      for (const [name, estimate] of Object.entries(effect.coefficients)) {
        const key = `${effect.kind}: ${name} [${estimate.unit}]`;
        if (!found.has(key)) found.set(key, []);
        found.get(key).push({ n: trace.flights.length, ...estimate });
      }
    }
  }
  return found;
}

/** A curve of values with error bars of two standard errors. */
function draw(points) {
  const width = 300, height = 120, left = 10;
  const most = Math.max(...points.map((p) => p.n));
  const ends = points.flatMap((p) => [p.value - 2 * (p.std ?? 0), p.value + 2 * (p.std ?? 0)]);
  const low = Math.min(0, ...ends), high = Math.max(0, ...ends);
  const x = (n) => left + ((width - 2 * left) * n) / most;
  const y = (v) => height - 20 - ((height - 30) * (v - low)) / (high - low || 1);
  const svg = make("svg", "", { class: "history", viewBox: `0 0 ${width} ${height}`, role: "img" });
  svg.append(make("line", "", { class: "zero", x1: 0, x2: width, y1: y(0), y2: y(0) }));
  svg.append(make("path", "", { d: "M" + points.map((p) => `${x(p.n)},${y(p.value)}`).join("L") }));
  for (const p of points) {
    const std = p.std ?? 0;
    svg.append(
      make("line", "", { class: "error", x1: x(p.n), x2: x(p.n), y1: y(p.value - 2 * std), y2: y(p.value + 2 * std) }),
      make("circle", "", { cx: x(p.n), cy: y(p.value), r: 3 }),
    );
  }
  svg.append(make("text", `${most} throws`, { x: width - left, y: height - 4, "text-anchor": "end" }));
  return svg;
}

function showEffects(traces) {
  const panels = [...histories(traces)].map(([name, points]) => {
    const last = points[points.length - 1];
    const spread = isNumber(last.std) ? ` ± ${last.std.toPrecision(2)}` : "";
    return make("div", "", {}, make("h3", name), draw(points),
      make("p", `${last.value.toPrecision(4)}${spread} after ${last.n} throws`, { class: "value" }));
  });
  byId("effects").replaceChildren(...panels);
  byId("no-effect").textContent = panels.length ? "" : "None was found yet.";
}

/** Where a throw ended, in words. */
function endOf(row) {
  if (row.perched === null) return "";
  return `${row.perched ? "perched" : "no perch"}, ${millimetres(row.miss)} from the wire`;
}

function showThrows(state) {
  const rows = [...state.throws].reverse().map((row) => {
    const why = state.excluded.filter((e) => e.file === row.name)
      .map((e) => (e.rows === "all" ? e.why : `lines ${e.rows}: ${e.why}`));
    if (row.fault) why.unshift(row.fault);
    const cells = [["plan", row.planned], ["end", endOf(row)],
      ["nominal, RMS", millimetres(row.errors.nominal)],
      ["corrected, RMS", millimetres(row.errors.corrected)], ["excluded", why.join("; ")]];
    return make("tr", "", {}, make("th", row.name.replace(".csv", "")),
      ...cells.map(([label, text]) => make("td", text, { "data-label": label })));
  });
  byId("throws").replaceChildren(...rows);
}

function showLast(view) {
  const last = view.drawn[view.drawn.length - 1], picture = byId("picture");
  picture.hidden = !last;
  if (!last) return;
  const row = view.state.throws.find((one) => one.name === last);
  const address = `throws/${encodeURIComponent(last.replace(".csv", ""))}.png?${row.sha256.slice(0, 12)}`;
  if (picture.getAttribute("src") !== address) picture.setAttribute("src", address);
  const errors = Object.entries(row.errors).map(([model, rms]) => `${model} ${millimetres(rms)}`);
  byId("last").textContent = `${last}: RMS of the position, ${errors.join(", ")}. The corrected `
    + "model is the one that was traced from earlier throws.";
}

function showProposal(state) {
  const found = state.proposal, next = byId("next");
  const words = found ? [...found.throws, ...found.sentences] : ["Not known yet."];
  byId("proposal").replaceChildren(...words.map((text) => make("p", text)));
  next.hidden = !(found && found.throws.length);
  if (!next.hidden) next.setAttribute("src", `next_throw.png?${found.flights}`);
}

function tile(value, label) {
  return make("div", "", { class: "tile" }, make("b", value), make("span", label));
}

function show(view) {
  const { state } = view;
  const answers = state.traces.filter((trace) => !trace.refusal);
  const answer = answers[answers.length - 1], latest = state.traces[state.traces.length - 1];
  document.title = `${state.throws.length} throws: ${view.folder}`;
  byId("folder").textContent = view.folder;
  byId("doing").textContent = view.doing;
  byId("headline").replaceChildren(answer ? answer.headline
    : latest ? latest.refusal : state.throws.length ? "Not traced yet" : "No throw yet");
  if (answer) {
    byId("headline").append(make("span", answer.verdict.replaceAll("_", " "), { class: `badge ${answer.verdict}` }));
  }
  const tiles = [tile(String(state.throws.length), "throws")];
  if (answer) tiles.push(tile(String(answer.flights.length), "throws behind the verdict"));
  for (const [planned, [perched, flown]] of Object.entries(view.perches)) {
    if (flown) tiles.push(tile(`${perched} of ${flown}`, `perched, planned with the ${planned} model`));
  }
  byId("tiles").replaceChildren(...tiles);
  const notes = [view.fault, ...state.notes].filter(Boolean);
  byId("notes").replaceChildren(...notes.map((text) => make("p", text, { class: "warning" })));
  byId("report").hidden = !answer;
  showLast(view);
  showEffects(answers);
  showProposal(state);
  showThrows(state);
}

const events = new EventSource("events");
events.onopen = () => { byId("connection").textContent = "live"; };
events.onerror = () => { byId("connection").textContent = "the session has ended, or is starting again"; };
events.onmessage = (event) => show(JSON.parse(event.data));
