"use strict";
// Sort and filter the leaderboard. Without this script, the table is complete and unsorted.
(() => {
  const body = document.querySelector(".board tbody");
  const rows = [...body.rows];
  const form = document.querySelector(".filters");
  const field = (id) => document.getElementById(id);

  const filter = () => {
    const words = field("search").value.toLowerCase().split(/\s+/).filter(Boolean);
    let n = 0;
    for (const row of rows) {
      const text = row.textContent.toLowerCase();
      const shown = ["dataset", "question", "method"].every((id) => !field(id).value || row.dataset[id] === field(id).value)
        && (!field("best").checked || row.dataset.tied === "1")
        && words.every((word) => text.includes(word));
      row.hidden = !shown;
      n += shown;
    }
    field("count").textContent = `${n} ${n === 1 ? "row" : "rows"}`;
  };

  // Cells of a failed row are merged, so its missing values sort last.
  const key = (row, column, kind) => {
    const cell = row.querySelector(".failed") && column > 3 ? null : row.cells[column];
    const text = cell ? cell.textContent.trim() : "";
    return kind === "number" ? (text === "" ? null : Number(text)) : text;
  };

  document.querySelectorAll(".board th button").forEach((button) => {
    const head = button.parentElement;
    const column = head.cellIndex;
    button.addEventListener("click", () => {
      const numbers = button.dataset.kind === "number";
      const first = numbers ? "descending" : "ascending";
      const second = numbers ? "ascending" : "descending";
      const order = head.getAttribute("aria-sort") === first ? second : first;
      head.parentElement.querySelectorAll("th").forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", order);
      const sign = order === "ascending" ? 1 : -1;
      rows.sort((a, b) => {
        const [x, y] = [key(a, column, button.dataset.kind), key(b, column, button.dataset.kind)];
        if (x === null || y === null) return (x === null) - (y === null);
        return sign * (numbers ? x - y : x.localeCompare(y));
      });
      body.append(...rows);
    });
  });

  form.addEventListener("input", filter);
  form.addEventListener("reset", () => setTimeout(filter));
  form.addEventListener("submit", (event) => event.preventDefault());
})();
