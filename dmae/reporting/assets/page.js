// What every page does: change between light and dark, sort tables, and draw the bars of numbers.
"use strict";

const byId = (id) => document.getElementById(id);

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

function themeSwitch() {
  const button = byId("theme");
  const label = () => { button.textContent = isDark() ? "Light" : "Dark"; };
  const changed = () => { label(); document.dispatchEvent(new Event("themechange")); };
  button.hidden = false;
  button.addEventListener("click", () => {
    document.documentElement.dataset.theme = isDark() ? "light" : "dark";
    changed();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
  label();
}

// The number that a cell starts with; NaN for words, "-" and nothing.
const numberOf = (text) => parseFloat(text.trim().replace(/^[<>~±\s]+/, "").replace(/(\d)[,\u202f ](?=\d{3})/g, "$1"));

function compareCells(a, b) {
  const [x, y] = [numberOf(a), numberOf(b)];
  if (Number.isNaN(x) !== Number.isNaN(y)) return Number.isNaN(x) ? 1 : -1;  // what is not known comes last
  return Number.isNaN(x) ? a.localeCompare(b) : x - y;
}

function sortable(table) {
  const body = table.tBodies[0];
  const original = [...body.rows];
  if (original.length < 2) return;
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    button.title = "Sort";
    head.append(button);
    button.addEventListener("click", () => {
      const before = head.getAttribute("aria-sort");
      const next = before === null ? "ascending" : before === "ascending" ? "descending" : null;
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      let rows = original;
      if (next) {
        head.setAttribute("aria-sort", next);
        const text = (row) => row.cells[column].textContent;
        const known = (row) => !Number.isNaN(numberOf(text(row)));
        const sign = next === "ascending" ? 1 : -1;
        rows = [...original].sort((a, b) =>
          (known(a) === known(b) ? sign : 1) * compareCells(text(a), text(b)));
      }
      body.append(...rows);
    });
  });
}

function bars(table) {
  const columns = new Map();
  for (const cell of table.querySelectorAll("td.bar")) {
    const found = columns.get(cell.cellIndex) || [];
    found.push(cell);
    columns.set(cell.cellIndex, found);
  }
  for (const cells of columns.values()) {
    const most = Math.max(...cells.map((cell) => numberOf(cell.textContent) || 0));
    for (const cell of cells) {
      const share = most > 0 ? (numberOf(cell.textContent) || 0) / most : 0;
      cell.style.setProperty("--share", `${(85 * share).toFixed(1)}%`);
    }
  }
}

themeSwitch();
for (const table of document.querySelectorAll("table")) {
  sortable(table);
  bars(table);
}
