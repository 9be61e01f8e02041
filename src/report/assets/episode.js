// One episode: what is known of it, its charts, what stands under the cursor, and its composite actions as a table.

const KINDS = { all: ["raw", "change", "segments"], raw: ["raw"], change: ["change"], segments: ["segments"] };

/** Joints of which all three charts are shown unless another view is chosen. */
const FEW_JOINTS = 2;

const view = { place: -1, charts: null, trace: null, kinds: null, joint: "all", box: null };

function showEpisode(place, jump) {
  const index = episodes.index[place];
  if (view.place !== place) {
    view.place = place;
    view.trace = traceOf(index);
    view.joint = "all";
    view.kinds = null;
    if (view.charts) view.charts.destroy();
    view.charts = view.trace ? new EpisodeCharts(view.trace, tellStep) : null;
    buildEpisode();
  }
  if (jump && view.charts) {
    const joint = view.trace.joints.find((j) => j.joint === jump.joint);
    const segment = joint && joint.segments[jump.segment];
    if (segment) jumpTo(joint, segment);
  }
}

function jumpTo(joint, segment) {
  const margin = Math.max(4, (segment.end - segment.start) * 0.35);
  view.charts.zoom(segment.start - margin, segment.end + margin);
  view.charts.moveTo(Math.round(segment.start / view.trace.stride), joint);
}

function buildEpisode() {
  const { place, trace } = view;
  const target = byId("episode");
  const facts = [
    environmentOf(place),
    ["", "incomplete", "too short"][episodes.status[place]],
    count(episodes.n_steps[place], "step"),
    count(episodes.n_joints[place], "joint"),
    count(episodes.n_state_dims[place], "state dimension"),
    count(episodes.n_segments[place], "composite action"),
    episodes.episode_return[place] === null ? "" : `return ${number(episodes.episode_return[place])}`,
    trace && trace.startTime ? `from ${timeOf(trace.startTime)}` : "",
  ];
  target.replaceChildren(
    element("h3", { id: "episode-name" }, nameOf(place)),
    element("p", { class: "facts-line" }, facts.filter(Boolean).join(" · ")),
  );
  if (!trace) {
    target.append(
      element("p", { class: "info" }, "The traces of this episode are not in this page. Make one that has them: ",
        element("code", {}, `coact report DIR --episode '${nameOf(place).replaceAll("'", "'\\''")}'`)),
    );
    return;
  }
  if (!data.has_steps) target.append(element("p", { class: "info" }, "Without the per-step table, only the actions inside composite actions are known."));
  if (trace.stride > 1) target.append(element("p", { class: "info" }, `Each point stands for ${trace.stride} steps: their first action, their largest change, any mask.`));
  if (trace.nMoreJoints) target.append(element("p", { class: "info" }, `${count(trace.nMoreJoints, "more joint")} are not in this page.`));
  if (!trace.joints.length) {
    target.append(element("p", { class: "info" }, "No composite action was found in this episode."));
    return;
  }
  const readout = element("div", { class: "readout", id: "readout" }, element("span", { class: "muted" }, "Point at a chart or tap it, or focus one and press an arrow key, to read its values."));
  view.box = element("div", { id: "charts" });
  // The readout stays in sight as long as a chart is.
  target.append(toolbar(trace), legend(trace), element("div", {}, readout, view.box), keysHelp(), segmentsTable(trace));
  drawCharts();
}

/** Nanoseconds since the Unix epoch, as text, to a date. */
function timeOf(nanos) {
  const millis = Number(BigInt(nanos) / 1000000n);
  const date = new Date(millis);
  return Number.isNaN(date.getTime()) ? `${nanos} ns` : `${date.toISOString().slice(0, 19).replace("T", " ")} UTC`;
}

function shownJoints() {
  return view.joint === "all" ? view.trace.joints : view.trace.joints.filter((j) => String(j.joint) === view.joint);
}

function shownKinds() {
  const joints = shownJoints();
  return view.kinds || (joints.length > FEW_JOINTS ? "segments" : "all");
}

function drawCharts() {
  if (!view.charts || !view.box) return;
  const kinds = shownKinds();
  if (byId("view-kind")) byId("view-kind").value = kinds;
  view.charts.draw(view.box, KINDS[kinds], shownJoints());
}

