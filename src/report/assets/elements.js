// Elements, always with data as text or attribute values and never as markup; and numbers as people read them.

function element(name, attributes, ...children) {
  return filled(document.createElement(name), attributes, children);
}

function svgElement(name, attributes, ...children) {
  return filled(document.createElementNS("http://www.w3.org/2000/svg", name), attributes, children);
}

function filled(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes || {})) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(key, String(value));
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}

function byId(id) {
  return document.getElementById(id);
}

/** Text in which E_w and E_n are written as symbols. */
function withSymbols(text) {
  return text.split(/(E_[wn])/).map((part) => (/^E_[wn]$/.test(part) ? element("span", {}, "E", element("sub", {}, part[2])) : part));
}

const wholeFormat = new Intl.NumberFormat("en", { maximumFractionDigits: 0 });

function whole(value) {
  return wholeFormat.format(value);
}

/** A number with at most so many digits that count. */
function number(value, digits = 5) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e7)) return value.toExponential(digits - 2).replace("-", "−");
  return String(Number(value.toPrecision(digits))).replace("-", "−");
}

/** A number where there is little room. */
function short(value) {
  return number(value, 4);
}

function fixed(value, digits) {
  return value === null || value === undefined || Number.isNaN(value) ? "–" : value.toFixed(digits).replace("-", "−");
}

function count(n, word) {
  return `${whole(n)} ${word}${n === 1 ? "" : "s"}`;
}

/** A table that scrolls sideways on its own; `columns` are [title, class], `rows` lists of cells. */
function table(caption, columns, rows) {
  const cell = (name, content, column, extra) => element(name, { class: column[1], ...extra }, content);
  return element(
    "div",
    { class: "scroll", tabindex: 0, role: "region", "aria-label": caption },
    element(
      "table",
      {},
      element("caption", {}, caption),
      element("thead", {}, element("tr", {}, columns.map((c) => cell("th", c[0], c, { scope: "col" })))),
      element("tbody", {}, rows.map((row) => element("tr", {}, row.map((content, i) => (content instanceof Cell ? content.node : cell("td", content, columns[i])))))),
    ),
  );
}

/** A cell that is made by hand. */
class Cell {
  constructor(node) {
    this.node = node;
  }
}
