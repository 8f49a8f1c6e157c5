"use strict";
// Arrow keys and pointer in figures and confusion matrices. Without this script all numbers are there as tables.
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
    points.forEach((point) => point.addEventListener("pointerenter", () => show(point)));
  });

  document.querySelectorAll("table.matrix").forEach((table) => {
    const figure = table.closest("figure");
    const names = [...table.tHead.rows[0].cells].slice(1);
    const rows = [...table.tBodies[0].rows];
    const n = names.length;
    const cells = rows.flatMap((row) => [...row.cells].slice(1));
    const totals = rows.map((row) => [...row.cells].slice(1).reduce((sum, cell) => sum + Number(cell.textContent), 0));
    const words = (cell) => {
      const i = cell.parentNode.sectionRowIndex, j = cell.cellIndex - 1;
      const count = Number(cell.textContent), total = totals[i];
      const share = total ? Math.round((100 * count) / total) : 0;
      const what = i === j ? "recognised" : `taken for ${names[j].textContent.trim()}`;
      return `${rows[i].cells[0].textContent} ${what}: ${count} of ${total} ${table.dataset.tested} (${share} %)`;
    };
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
      if (event.key === "End") return event.ctrlKey ? n * n - 1 : i * n + n - 1;
      if (!(event.key in moves)) return null;
      const [down, right] = moves[event.key];
      const clamp = (v) => Math.max(0, Math.min(n - 1, v));
      return clamp(i + down) * n + clamp(j + right);
    }, (cell) => { cell.setAttribute("aria-label", words(cell)); show(cell); });
    table.addEventListener("pointerover", (event) => {
      const cell = event.target.closest("td");
      if (cell) show(cell);
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
