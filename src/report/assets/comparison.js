// Measures side by side, where the page was made with a comparison: a table of environments by measures, and how far
// the measures agree.

/** What a cell may show of a measure in an environment. */
const COMPARED = {
  mean_segments: ["composite actions per episode", (m) => fixed(m.mean_segments, 1)],
  mean_length: ["mean length, steps", (m) => fixed(m.mean_length, 1)],
  seconds: ["milliseconds", (m) => (m.seconds === null ? "–" : fixed(m.seconds * 1e3, 2))],
};

const compared = { what: "mean_segments", environment: "" };

function showComparison() {
  if (!data.comparison) return;
  byId("comparison").hidden = false;
  byId("comparison-link").hidden = false;
  const { measures, agreement } = data.comparison;
  const environments = [...new Set(measures.map((m) => m.environment))];
  const tables = { measures: element("div"), agreement: element("div") };
  const show = () => {
    tables.measures.replaceChildren(measuresTable(environments));
    tables.agreement.replaceChildren(agreementTable());
  };
  const choice = (id, label, options, key) =>
    element("div", { class: "pager" }, element("label", { for: id }, label),
      element("select", { id, onchange: (e) => { compared[key] = e.target.value; show(); } }, options.map(([value, text]) => element("option", { value }, text))));
  byId("comparison-tables").append(choice("compared-what", "Show", Object.entries(COMPARED).map(([key, [name]]) => [key, name]), "what"), tables.measures);
  if (agreement.length) {
    const of = [["", environments.length > 1 ? `mean of ${count(environments.length, "environment")}` : environments[0]], ...(environments.length > 1 ? environments.map((e) => [e, e]) : [])];
    const within = data.comparison.tolerance_steps === null ? "" : ` within ${count(data.comparison.tolerance_steps, "step")}`;
    byId("comparison-tables").append(
      element("h3", {}, "Agreement of the measures"),
      element("p", { class: "muted" }, `F1 of the boundaries${within}: 1 where two measures cut at the same steps, 0 where at none.`),
      choice("compared-environment", "Of", of, "environment"), tables.agreement,
    );
  }
  show();
}

/** Whether the measures are by one profile, which then needs no name. */
function isOneProfile() {
  return new Set(data.comparison.measures.map((m) => m.profile)).size < 2;
}

function measureLabel(measure, profile) {
  return isOneProfile() ? measure : `${measure} (${profile})`;
}

/** Names of the measures, in the order of the comparison. */
function comparedMeasures() {
  return [...new Set(data.comparison.measures.map((m) => measureLabel(m.measure, m.profile)))];
}

function measuresTable(environments) {
  const [name, text] = COMPARED[compared.what];
  const measures = comparedMeasures();
  const cells = new Map(data.comparison.measures.map((m) => [JSON.stringify([m.environment, measureLabel(m.measure, m.profile)]), m]));
  const of = (environment, measure) => cells.get(JSON.stringify([environment, measure]));
  const columns = [["environment", "text"], ["episodes", "number"], ["steps per episode", "number"], ...measures.map((m) => [m, "number wrap"])];
  const rows = environments.map((environment) => {
    const any = data.comparison.measures.find((m) => m.environment === environment);
    return [
      new Cell(element("th", { scope: "row", class: "text" }, environment)), whole(any.n_episodes), any.mean_steps === null ? "–" : whole(any.mean_steps),
      ...measures.map((m) => (of(environment, m) ? text(of(environment, m)) : "–")),
    ];
  });
  return table(`By measure: ${name}`, columns, rows);
}

function agreementTable() {
  const names = comparedMeasures();
  const sums = new Map();
  for (const pair of data.comparison.agreement) {
    if (pair.f1 === null || (compared.environment && pair.environment !== compared.environment)) continue;
    const key = JSON.stringify([measureLabel(pair.a, pair.a_profile), measureLabel(pair.b, pair.b_profile)].sort());
    const [n, sum] = sums.get(key) || [0, 0];
    sums.set(key, [n + 1, sum + pair.f1]);
  }
  const cell = (a, b) => {
    if (a === b) return new Cell(element("td", { class: "heat" }, ""));
    const found = sums.get(JSON.stringify([a, b].sort()));
    if (!found) return new Cell(element("td", { class: "heat" }, "–"));
    const mean = found[1] / found[0];
    const share = Math.round(35 * Math.min(1, Math.max(0, mean)));
    return new Cell(element("td", { class: "heat", style: `background: color-mix(in srgb, var(--action) ${share}%, var(--ground))` }, fixed(mean, 2)));
  };
  const rows = names.map((a) => [new Cell(element("th", { scope: "row" }, a)), ...names.map((b) => cell(a, b))]);
  return table("Agreement of the measures", [["measure", ""], ...names.map((n) => [n, "heat wrap"])], rows);
}
