// Runs in a page that shows others, each in a frame as wide as a desk's or a phone's screen, and writes down
// what it finds wrong with them. What is expected is worked out here, not asked of the pages' own script.
(async () => {
  "use strict";
  const { pages, widths } = JSON.parse(document.getElementById("asked").textContent);
  const all = (root, selector) => [...root.querySelectorAll(selector)];
  const collator = new Intl.Collator("en", { numeric: true, sensitivity: "base" });

  function cellAt(row, column) {
    let at = 0;
    for (const cell of row.cells) {
      if (at === column) return cell;
      at += cell.colSpan;
    }
    return null;
  }

  function keyOf(row, column, kind) {
    const cell = cellAt(row, column);
    const text = cell ? (cell.dataset.value ?? cell.textContent).trim() : "";
    if (kind === "text") return text === "" || text === "–" ? null : text;
    const number = parseFloat(text.replace("−", "-").replace(/\s/g, ""));
    return Number.isNaN(number) ? null : number;
  }

  const rowsOf = (table) => [...table.tBodies].flatMap((body) => [...body.rows]);
  const shownRows = (table) => rowsOf(table).filter((row) => row.getClientRects().length > 0);

  function sorting(table) {
    const wrong = [];
    for (const header of all(table, "thead th[data-sort]")) {
      const column = [...header.parentElement.cells]
        .slice(0, [...header.parentElement.cells].indexOf(header))
        .reduce((sum, cell) => sum + cell.colSpan, 0);
      const name = `${table.id || "table"}, column ${header.textContent.trim()}`;
      const button = header.querySelector("button");
      if (!button) {
        wrong.push(`${name}: no button`);
        continue;
      }
      const before = rowsOf(table).length;
      const compare = header.dataset.sort === "text" ? collator.compare : (a, b) => a - b;
      for (const [direction, sign] of [["ascending", 1], ["descending", -1]]) {
        button.click();
        if (header.getAttribute("aria-sort") !== direction) wrong.push(`${name}: aria-sort is not ${direction}`);
        if (rowsOf(table).length !== before) wrong.push(`${name}: sorting changed the number of rows`);
        for (const body of table.tBodies) {
          const keys = [...body.rows].map((row) => keyOf(row, column, header.dataset.sort));
          const full = keys.filter((key) => key !== null);
          if (keys.slice(0, full.length).includes(null)) wrong.push(`${name}: empty cells are not last`);
          if (full.some((key, i) => i && sign * compare(full[i - 1], key) > 0)) wrong.push(`${name}: not ${direction}`);
        }
      }
    }
    return wrong;
  }

  function filtering(page, table) {
    const wrong = [];
    const own = `[data-table="${table.id}"]`;
    const selects = all(page, `select[data-filter]${own}`);
    const searches = all(page, `input[type=search]${own}`);
    if (!selects.length && !searches.length) return wrong;
    const set = (field, value) => {
      field.value = value;
      field.dispatchEvent(new Event("input", { bubbles: true }));
    };
    const expect = (name) => {
      const meant = rowsOf(table).filter((row) =>
        selects.every((s) => s.value === "" || s.value.split("|").includes(row.getAttribute(`data-${s.dataset.filter}`))) &&
        searches.every((s) => s.value.toLowerCase().split(/\s+/).every((word) => row.textContent.toLowerCase().includes(word))));
      const shown = shownRows(table);
      if (shown.length !== meant.length || shown.some((row, i) => row !== meant[i])) {
        wrong.push(`${table.id}, ${name}: ${shown.length} rows are shown and ${meant.length} are meant`);
      }
      for (const output of all(page, `output[data-count="${table.id}"]`)) {
        if (parseInt(output.textContent, 10) !== meant.length) wrong.push(`${table.id}, ${name}: told ${output.textContent}`);
      }
      return meant.length;
    };
    const start = selects.map((select) => select.value);
    expect("as it opens");
    selects.forEach((select) => set(select, ""));
    const everything = expect("nothing chosen");
    let narrower = 0;
    for (const select of selects) {
      for (const option of select.options) {
        set(select, option.value);
        narrower += expect(`${select.dataset.filter} = ${option.value}`) < everything;
      }
      set(select, "");
    }
    for (const search of searches) {
      const word = rowsOf(table)[0].textContent.trim().split(/\s+/)[0];
      set(search, word.toUpperCase());
      if (!expect(`search ${word}`)) wrong.push(`${table.id}: a word of the first row finds nothing`);
      set(search, "qqzzqq");
      narrower += expect("search of no word") === 0;
      set(search, "");
    }
    if (!narrower) wrong.push(`${table.id}: nothing that can be chosen hides a row`);
    selects.forEach((select, i) => set(select, start[i]));
    return wrong;
  }

  function drawings(page) {
    const wrong = [];
    for (const use of all(page, "use")) {
      const target = use.getAttribute("href") ?? use.getAttribute("xlink:href") ?? "";
      if (!page.getElementById(target.slice(1))) wrong.push(`nothing is drawn at ${target}`);
    }
    for (const part of all(page, "[clip-path]")) {
      const target = part.getAttribute("clip-path").match(/^url\(#(.*)\)$/);
      if (target && !page.getElementById(target[1])) wrong.push(`nothing clips at ${target[1]}`);
    }
    for (const svg of all(page, "svg[role=img]")) {
      const size = svg.getBoundingClientRect();
      const name = (svg.getAttribute("aria-label") ?? "").slice(0, 60);
      if (!name) wrong.push("a drawing without words");
      if (size.width < 8 || size.height < 8) wrong.push(`the drawing "${name}" has no size`);
    }
    for (const image of all(page, "img")) {
      if (!image.complete || !image.naturalWidth) wrong.push(`the image ${image.src.slice(0, 60)} did not load`);
    }
    return wrong;
  }

  function overflow(frame, page) {
    const wide = frame.contentWindow.innerWidth;
    if (Math.max(page.documentElement.scrollWidth, page.body.scrollWidth) <= wide) return [];
    const scrolls = (part) => part && (getComputedStyle(part).overflowX !== "visible" || scrolls(part.parentElement));
    const far = all(page, "body *").filter((part) => part.getBoundingClientRect().right > wide + 1 && !scrolls(part.parentElement));
    return [`${wide} px: wider than the screen: ${far.slice(0, 3).map((part) => `${part.tagName}.${part.className}`).join(", ")}`];
  }

  const told = {};
  for (const address of pages) {
    const found = { wrong: [], ids: [], links: [], requests: [] };
    for (const width of widths) {
      const frame = document.createElement("iframe");
      frame.style.cssText = `width:${width}px;height:900px;border:0`;
      await new Promise((done) => {
        frame.addEventListener("load", done);
        frame.src = address;
        document.body.append(frame);
      });
      const page = frame.contentDocument;
      all(page, "details").forEach((part) => { part.open = true; });
      found.wrong.push(...overflow(frame, page));
      if (width === widths[0]) {
        found.wrong.push(...drawings(page));
        for (const table of all(page, "table.sortable")) found.wrong.push(...filtering(page, table), ...sorting(table));
        found.ids = all(page, "[id]").map((part) => part.id);
        found.links = all(page, "a[href]").map((part) => part.getAttribute("href"));
        found.sortable = all(page, "table.sortable").length;
        found.drawings = all(page, "svg[role=img]").length;
      }
      found.requests.push(...frame.contentWindow.performance.getEntriesByType("resource").map((entry) => entry.name));
      frame.remove();
    }
    told[address] = found;
  }
  const answer = document.createElement("pre");
  answer.id = "told";
  answer.textContent = JSON.stringify(told);
  document.body.replaceChildren(answer);
})();
