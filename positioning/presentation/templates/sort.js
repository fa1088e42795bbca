// Sorts and filters tables; without it every row is there, in the order of the file.
//
// table.sortable        header cells <th data-sort="number|text"> get a button; a cell's data-value counts
//                       before its text; empty cells and dashes come last, equal ones keep their order
// select[data-filter]   with data-table: shows rows whose data-<filter> equals the option's value; "" is
//                       all, "a|b" is a or b; ?<filter>=value in the address chooses it
// input[type=search]    with data-table: shows rows that hold all its words
// output[data-count]    of that table: how many rows are shown
// .filters[hidden]      what does nothing without script and appears with it
(() => {
  "use strict";
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const collator = new Intl.Collator("en", { numeric: true, sensitivity: "base" });
  const rowsOf = (table) => [...table.tBodies].flatMap((body) => [...body.rows]);

  function cellAt(row, column) {
    let at = 0;
    for (const cell of row.cells) {
      if (at === column) return cell;
      at += cell.colSpan;
      if (at > column) return null;
    }
    return null;
  }

  function key(row, column, kind) {
    const cell = cellAt(row, column);
    const text = cell ? (cell.dataset.value ?? cell.textContent).trim() : "";
    if (kind !== "number") return /^[\u2013\u2014-]?$/.test(text) ? null : text;
    const number = parseFloat(text.replace(/\u2212/g, "-").replace(/[\s\u202f]/g, ""));
    return Number.isNaN(number) ? null : number;
  }

  function sort(table, header, column) {
    const descending = header.getAttribute("aria-sort") === "ascending";
    const kind = header.dataset.sort;
    const compare = kind === "number" ? (a, b) => a - b : collator.compare;
    for (const body of table.tBodies) {
      const keyed = [...body.rows].map((row) => [key(row, column, kind), row]);
      keyed.sort(([a], [b]) => {
        if (a === null || b === null) return (a === null) - (b === null);
        return descending ? compare(b, a) : compare(a, b);
      });
      body.append(...keyed.map(([, row]) => row));
    }
    all("th[aria-sort]", table).forEach((other) => other.removeAttribute("aria-sort"));
    header.setAttribute("aria-sort", descending ? "descending" : "ascending");
  }

  function filter(table) {
    const own = `[data-table="${table.id}"]`;
    const chosen = all(`select[data-filter]${own}`).filter((select) => select.value);
    const words = all(`input[type=search]${own}`).flatMap((input) => input.value.toLowerCase().split(/\s+/));
    const rows = rowsOf(table);
    for (const row of rows) {
      row.hidden = !(
        chosen.every((s) => s.value.split("|").includes(row.getAttribute(`data-${s.dataset.filter}`) ?? "")) &&
        words.every((word) => row.textContent.toLowerCase().includes(word))
      );
    }
    const shown = rows.filter((row) => !row.hidden).length;
    all(`output[data-count="${table.id}"]`).forEach((output) => {
      output.textContent = `${shown} of ${rows.length} rows`;
    });
  }

  // A link to a row that is filtered away shows the whole table.
  function reveal() {
    let target = null;
    try {
      target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    } catch {
      return;
    }
    const row = target?.closest("tr[hidden]");
    if (!row) return;
    const table = row.closest("table");
    all(`[data-table="${table.id}"]`).forEach((field) => { field.value = ""; });
    filter(table);
    row.scrollIntoView();
  }

  for (const table of all("table.sortable")) {
    for (const header of all("thead th[data-sort]", table)) {
      let column = 0;
      for (let th = header.previousElementSibling; th; th = th.previousElementSibling) column += th.colSpan;
      const button = document.createElement("button");
      button.type = "button";
      // Printed instead of the button, which no page after the first would repeat.
      header.dataset.name = header.textContent.trim();
      button.append(...header.childNodes);
      header.append(button);
      button.addEventListener("click", () => sort(table, header, column));
    }
  }
  const asked = new URLSearchParams(location.search);
  const filtered = new Set();
  for (const field of all("select[data-filter], input[type=search][data-table]")) {
    const table = document.getElementById(field.dataset.table);
    if (!table) continue;
    const value = field.dataset.filter && asked.get(field.dataset.filter);
    if (value && [...field.options].some((option) => option.value === value)) field.value = value;
    field.addEventListener("input", () => filter(table));
    filtered.add(table);
  }
  all(".filters[hidden]").forEach((part) => { part.hidden = false; });
  const refresh = () => filtered.forEach(filter);
  refresh();
  reveal();
  // Going back in the browser restores what was chosen after this script ran.
  addEventListener("pageshow", refresh);
  addEventListener("hashchange", reveal);
})();
