"use strict";
// Keys and pointer in figures and heat maps, and tables that sort. Without this script all numbers are there as tables.
(() => {
  const say = (figure, text) => {
    const readout = figure.querySelector(".readout");
    if (readout) readout.textContent = text;
  };

  // One stop of the tab key for many members; arrow keys move within.
  const rove = (members, next, chosen) => {
    let at = 0;
    members.forEach((m, i) => m.setAttribute("tabindex", i ? "-1" : "0"));
    const go = (i) => {
      members[at].setAttribute("tabindex", "-1");
      at = i;
      members[at].setAttribute("tabindex", "0");
    };
    members.forEach((m, i) => {
      m.addEventListener("focus", () => { go(i); chosen(m); });
      m.addEventListener("keydown", (event) => {
        const to = next(event, i);
        if (to === null) return;
        event.preventDefault();
        members[Math.max(0, Math.min(members.length - 1, to))].focus();
      });
    });
  };

  const steps = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
  document.querySelectorAll("svg.plot").forEach((plot) => {
    const points = [...plot.querySelectorAll(".point")];
    if (!points.length) return;
    const figure = plot.closest("figure");
    const show = (point) => say(figure, point.getAttribute("aria-label"));
    rove(points, (event, i) => {
      if (event.key === "Home") return 0;
      if (event.key === "End") return points.length - 1;
      return event.key in steps ? i + steps[event.key] : null;
    }, show);
    // The pointer chooses the nearest point, so that a small mark is easy to hit.
    let near = null;
    plot.addEventListener("pointermove", (event) => {
      const away = (point) => {
        const box = point.getBoundingClientRect();
        return Math.hypot(
          Math.max(box.left - event.clientX, 0, event.clientX - box.right),
          Math.max(box.top - event.clientY, 0, event.clientY - box.bottom));
      };
      const found = points.reduce((best, point) => away(point) < away(best) ? point : best);
      if (found === near || away(found) > 40) return;
      if (near) near.classList.remove("near");
      near = found;
      near.classList.add("near");
      show(near);
    });
  });

  document.querySelectorAll("table.matrix").forEach((table) => {
    const figure = table.closest("figure");
    const names = [...table.tHead.rows[0].cells].slice(1);
    const n = names.length;
    const cells = [...table.tBodies[0].rows].flatMap((row) => [...row.cells].slice(1));
    const words = (cell) => cell.title || `${cell.parentNode.cells[0].textContent}${table.dataset.separator}${
      names[cell.cellIndex - 1].textContent.trim()}: ${table.dataset.empty}`;
    let marked = [];
    const show = (cell) => {
      marked.forEach((head) => head.classList.remove("on"));
      marked = [cell.parentNode.cells[0], names[cell.cellIndex - 1]];
      marked.forEach((head) => head.classList.add("on"));
      say(figure, words(cell));
    };
    table.setAttribute("role", "grid");
    table.setAttribute("aria-readonly", "true");
    const moves = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] };
    rove(cells, (event, k) => {
      const i = Math.floor(k / n), j = k % n;
      if (event.key === "Home") return event.ctrlKey ? 0 : i * n;
      if (event.key === "End") return event.ctrlKey ? cells.length - 1 : i * n + n - 1;
      if (!(event.key in moves)) return null;
      const [down, right] = moves[event.key];
      const clamp = (v, most) => Math.max(0, Math.min(most - 1, v));
      return clamp(i + down, cells.length / n) * n + clamp(j + right, n);
    }, (cell) => { cell.setAttribute("aria-label", words(cell)); show(cell); });
    table.addEventListener("pointerover", (event) => {
      const cell = event.target.closest("td");
      if (cell) show(cell);
    });
  });

  // A heading sorts its column: numbers from the largest, words from A; then the other way; then as it was.
  document.querySelectorAll("table.sorts").forEach((table) => {
    const body = table.tBodies[0], written = [...body.rows];
    if (written.length < 3) return;
    const value = (row, column, numeric) => {
      const cell = row.cells[column];
      if (!cell || row.cells.length < table.dataset.n) return null;
      const text = (cell.firstChild?.textContent ?? "").trim();
      if (!numeric) return text || null;
      const found = parseFloat(text.replaceAll(",", "").replace("\u2212", "-").replace(/^[^\d.+-]+/, ""));
      return Number.isNaN(found) ? null : found;
    };
    table.dataset.n = Math.max(...written.map((row) => row.cells.length));
    const heads = [...table.querySelectorAll("thead [data-column]")];
    heads.forEach((head) => {
      const column = Number(head.dataset.column), numeric = head.classList.contains("num");
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const order = numeric ? ["descending", "ascending", null] : ["ascending", "descending", null];
        const now = order[(order.indexOf(head.getAttribute("aria-sort")) + 1) % 3];
        heads.forEach((other) => other.removeAttribute("aria-sort"));
        if (now) head.setAttribute("aria-sort", now);
        const sign = now === "ascending" ? 1 : -1;
        const keyed = written.map((row) => [value(row, column, numeric), row]);
        if (now) keyed.sort(([a], [b]) => a === null || b === null ? (a === null) - (b === null)
          : sign * (numeric ? a - b : a.localeCompare(b, "en", { numeric: true })));
        body.append(...keyed.map(([, row]) => row));
      });
    });
  });

  // A region is a stop of the tab key only while there is something to scroll.
  const regions = [...document.querySelectorAll(".scroll")];
  const update = () => regions.forEach((region) => {
    if (region.scrollWidth > region.clientWidth + 1) region.setAttribute("tabindex", "0");
    else region.removeAttribute("tabindex");
  });
  update();
  addEventListener("resize", update);
  document.querySelectorAll("details").forEach((d) => d.addEventListener("toggle", update));
})();
