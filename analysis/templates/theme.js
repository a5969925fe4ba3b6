// Light or dark; tables that sort and can be saved as CSV.
(function () {
  "use strict";
  const button = document.querySelector("[data-theme-button]"), root = document.documentElement;
  const dark = () => root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const name = () => { if (button) button.textContent = dark() ? "Light page" : "Dark page"; };
  const changed = () => { name(); document.dispatchEvent(new Event("lcbayes-theme")); };
  if (button) {
    button.hidden = false; name();
    button.addEventListener("click", () => { root.dataset.theme = dark() ? "light" : "dark"; changed(); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
    let before;  // paper is light, and canvases keep the colours in which they were painted
    addEventListener("beforeprint", () => { before = root.dataset.theme; root.dataset.theme = "light"; changed(); });
    addEventListener("afterprint", () => { if (before) root.dataset.theme = before; else delete root.dataset.theme; changed(); });
  }

  const number = (text) => {
    const found = /^[^\d+\-−.]*([+\-−]?\d+(?:\.\d+)?)(?:×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?/.exec(text.replace("–", ""));
    if (!found) return NaN;
    const power = [...(found[2] || "⁰")].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c)).map((k) => (k ? k - 1 : "-")).join("");
    return Number(found[1].replace("−", "-")) * 10 ** Number(power);
  };
  const text = (cell) => cell.innerText.trim().replace(/\s+/g, " ");
  const plain = (value) => value.replace(/−/g, "-").replace(/×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)/g, (_, p) => "e" + [...p].map((c) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹".indexOf(c)).map((k) => (k ? k - 1 : "-")).join(""));
  const quoted = (value) => (/[",\n]/.test(value) ? `"${value.replace(/"/g, '""')}"` : value);

  document.querySelectorAll("main table").forEach((table, k) => {
    const body = table.tBodies[0], head = table.tHead && table.tHead.rows[0];
    if (!body || !head || !body.rows.length) return;
    [...head.cells].forEach((cell, column) => {
      if (!text(cell) || body.rows.length < 2) return;
      const sorter = document.createElement("button");
      sorter.type = "button"; sorter.className = "sorter"; sorter.append(...cell.childNodes);
      sorter.title = "sort by this column";
      cell.append(sorter);
      sorter.addEventListener("click", () => {
        const down = cell.getAttribute("aria-sort") === "ascending";
        [...head.cells].forEach((c) => c.removeAttribute("aria-sort"));
        cell.setAttribute("aria-sort", down ? "descending" : "ascending");
        const rows = [...body.rows].map((row) => ({ row, text: text(row.cells[column]) }));
        const values = rows.map((r) => number(r.text)), numeric = values.filter(Number.isFinite).length * 2 > rows.length;
        rows.forEach((r, i) => { r.value = values[i]; });
        rows.sort((a, b) => (numeric ? (Number.isNaN(a.value) - Number.isNaN(b.value)) || (down ? b.value - a.value : a.value - b.value)
          : (down ? -1 : 1) * a.text.localeCompare(b.text)));
        body.append(...rows.map((r) => r.row));
      });
    });
    const save = document.createElement("button");
    save.type = "button"; save.className = "save"; save.textContent = "Save as CSV";
    save.addEventListener("click", () => {
      const lines = [head, ...body.rows].map((row) => [...row.cells].map((c) => quoted(plain(text(c)))).join(","));
      const link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([lines.join("\n") + "\n"], { type: "text/csv" }));
      link.download = `${table.dataset.name || `table-${k + 1}`}.csv`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
    (table.closest(".scroll") || table).after(save);
  });
})();
