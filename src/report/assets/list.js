// The list of episodes: searched by any words, moved through by keys.

/** Options that are made at a time. */
const MAX_OPTIONS = 200;

const list = { found: [], active: -1 };

function startList() {
  byId("search").addEventListener("input", showList);
  byId("with-traces").addEventListener("change", showList);
  byId("search").addEventListener("keydown", (event) => {
    if (event.key === "ArrowDown") {
      event.preventDefault();
      byId("list").focus();
      setActive(Math.max(0, list.active));
    } else if (event.key === "Enter" && list.found.length) openEpisode(list.found[0]);
  });
  byId("list").addEventListener("keydown", (event) => {
    const moves = { ArrowDown: list.active + 1, ArrowUp: list.active - 1, Home: 0, End: Infinity, PageDown: list.active + 8, PageUp: list.active - 8 };
    if (event.key in moves) setActive(moves[event.key]);
    else if ((event.key === "Enter" || event.key === " ") && list.active >= 0) openEpisode(list.found[list.active]);
    else return;
    event.preventDefault();
  });
  showList();
}

function openEpisode(place) {
  location.hash = linkTo(place);
}

function searchText(place) {
  return `${nameOf(place)} ${environmentOf(place)}`.toLowerCase();
}

function findEpisodes() {
  const words = byId("search").value.toLowerCase().split(/\s+/).filter(Boolean);
  const onlyTraces = byId("with-traces").checked;
  const found = [];
  for (let place = 0; place < episodes.id.length; place++) {
    if (onlyTraces && !episodes.has_trace[place]) continue;
    if (words.length) {
      const text = searchText(place);
      if (!words.every((word) => text.includes(word))) continue;
    }
    found.push(place);
  }
  return found;
}

function showList() {
  list.found = findEpisodes();
  list.active = -1;
  const shown = list.found.slice(0, MAX_OPTIONS);
  byId("list").replaceChildren(...shown.map(option));
  const more = list.found.length - shown.length;
  const unlisted = data.n_episodes - episodes.id.length;
  const notes = [count(list.found.length, "episode")];
  if (more > 0) notes.push(`the first ${whole(MAX_OPTIONS)} listed: type to narrow it`);
  if (unlisted > 0) notes.push(`${whole(unlisted)} more of the run are not in this page`);
  if (data.n_chosen < data.n_episodes) notes.push(`${whole(data.n_chosen)} of ${whole(data.n_episodes)} have their traces here (${data.rule})`);
  byId("list-note").textContent = notes.join("; ");
  markSelected();
}

function option(place, i) {
  const facts = [environmentOf(place), count(episodes.n_segments[place], "composite action"), count(episodes.n_steps[place], "step")];
  if (episodes.status[place] > 0) facts.push(["", "incomplete", "too short"][episodes.status[place]]);
  if (!episodes.has_trace[place]) facts.push("no traces");
  return element(
    "div", { class: "option", role: "option", id: `option-${i}`, "aria-selected": "false", "data-place": place, onclick: () => openEpisode(place) },
    element("span", { class: "name" }, nameOf(place)), element("span", { class: "facts" }, facts.join(" · ")),
  );
}

function setActive(wanted) {
  const options = byId("list").children;
  if (!options.length) return;
  if (list.active >= 0) options[list.active].classList.remove("active");
  list.active = Math.min(Math.max(0, wanted), options.length - 1);
  options[list.active].classList.add("active");
  keepInSight(options[list.active]);
  byId("list").setAttribute("aria-activedescendant", options[list.active].id);
}

/** Moves the list alone; the page stays where it is. */
function keepInSight(node) {
  const box = byId("list");
  const top = node.offsetTop - box.offsetTop;
  if (top < box.scrollTop) box.scrollTop = top;
  else if (top + node.offsetHeight > box.scrollTop + box.clientHeight) box.scrollTop = top + node.offsetHeight - box.clientHeight;
}

function markSelected() {
  [...byId("list").children].forEach((node, i) => {
    const isSelected = Number(node.dataset.place) === view.place;
    node.setAttribute("aria-selected", String(isSelected));
    if (!isSelected) return;
    setActive(i);
    byId("list").scrollTop = node.offsetTop - byId("list").offsetTop - 60;
  });
}

/** The episode before or after another in the list, as it is searched now. */
function neighbour(place, by) {
  const at = list.found.indexOf(place);
  const next = list.found[at + by];
  return next === undefined ? -1 : next;
}
