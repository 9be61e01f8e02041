// What the run found as a whole: counts, lengths, environments, and what was skipped.

function showOverview() {
  byId("title").textContent = data.title;
  document.title = `${data.title} – coact report`;
  byId("made-by").textContent = `Made by coact ${data.version} from the tables alone. Nothing is loaded from elsewhere.`;
  const notes = [];
  if (!data.is_finished) notes.push("This run is not finished: what is committed so far is shown.");
  if (!data.has_steps) notes.push("This run has no per-step table (--steps none): changes, masks and boundaries are not shown, and of the actions only those inside composite actions.");
  byId("notes").append(...notes.map((text) => element("p", { class: "note" }, text)));
  showTiles();
  showHistograms();
  showEnvironments();
  showSkipped();
  const parameters = data.parameters.map(([key, value]) => [element("code", {}, key), element("code", {}, value)]);
  byId("parameters").append(table("Parameters of the run", [["parameter", "text"], ["value", "text"]], parameters));
}

function totals() {
  const sum = (of) => data.environments.reduce((total, environment) => total + of(environment), 0);
  return {
    steps: sum((e) => e.n_steps),
    segments: sum((e) => e.n_segments),
    inSegments: sum((e) => e.joints.reduce((n, j) => n + j.n_segment_steps, 0)),
    found: sum((e) => e.joints.reduce((n, j) => n + j.n_segments, 0)),
  };
}

function showTiles() {
  const total = totals();
  const nRecordings = Object.values(data.recordings).reduce((a, b) => a + b, 0);
  const others = Object.entries(data.recordings).filter(([status]) => status !== "ok");
  const tiles = [
    ["recordings", whole(nRecordings), others.map(([status, n]) => `${whole(n)} ${status}`).join(", ") || "all read whole"],
    ["episodes", whole(data.n_episodes), `of ${count(data.environments.length + data.n_more_environments, "environment")}`],
    ["steps", whole(total.steps), data.n_dropped_steps ? `${whole(data.n_dropped_steps)} more not used` : "none dropped"],
    ["composite actions", whole(total.segments), data.n_episodes ? `${fixed(total.segments / data.n_episodes, 1)} an episode` : ""],
    ["mean length", total.found ? `${fixed(total.inSegments / total.found, 1)}` : "–", "steps"],
    ["messages refused", whole(data.n_messages_refused), `of ${whole(data.n_messages)}`],
  ];
  byId("tiles").append(
    ...tiles.map(([name, value, more]) =>
      element("div", {}, element("dt", {}, name), element("dd", { class: "big" }, value), element("dd", { class: "sub" }, more)),
    ),
  );
}

/** Names of the bins of lengths: 1, 2, 3–4, 5–8, … */
function lengthBins(n) {
  return Array.from({ length: n }, (_, i) => (i < 2 ? String(i + 1) : i === n - 1 ? `${whole(2 ** (i - 1) + 1)}+` : `${whole(2 ** (i - 1) + 1)}–${whole(2 ** i)}`));
}

function showHistograms() {
  const lengths = data.environments.flatMap((e) => e.joints.map((j) => j.lengths));
  const all = data.per_episode.slice(1).map((_, bin) => lengths.reduce((sum, of) => sum + of[bin], 0));
  const names = lengthBins(all.length);
  byId("histograms").append(
    histogram("Length of composite actions, steps", names, all, "composite action"),
    histogram("Composite actions per episode and joint", ["0", ...names], data.per_episode, "joint of an episode"),
  );
}

