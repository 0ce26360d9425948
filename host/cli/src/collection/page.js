// Draws, sorts and filters what stands in #facts. Texts come from files: they are set as text, never as markup.
"use strict";
const all = JSON.parse(document.getElementById("facts").textContent);
const grid = document.getElementById("grid");
const percent = (share) => `${(100 * share).toFixed(2)} %`;
const plain = (number) => number.toPrecision(4);
const FIGURES = {
  coverage: percent, error: percent, sigma: percent, albedo: plain, reciprocity: percent,
  ax: plain, ay: plain, rd: plain, strength: plain, warnings: String,
};

function element(name, properties, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

function card(row) {
  const named = element("strong", { textContent: row.sample || row.path });
  const inner = [named];
  if (row.picture) {
    inner.unshift(element("img", { src: `data:image/png;base64,${row.picture}`, alt: "", width: 72, height: 72 }));
  }
  const head = row.report ? element("a", { href: row.report }, ...inner) : element("div", {}, ...inner);
  const figures = element("dl", {});
  for (const [name, text] of [["path", row.path], ["rig", row.rig], ["date", row.date ?? "–"]]) {
    figures.append(element("dt", { textContent: name }), element("dd", { textContent: text }));
  }
  for (const [name, shown] of Object.entries(FIGURES)) {
    if (row[name] !== null) {
      figures.append(element("dt", { textContent: name }), element("dd", { textContent: shown(row[name]) }));
    }
  }
  return element("li", {}, head, figures);
}

const option = (name) => element("option", { value: name, textContent: name });
const text = element("input", { type: "search", id: "text", placeholder: "sample, path, rig" });
const sort = element("select", { id: "sort" }, ...["path", "sample", "rig", "date", ...Object.keys(FIGURES)].map(option));
const order = element("select", { id: "order" }, option("ascending"), option("descending"));
const figure = element("select", { id: "figure" }, option(""), ...Object.keys(FIGURES).map(option));
const [least, most] = ["least", "most"].map((id) => element("input", { type: "number", step: "any", id }));
const asked = document.getElementById("asked");
for (const [name, input] of [
  ["search", text], ["sort by", sort], ["order", order], ["only with", figure], ["from", least], ["to", most],
]) {
  asked.append(element("label", { textContent: name }, input));
}

function isWanted(row) {
  const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
  const within = `${row.sample} ${row.path} ${row.rig}`.toLowerCase();
  if (!words.every((word) => within.includes(word))) return false;
  if (!figure.value) return true;
  const value = row[figure.value];
  // What is not known is within no limits.
  return value !== null
    && (least.value === "" || value >= Number(least.value)) && (most.value === "" || value <= Number(most.value));
}

function compared(a, b) {
  const [x, y] = [a[sort.value], b[sort.value]];
  // What is not known comes last, whatever the order.
  if (x === null || y === null) return (x === null) - (y === null);
  const sign = order.value === "descending" ? -1 : 1;
  return sign * (typeof x === "number" ? x - y : x < y ? -1 : x > y ? 1 : 0);
}

function draw() {
  const shown = all.filter(isWanted).sort(compared);
  document.getElementById("count").textContent = `${shown.length} of ${all.length} measurements`;
  grid.replaceChildren(...shown.map(card));
}

asked.addEventListener("input", draw);
asked.addEventListener("submit", (event) => event.preventDefault());
draw();
