// Measures side by side, where the page was made with a comparison.

function showComparison() {
  const { comparison } = data;
  if (!comparison) return;
  byId("comparison").hidden = false;
  byId("comparison-link").hidden = false;
  const columns = [["environment", "text"], ["measure", "text"], ["profile", ""], ["episodes", "number"], ["composite actions per episode", "number"], ["mean length", "number"], ["steps per episode", "number"], ["seconds", "number"]];
  const rows = comparison.measures.map((m) => [m.environment, m.measure, m.profile || "", whole(m.n_episodes), fixed(m.mean_segments, 1), fixed(m.mean_length, 1), fixed(m.mean_steps, 0), number(m.seconds)]);
  byId("comparison-tables").append(table("Measures by environment", columns, rows));
  const environments = [...new Set(comparison.agreement.map((a) => a.environment))];
  for (const environment of environments) {
    byId("comparison-tables").append(element("h3", {}, `Agreement of boundaries (F1), ${environment}`), agreement(environment));
  }
  if (environments.length && comparison.tolerance_steps !== null) {
    byId("comparison-tables").append(element("p", { class: "muted" }, `Boundaries agree if they are within ${count(comparison.tolerance_steps, "step")}.`));
  }
}

function agreement(environment) {
  const pairs = data.comparison.agreement.filter((a) => a.environment === environment);
  const names = [...new Set(pairs.flatMap((p) => [p.a, p.b]))];
  const of = (a, b) => pairs.find((p) => (p.a === a && p.b === b) || (p.a === b && p.b === a));
  const cell = (a, b) => {
    const pair = of(a, b);
    if (a === b || !pair || pair.f1 === null) return new Cell(element("td", { class: "heat" }, a === b ? "" : "–"));
    const share = Math.round(35 * Math.min(1, Math.max(0, pair.f1)));
    return new Cell(element("td", { class: "heat", style: `background: color-mix(in srgb, var(--action) ${share}%, var(--ground))` }, fixed(pair.f1, 2)));
  };
  const rows = names.map((a) => [new Cell(element("th", { scope: "row" }, a)), ...names.map((b) => cell(a, b))]);
  return table(`Agreement of measures in ${environment}`, [["", ""], ...names.map((n) => [n, ""])], rows);
}
