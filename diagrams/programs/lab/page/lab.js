// The page of a session: shows each view that the server sends.
"use strict";

const byId = (id) => document.getElementById(id);
const isNumber = (value) => typeof value === "number";
const millimetres = (value) => (isNumber(value) ? `${(1e3 * value).toFixed(1)} mm` : "");
const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
const counted = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
const stem = (name) => name.replace(/\.csv$/, "");

/** An element with a text, attributes and children; nothing is ever read as HTML. */
function make(tag, text = "", attributes = {}, ...children) {
  const element = document.createElement(tag);
  element.textContent = text;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** Asks the server for something to be done; returns its refusal, "" for none. */
async function post(address, body) {
  const answer = await fetch(address, { method: "POST", headers: { "X-Glider-Lab": "1" }, body });
  return answer.ok ? "" : answer.text();
}

const drawn = {};  // What each figure shows, as text, and what ends its drawing.

/** Draws figures of a page's data, those that changed. */
function draw(data) {
  for (const name of Object.keys(data.figures)) {
    const text = JSON.stringify(data.figures[name]);
    if (drawn[name]?.text === text) continue;
    drawn[name]?.end.abort();
    const node = document.querySelector(`[data-figure="${name}"]`);
    node.querySelectorAll(".plot").forEach((plot) => Plotly.purge(plot));
    node.replaceChildren();
    drawn[name] = { text, end: new AbortController() };
    drawFigures({ ...data, figures: { [name]: data.figures[name] } }, drawn[name].end.signal);
  }
}

// ------------------------------------------------------------------- one throw

let picked = null;  // The throw that is shown: {name, sha256}.
let latest = "";  // The last throw that was drawn without being asked for.

async function showThrow(row) {
  const key = JSON.stringify([row.sha256, row.errors]);  // Flown again later, too.
  const isNew = byId("throw").dataset.key !== key;
  byId("throw").dataset.key = key;
  picked = row;
  byId("throw").hidden = false;
  const errors = Object.entries(row.errors).map(([model, rms]) => `${model} model ${millimetres(rms)}`);
  byId("throw-title").textContent = `Throw ${stem(row.name)}, measured${errors.length ? " and predicted" : ""}`;
  const fitted = row.is_fitted && isNumber(row.errors.corrected) ? " (fitted to this throw too)" : "";
  byId("throw-words").textContent = [
    row.take ? `Of ${row.take}` : "",
    capital([endOf(row), row.fault].filter(Boolean).join("; ")),
    errors.length ? `Error of the predicted position, RMS: ${errors.join(", ")}${fitted}` : "",
  ].filter(Boolean).map((text) => `${text}.`).join(" ");
  for (const node of byId("rows").children) {
    node.toggleAttribute("aria-current", node.dataset.name === row.name);
  }
  if (!isNew) return;
  const address = `throws/${encodeURIComponent(stem(row.name))}`;
  const data = await fetch(`${address}.json?${row.sha256}`)
    .then((answer) => (answer.ok ? answer.json() : null)).catch(() => null);
  // Later views have other objects for the same throw: its key says whether it is meant.
  if (byId("throw").dataset.key !== key) return;
  if (!data) {
    byId("throw").dataset.key = "";  // The next view asks again.
    return;
  }
  draw(data);
  byId("throw").dataset.shown = row.name;
  showReplay();
}

/** Loads the replay, which is large, once it is to be seen. */
function showReplay() {
  const frame = byId("replay").querySelector("iframe");
  frame.hidden = !byId("replay").open;
  const version = encodeURIComponent(byId("throw").dataset.key);
  const address = `throws/${encodeURIComponent(stem(picked.name))}/replay?${version}`;
  if (!frame.hidden && frame.getAttribute("src") !== address) frame.setAttribute("src", address);
}
byId("replay").addEventListener("toggle", showReplay);

/** When a throw was flown, as far as its files say. */
function timeOf(row) {
  const shown = (time) => time.slice(0, 19).replace("T", " ");
  return row.flown ? shown(row.flown) : row.written ? `file of ${shown(row.written)}` : "";
}

/** Where a throw ended, in words. */
function endOf(row) {
  if (row.perched === null) return "";
  return `${row.perched ? "perched" : "no perch"}, ${millimetres(row.miss)} from the wire`;
}

// ------------------------------------------------------------------ all throws

/** Reasons of exclusions that most throws share: said once, below the table. */
function commonReasons(excluded, count) {
  const files = new Map();
  for (const { why, file } of excluded) files.set(why, new Set(files.get(why)).add(file));
  return new Set([...files].filter(([, named]) => count > 2 && named.size > count / 2).map(([why]) => why));
}

function exclusions(row, excluded, common) {
  const reasons = new Map();
  for (const { why, rows } of excluded.filter((e) => e.file === row.name)) {
    const key = common.has(why) ? "" : why;
    reasons.set(key, [...(reasons.get(key) ?? []), rows]);
  }
  const words = [...reasons].map(([why, lines]) => {
    if (lines.includes("all")) return why;
    const numbers = lines.sort((a, b) => a - b).join(", ");
    return `line${lines.length > 1 ? "s" : ""} ${numbers}${why && `: ${why}`}`;
  });
  return [row.fault, ...words].filter(Boolean).join("; ");
}

function showThrows({ throws, excluded }) {
  byId("all").hidden = !throws.length;
  const common = commonReasons(excluded, throws.length);
  const rows = [...throws].reverse().map((row) => {
    const name = make("button", stem(row.name), { type: "button", title: row.take && `of ${row.take}` });
    name.disabled = !row.is_drawn;
    name.addEventListener("click", () => {
      showThrow(row);
      byId("throw").scrollIntoView({ behavior: "smooth" });
    });
    const cells = [["time", timeOf(row), "soft"], ["plan", row.planned], ["result", endOf(row), row.perched ? "yes" : ""],
      ["nominal", millimetres(row.errors.nominal), "number"],
      ["corrected", millimetres(row.errors.corrected), "number"],
      ["excluded", exclusions(row, excluded, common), "soft"]];
    return make("tr", "", { "data-name": row.name }, make("th", "", { scope: "row" }, name),
      ...cells.map(([label, text, kind = ""]) => make("td", text, { "data-label": label, class: kind })));
  });
  byId("rows").replaceChildren(...rows);
  byId("common").textContent = [...common].map((why) => `Lines without a reason: ${why}.`).join(" ");
}

// --------------------------------------------------------------------- answers

function tile(value, label, kind = "") {
  return make("div", "", { class: `tile ${kind}` }, make("b", value), make("span", label));
}

function showAnswer(view, answer) {
  const { state } = view, last = state.traces[state.traces.length - 1];
  const readable = state.throws.filter((row) => row.is_read).length;
  byId("headline").textContent = answer ? answer.headline : last ? (last.is_fault ? last.refusal : `Not traced: ${last.refusal}`)
    : view.import.is_open && !state.throws.length ? "Waiting for throws, or takes"
    : readable ? "The throws are not traced yet" : "No throw yet";
  if (answer) {
    byId("headline").append(make("span", answer.verdict.replaceAll("_", " "), { class: `badge ${answer.verdict}` }));
  }
  const behind = answer ? `, ${answer.flights.length} behind the verdict` : "";
  const tiles = [tile(String(state.throws.length), `throws${behind}`)];
  for (const [planned, [perched, flown]] of Object.entries(view.perches)) {
    if (flown) tiles.push(tile(`${perched} of ${flown}`, `perched with the ${planned} plan`, perched === flown ? "good" : ""));
  }
  const { nominal, corrected } = answer?.errors ?? {};
  if (isNumber(nominal) && isNumber(corrected)) {
    tiles.push(tile(`${millimetres(nominal)} → ${millimetres(corrected)}`, "error on held-out throws, RMS"));
  }
  byId("tiles").replaceChildren(...tiles);
  byId("answer").hidden = !answer;
  if (answer) {
    const seconds = isNumber(answer.seconds) ? ` The last trace took ${answer.seconds.toFixed(0)} s.` : "";
    byId("effects-words").textContent = (answer.effects.length
      ? "Each coefficient as it was known after so many throws; zero is the nominal model."
      : "No effect was found.") + seconds;
  }
}

function showProposal({ proposal, throws }) {
  byId("next").hidden = !proposal;
  if (!proposal) return;
  const readable = throws.filter((row) => row.is_read).length;
  const old = readable > proposal.flights ? `Found from the first ${proposal.flights} throws.` : "";
  const [advice, ...others] = proposal.sentences;
  byId("proposal").replaceChildren(
    make("p", advice, { class: proposal.is_refused ? "warning" : "" }),
    ...proposal.throws.map((text) => make("p", `${capital(text)}.`, { class: "reason" })),
    ...[...others, old].filter(Boolean).map((text) => make("p", text)));
  byId("commands").replaceChildren(...proposal.throws.map((_, i) => make("a", "Save the commands (CSV)",
    { class: "pick", href: `next/commands_${i + 1}.csv`, download: `commands_${i + 1}.csv` })));
  byId("look-again").hidden = !proposal.is_refused;
  byId("next-picture").hidden = !proposal.throws.length;
  const picture = byId("next-picture").querySelector("img"), key = JSON.stringify(proposal);
  if (!proposal.throws.length || picture.dataset.key === key) return;
  picture.dataset.key = key;
  picture.setAttribute("src", `next/next_throw.png?${Date.now()}`);
}

byId("look-again").addEventListener("click", async () => {
  await post("next-throw");
});

// --------------------------------------------------------------------- station

const STATES = { "": "No station", waiting: "Waiting", ready: "READY", flying: "Flying", stopped: "Stopped" };

function showStation({ state, reason, is_stopped }) {
  byId("station").hidden = false;
  byId("station").dataset.state = is_stopped ? "stopped" : state;
  byId("station-state").textContent = is_stopped ? "STOPPED" : STATES[state];
  const why = is_stopped ? "Every elevator on the bus turns to neutral and stays there"
    : state === "ready" && !isSimulated ? "Throw now"
    : state ? capital(reason) : "Nothing is heard from one on the bus";
  byId("station-reason").textContent = why && `${why}.`;
  byId("arm").hidden = !is_stopped;
  stopped = is_stopped;
  allowLaunches();
}

async function operate(what) {
  const refusal = await post(what).catch(() => "Not sent: there is no connection. Stop at the station.");
  byId("station-answer").textContent = refusal;
  byId("station-answer").hidden = !refusal;
}
byId("stop").addEventListener("click", () => operate("stop"));
byId("arm").addEventListener("click", () => operate("arm"));

// -------------------------------------------------------------------- launches

let isSimulated = false;
let stopped = false;  // Whether a Stop holds.
let mayLaunch = () => false;  // By what a launch is planned with.

function allowLaunches() {
  for (const button of document.querySelectorAll("[data-planned]")) {
    button.disabled = stopped || !mayLaunch(button.dataset.planned);
  }
}

function showLaunches({ launches, state }, answer) {
  byId("launches").hidden = !launches;
  isSimulated = Boolean(launches);
  byId("fly-next").hidden = !launches || !state.proposal?.throws.length;
  if (!launches) return;
  byId("truth").textContent = launches.truth;
  if (!byId("count").value) byId("count").value = launches.count;
  mayLaunch = (planned) => !launches.flies && (planned === "nominal" || Boolean(answer));
  allowLaunches();
}
for (const button of document.querySelectorAll("[data-planned]")) {
  button.addEventListener("click", async () => {
    const { planned, throws = byId("count").value } = button.dataset;
    const asked = new URLSearchParams({ planned, throws });
    const refusal = await post(`fly?${asked}`);
    byId("launch-answer").textContent = refusal;
    byId("launch-answer").hidden = !refusal;
  });
}

// ---------------------------------------------------------------------- import

const USUAL_COLUMNS = ["time", "x", "z", "pitch", "elevator", "elevator_rate_command", "elevator_angle_command"];
const WHOLE = { x: "position", z: "position", pitch: "attitude" };  // Has the other's place.

/** Asks the server about the text of a map: it reads YAML. */
async function askMap(query) {
  return fetch(`map/fields?${new URLSearchParams(query)}`,
    { method: "POST", headers: { "X-Glider-Lab": "1" }, body: byId("map").value });
}

async function showChoices({ frame, units, meanings, columns, names }) {
  const text = byId("map").value, answer = await askMap({});
  if (!answer.ok || text !== byId("map").value) return;  // Typed on since.
  const fields = await answer.json(), mapped = fields.columns ?? {};
  const offered = [
    ...columns.filter((key) => mapped[key] || USUAL_COLUMNS.includes(key) && !mapped[WHOLE[key]])
      .map((key) => ["columns", key, names, `column of ${key}`]),
    ...Object.entries(frame).map(([key, values]) => ["frame", key, values, meanings[key]]),
    ...Object.entries(units).filter(([key]) => fields.units?.[key] || ["time", "length", "angle", "rate"].includes(key))
      .map(([key, values]) => ["units", key, values, `unit of ${key}, where the file has none`]),
    ["", "clock", ["same", "find"], "clock of the elevator: that of the poses, or to be found"],
  ];
  byId("choices").replaceChildren(...offered.map(([section, key, values, meaning]) => {
    const now = fields[section]?.[key] ?? "";
    const options = ["", ...new Set([...values, now])].filter((v, i) => v || !i);
    const none = section === "columns" ? "none" : "by default";
    const select = make("select", "", { class: "pick", title: meaning, "data-section": section, "data-key": key },
      ...options.map((value) => make("option", value || none, { value })));
    select.value = now;
    select.addEventListener("change", async () => {
      const changed = await askMap({ section, name: key, value: select.value });
      if (!changed.ok) return answerDrop(await changed.text());
      byId("map").value = await changed.text();
      edited();
      check();
    });
    const label = { columns: `column of ${key.replaceAll("_", " ")}`, frame: key, units: `unit of ${key}` }[section] ?? `${key} of the elevator`;
    return make("label", label, { title: meaning }, select);
  }));
}

let lastDraft = "";  // As text; what a person has typed since stays.
let choices = null;

function edited() {
  byId("save").disabled = true;
  if (choices) showChoices(choices);
}

async function check() {
  answerDrop(await post("map/check", byId("map").value));
}

/** Shows refusals of what was asked for. */
function answerDrop(...refusals) {
  byId("drop-answers").replaceChildren(...refusals.filter(Boolean).map((text) => make("p", text, { class: "warning" })));
}

function showImport(view) {
  const { draft } = view.state, offer = view.import, { takes } = offer;
  byId("import").hidden = !(offer.is_open || offer.has_takes);
  byId("skipped").replaceChildren(...Object.values(offer.skipped).map((why) => make("li", `Skipped: ${why}`, { class: "warning" })));
  byId("takes").textContent = takes.length ? `${counted(takes.length, "take")}: ${takes.join(", ")}` : "";
  const isOld = draft?.is_proposed && String(draft.takes) !== String(takes);  // Another comes.
  byId("draft").hidden = !draft || isOld;
  if (!draft || lastDraft === JSON.stringify(draft)) return;
  lastDraft = JSON.stringify(draft);
  byId("draft").open = offer.is_open || Boolean(draft.refusal);
  choices = { ...offer.choices, names: draft.columns };
  byId("map").value = draft.text;
  showChoices(choices);
  byId("draft-words").textContent = draft.refusal ? "The takes cannot be read like this:"
    : `${counted(draft.flights, "flight")}, as the map reads them. Do the arrows point where the nose did, and are the throws as they were? Correct what is not, then save.`;
  const notes = [draft.refusal, ...draft.warnings].filter(Boolean);
  byId("draft-notes").replaceChildren(...notes.map((text) => make("p", text, { class: draft.refusal ? "warning" : "remark" })));
  byId("save").disabled = Boolean(draft.refusal);
  byId("map-picture").hidden = !draft.flights;
  if (draft.flights) byId("map-picture").setAttribute("src", `map.png?${Date.now()}`);
}

async function upload(files) {
  const refusals = [];
  for (const file of files) {
    byId("takes").textContent = `Sending ${file.name}`;
    const refusal = await post(`takes/${encodeURIComponent(file.name)}`, file).catch(() => "it was not sent");
    if (refusal) refusals.push(`${file.name}: ${refusal}`);
  }
  byId("files").value = "";
  answerDrop(...refusals);
}

byId("files").addEventListener("change", (event) => upload([...event.target.files]));
byId("map").addEventListener("input", edited);
byId("check").addEventListener("click", check);
byId("propose").addEventListener("click", async () => {
  lastDraft = "";  // Also where the proposal is the one that is known.
  answerDrop(await post("map/propose"));
});
byId("save").addEventListener("click", async () => {
  const refusal = await post("map/save", byId("map").value);
  answerDrop(refusal);
  byId("draft").open = Boolean(refusal);
});
for (const kind of ["dragover", "dragleave", "drop"]) {
  byId("drop").addEventListener(kind, (event) => {
    event.preventDefault();
    byId("drop").classList.toggle("over", kind === "dragover");
    if (kind === "drop") upload([...event.dataTransfer.files]);
  });
}

// ----------------------------------------------------------------------- views

function show(view) {
  const { state } = view;
  const answers = state.traces.filter((trace) => !trace.refusal);
  const answer = answers[answers.length - 1];
  document.title = `${state.throws.length} throws · ${view.folder}`;
  byId("folder").textContent = view.folder;
  byId("doing").textContent = view.doing;
  byId("doing").hidden = !view.doing;
  byId("notes").replaceChildren(...[...view.faults, ...state.notes].map((text) => make("p", text, { class: "warning" })));
  showAnswer(view, answer);
  showLaunches(view, answer);
  showImport(view);
  showProposal(state);
  showThrows(state);
  draw(view.figures);
  const rows = new Map(state.throws.map((row) => [row.name, row]));
  const last = state.throws.filter((row) => row.is_drawn).at(-1);
  const isNew = last && latest !== last.sha256;
  if (isNew) latest = last.sha256;
  const row = isNew ? last : rows.get(picked?.name) ?? last;
  if (row) showThrow(row);
}

function connect() {
  const events = new EventSource("events"), connection = byId("connection");
  const say = (text, kind) => { connection.textContent = text; connection.className = kind; };
  events.onopen = () => say("live", "live");
  events.addEventListener("station", (event) => showStation(JSON.parse(event.data)));
  events.onmessage = (event) => show(JSON.parse(event.data));
  events.onerror = () => {
    say("The session has ended; start it again, and this page goes on", "off");
    if (events.readyState === EventSource.CLOSED) setTimeout(connect, 2000);
  };
}
// The cookie has the token by now: neither the address bar nor the history needs it.
history.replaceState(null, "", location.pathname);
connect();