function toolbar(trace) {
  const choice = (id, label, options, chosen, change) =>
    element("label", {}, `${label} `, element("select", { id, onchange: change }, options.map(([value, text]) => element("option", { value, selected: value === chosen }, text))));
  const kinds = [["all", "all three"], ["raw", "(a) raw"], ["change", "(b) change"], ["segments", "(c) composite actions"]];
  const joints = [["all", `all ${trace.joints.length}`], ...trace.joints.map((j) => [String(j.joint), jointName(j)])];
  const button = (text, label, act) => element("button", { type: "button", class: "square", "aria-label": label, title: label, onclick: act }, text);
  const step = (by) => () => {
    const next = neighbour(view.place, by);
    if (next >= 0) location.hash = linkTo(next);
  };
  return element(
    "div", { class: "tools", role: "toolbar", "aria-label": "Charts" },
    trace.state.measure ? choice("view-kind", "Show", kinds, shownKinds(), (e) => { view.kinds = e.target.value; drawCharts(); }) : null,
    trace.joints.length > 1 ? choice("view-joint", "of", joints, view.joint, (e) => { view.joint = e.target.value; drawCharts(); }) : null,
    element("span", { class: "spacer" }),
    element(
      "span", { class: "group" },
      button("◂", "Move left", () => view.charts.pan(-0.5)), button("−", "Zoom out", () => view.charts.zoomBy(2)),
      button("+", "Zoom in", () => view.charts.zoomBy(0.5)), button("▸", "Move right", () => view.charts.pan(0.5)),
      element("button", { type: "button", onclick: () => view.charts.zoom(...view.charts.whole()) }, "Whole"),
    ),
    element(
      "span", { class: "group" },
      element("button", { type: "button", onclick: step(-1), "aria-label": "Previous episode" }, "‹ Prev"),
      element("button", { type: "button", onclick: step(1), "aria-label": "Next episode" }, "Next ›"),
    ),
  );
}

function legend(trace) {
  const item = (style, text, kind) => element("li", {}, element("i", { class: kind, style }), text);
  const items = [item("border-color: var(--action)", "action")];
  if (trace.state.change) {
    items.push(
      item("border-color: var(--state)", "state"), item("", "λ", "dash"), item("border-color: var(--both)", "correlated", "band"),
      item("", "boundary", "upright"), item("border-color: var(--outside)", "outside composite actions"),
    );
  }
  return element("ul", { class: "legend" }, items);
}

function keysHelp() {
  const key = (name) => element("kbd", {}, name);
  return element("p", { class: "keys" }, "Drag to zoom, double click for the whole. With a chart in focus: ", key("←"), " ", key("→"), " step, ", key("Shift"), " ten, ", key("PgUp"), " ", key("PgDn"), " composite action, ", key("+"), " ", key("−"), " zoom, ", key("0"), " whole.");
}

/** Values under the cursor, each with a name of its own. */
function tellStep(point, joint) {
  if (point < 0) return;
  const { trace } = view;
  const step = trace.steps[point];
  const at = (values) => (values ? values[point] : undefined);
  const k = joint.segments.findIndex((s) => step >= s.start && step < s.end);
  const flag = (mask) => (mask ? (mask[point] ? "yes" : "no") : "–");
  const fields = [
    ["step", "step", trace.stride > 1 ? `${whole(step)}–${whole(Math.min(step + trace.stride, trace.nSteps) - 1)}` : whole(step)],
    ["time", "time", trace.seconds ? `${fixed(at(trace.seconds), 3)} s` : "–"],
    ["joint", "joint", jointName(joint)],
    ["action", "action", number(at(joint.action))],
    ["action-measure", "action measure", short(at(joint.measure))],
    ["action-change", "action change", fixed(at(joint.change), 4)],
    ["state-measure", "state measure", short(at(trace.state.measure))],
    ["state-change", "state change", fixed(at(trace.state.change), 4)],
    ["action-mask", "action mask", flag(joint.mask)],
    ["state-mask", "state mask", flag(trace.state.mask)],
    ["correlated", "correlated", flag(joint.correlated)],
    ["segment", "composite action", k < 0 ? "outside" : `${k} (${joint.segments[k].start}–${joint.segments[k].end})`],
  ];
  byId("readout").replaceChildren(...fields.map(([id, label, text]) => element("span", { class: "field" }, element("span", { class: "muted" }, `${label} `), element("b", { "data-field": id }, text))));
  view.charts.say(joint, fields.map(([, label, text]) => `${label} ${text}`).join(", "));
}

/** Rows of an episode's table that are made at once. */
const TABLE_ROWS = 300;

function segmentsTable(trace) {
  const rows = trace.joints.flatMap((joint) =>
    joint.segments.map((s, k) => [
      element("a", { href: linkTo(view.place, joint.joint, k) }, `${jointName(joint)} ${k}`),
      whole(s.start), whole(s.end), whole(s.end - s.start), fixed(s.sum, 3), fixed(s.peak, 3), whole(s.rank),
    ]),
  );
  const columns = [["composite action", "text"], ["start", "number"], ["end", "number"], ["steps", "number"], ["change, sum", "number"], ["peak", "number"], ["rank in joint", "number"]];
  const more = rows.length - TABLE_ROWS;
  return element(
    "details", {}, element("summary", {}, `Its ${count(rows.length, "composite action")} as a table`),
    table("Composite actions of this episode", columns, rows.slice(0, TABLE_ROWS)),
    more > 0 ? element("p", { class: "muted" }, `${whole(more)} more: see the segments table.`) : null,
  );
}

themeListeners.push(drawCharts);

let drawnWidth = innerWidth;
addEventListener("resize", () => {
  if (innerWidth === drawnWidth) return;
  drawnWidth = innerWidth;
  drawCharts();
});
