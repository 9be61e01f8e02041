// The strongest composite actions, each with a small picture, and a link to where it is.

const RANKING_PAGE = 20;
const ranking = { environment: "", n: RANKING_PAGE };

function startRanking() {
  if (!data.ranking.length) {
    byId("ranking").append(element("p", { class: "muted" }, "No composite action was found."));
    return;
  }
  showRanking();
}

function rankedEnvironment(row) {
  const place = placeOf.get(row.episode);
  return place === undefined ? "" : environmentOf(place);
}

function showRanking() {
  const environments = [...new Set(data.ranking.map(rankedEnvironment))].sort();
  const rows = data.ranking.filter((row) => !ranking.environment || rankedEnvironment(row) === ranking.environment);
  const shown = rows.slice(0, ranking.n);
  const select = element(
    "select", { id: "ranking-environment", onchange: (e) => { ranking.environment = e.target.value; ranking.n = RANKING_PAGE; showRanking(); byId("ranking-environment").focus(); } },
    element("option", { value: "" }, "all environments"),
    environments.map((name) => element("option", { value: name, selected: name === ranking.environment }, name)),
  );
  const columns = [["", "number"], ["composite action", ""], ["change, sum", "number"], ["where", "place"], ["joint", "text"], ["environment", "text"], ["steps", "number"], ["peak", "number"], ["reward", "number"]];
  const more = rows.length - shown.length;
  byId("ranking").replaceChildren(
    element("p", { class: "muted" }, withSymbols("The sum of the state's change (E_n) over each composite action; the 20 strongest of each environment, at most 400 in all.")),
    element("div", { class: "pager" }, element("label", { for: "ranking-environment" }, "Of"), select),
    table("Strongest composite actions", columns, shown.map(rankedRow)),
    more > 0
      ? element("p", {}, element("button", { type: "button", onclick: () => { ranking.n += 3 * RANKING_PAGE; showRanking(); } }, `Show more (${whole(more)})`))
      : "",
  );
}

function rankedRow(row, i) {
  const place = placeOf.get(row.episode);
  const range = `${whole(row.start)}–${whole(row.end)}`;
  const where = place === undefined ? range : element("a", { href: linkTo(place, row.joint, row.segment) }, `${nameOf(place)}, steps ${range}`);
  // A link for the pointer; the keyboard has the one in words.
  const picture = place === undefined ? sparkline(row) : element("a", { href: linkTo(place, row.joint, row.segment), tabindex: -1, "aria-hidden": "true" }, sparkline(row));
  return [whole(i + 1), picture, fixed(row.sum, 3), where, jointName(row), rankedEnvironment(row), whole(row.end - row.start), fixed(row.peak, 3), number(row.reward)];
}

function sparkline(row) {
  const [width, height] = [120, 26];
  if (!row.spark.length) return "–";
  const paths = row.spark.map((line, k) => {
    const x = (i) => 1 + (line.length > 1 ? (i / (line.length - 1)) * (width - 2) : 0);
    const y = (v) => height - 2 - (v / 255) * (height - 4);
    const held = new Set(line).size <= 3;
    const d = line.map((v, i) => (i === 0 ? `M${x(0).toFixed(1)} ${y(v).toFixed(1)}` : `${held ? `H${x(i).toFixed(1)}V${y(v).toFixed(1)}` : `L${x(i).toFixed(1)} ${y(v).toFixed(1)}`}`)).join("");
    return svgElement("path", { d, style: row.spark.length > 1 ? `stroke: var(--s${k % SEGMENT_COLOURS})` : null });
  });
  const [low, high] = row.range;
  return svgElement("svg", { class: "spark", width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `actions from ${number(low)} to ${number(high)}` }, paths);
}
