// Starts the page; what is shown follows the address, so that a link opens an episode.

function fromAddress() {
  const fields = new URLSearchParams(location.hash.slice(1).replaceAll("+", "%2B"));
  const name = fields.get("episode");
  if (name === null) return null;
  const place = placeByName(name);
  const jump = fields.has("segment") ? { joint: Number(fields.get("joint")), segment: Number(fields.get("segment")) } : null;
  return { name, place, jump };
}

function follow(isFirst) {
  const wanted = fromAddress();
  if (!wanted) {
    if (isFirst && episodes.id.length) {
      const first = episodes.has_trace.indexOf(1);
      showEpisode(Math.max(0, first), null);
      markSelected();
    }
    return;
  }
  if (wanted.place < 0) {
    view.place = -1;
    if (view.charts) view.charts.destroy();
    view.charts = null;
    view.box = null;
    byId("episode").replaceChildren(element("p", { class: "note" }, `There is no episode ${wanted.name} in this page.`));
  } else showEpisode(wanted.place, wanted.jump);
  markSelected();
  const target = innerWidth <= 820 || wanted.jump ? byId("episode") : byId("episodes");
  target.scrollIntoView({ block: "start" });
  if (!byId("episodes").contains(document.activeElement)) byId("episode").focus({ preventScroll: true });
}

startTheme();
showOverview();
startList();
startRanking();
showComparison();
addEventListener("hashchange", () => follow(false));
follow(true);
if (!episodes.id.length) byId("episode").append(element("p", { class: "muted" }, "The run has no episodes."));
document.documentElement.dataset.ready = "true";