/** Bars over named bins, without empty ones at the ends. */
function histogram(title, names, counts, word) {
  const first = Math.max(0, counts.findIndex((n) => n > 0));
  const last = counts.findLastIndex((n) => n > 0);
  const shown = counts.slice(first, last + 1);
  const largest = Math.max(1, ...shown);
  const [width, height, top, bottom] = [420, 150, 18, 22];
  const room = width / Math.max(shown.length, 3);
  // Names that would run into each other are given to every second bar, or fewer.
  const size = shown.length > 8 ? 9.5 : 11;
  const longest = Math.max(1, ...names.slice(first, last + 1).map((name) => name.length));
  const every = Math.ceil((longest * size * 0.62) / room);
  const bars = shown.flatMap((n, i) => {
    const tall = (n / largest) * (height - top - bottom);
    const [x, y] = [i * room, height - bottom - tall];
    const name = names[first + i];
    return [
      svgElement("rect", { x: x + 2, y, width: room - 4, height: tall, rx: 2 }, svgElement("title", {}, `${name}: ${count(n, word)}`)),
      svgElement("text", { x: x + room / 2, y: y - 5, "text-anchor": "middle" }, n ? whole(n) : ""),
      svgElement("text", { x: x + room / 2, y: height - 6, "text-anchor": "middle", style: `font-size: ${size}px` }, (shown.length - 1 - i) % every ? "" : name),
    ];
  });
  const spoken = shown.map((n, i) => `${names[first + i]}: ${n}`).join(", ");
  return element(
    "figure",
    { class: "card" },
    element("figcaption", {}, title),
    shown.length
      ? svgElement("svg", { class: "histogram", viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${title}. ${spoken}` }, bars)
      : element("p", { class: "muted" }, "none"),
  );
}

function lengthBars(lengths) {
  const last = lengths.findLastIndex((n) => n > 0);
  const shown = lengths.slice(0, Math.max(last + 1, 10));
  const largest = Math.max(1, ...shown);
  const names = lengthBins(lengths.length);
  const spoken = shown.map((n, i) => (n ? `${names[i]} steps: ${n}` : "")).filter(Boolean).join(", ");
  return svgElement(
    "svg",
    { class: "bars", width: 9 * shown.length, height: 22, role: "img", "aria-label": spoken || "none" },
    shown.map((n, i) => svgElement("rect", { x: 9 * i, y: 22 - Math.max(n ? 1 : 0, (22 * n) / largest), width: 8, height: (22 * n) / largest }, svgElement("title", {}, `${names[i]} steps: ${n}`))),
  );
}

function showEnvironments() {
  const columns = [["environment", "text"], ["episodes", "number"], ["steps per episode", "number"], ["joint", "text"], ["composite actions", "number"], ["per episode", "number"], ["mean length", "number"], ["lengths 1, 2, 3–4, 5–8, …", ""]];
  const rows = data.environments.flatMap((environment) => {
    const joints = environment.joints.length ? environment.joints : [null];
    const span = { rowspan: joints.length };
    return joints.map((joint, i) => {
      const found = joint
        ? [jointName(joint), whole(joint.n_segments), fixed(joint.n_segments / environment.n_episodes, 1), fixed(joint.n_segment_steps / joint.n_segments, 1), lengthBars(joint.lengths)]
        : ["–", "0", "0", "–", ""];
      if (i > 0) return found.map((content, k) => new Cell(element("td", { class: columns[k + 3][1] }, content)));
      return [
        new Cell(element("th", { ...span, scope: "rowgroup", class: "text" }, environment.name)),
        new Cell(element("td", { ...span, class: "number" }, whole(environment.n_episodes))),
        new Cell(element("td", { ...span, class: "number" }, whole(environment.n_steps / environment.n_episodes))),
        ...found,
      ];
    });
  });
  byId("environments").append(table("By environment and joint", columns, rows));
  if (data.n_more_environments) byId("environments").append(element("p", { class: "muted" }, `${count(data.n_more_environments, "more environment")}: see the episodes table.`));
}

function showSkipped() {
  const place = byId("skipped");
  if (!data.n_skipped_recordings && !data.skipped_episodes.length) {
    place.append(element("p", { class: "muted" }, "Nothing: every recording was read whole, and every episode was used from its first to its last step."));
    return;
  }
  if (data.skipped_episodes.length) {
    const rows = data.skipped_episodes.map((s) => {
      const example = placeOf.get(s.example);
      return [s.status.replace("_", " "), s.reason, whole(s.count), example === undefined ? "" : element("a", { href: linkTo(example) }, nameOf(example))];
    });
    place.append(table("Episodes not used whole", [["episodes", ""], ["reason", "text"], ["how many", "number"], ["the first", "text"]], rows));
    if (data.n_more_skipped_episodes) place.append(element("p", { class: "muted" }, `${count(data.n_more_skipped_episodes, "more reason")}: see the episodes table.`));
  }
  if (data.n_skipped_recordings) {
    const rows = data.skipped_recordings.map((r) => [r.recording, r.status, [r.reason, ...r.causes.map(([cause, n]) => `${whole(n)} × ${cause}`)].filter(Boolean).join("; ")]);
    place.append(element("br"), table("Recordings of which something was refused", [["recording", "text"], ["status", ""], ["what", "text"]], rows));
    const more = data.n_skipped_recordings - data.skipped_recordings.length;
    if (more) place.append(element("p", { class: "muted" }, `${count(more, "more recording")}: see the recordings table.`));
  }
}
