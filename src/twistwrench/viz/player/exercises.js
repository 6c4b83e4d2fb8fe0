// Exercises of exercises.toml: their answers by section, from the mechanics, the sliders and the readout, and how they are checked.
"use strict";

const cell = ({ tables }, table, row) => tables[table].rows[row][1];
const columnAt = (m, q, k) => m.tipColumns(q)[k];
const solvedBy = (M, b) => { const L = cholesky(M, b.length); return raised(L, lowered(L, b)); };
const powerOf = (tau, dq) => inner(Array.from(tau), dq);
const firstOf = (n) => Array.from({ length: n }, (_, k) => Number(k === 0));
const semiAxes = (found) => found.tables[0].rows.map(([, [velocity]]) => velocity);

const ANSWERS = {
  "3.4": [
    (m, s, found) => norm(cell(found, 0, 0).slice(3)),
    (m, s, found) => norm(cell(found, 0, 1).slice(3)),
    (m, { wrench }, found) => dot(cell(found, 0, 0), wrench),
  ],
  "5.1": [
    (m, { q }) => 2 * norm(columnAt(m, q, 0)),
    (m, s, found) => norm([0, 1, 2].map((i) => cell(found, 0, i).reduce((sum, x) => sum + x, 0))),
    (m, { dq }, found) => norm([3, 4, 5].map((i) => inner(cell(found, 0, i), dq) - cell(found, 0, i)[0] * dq[0])),
  ],
  "5.2": [
    (m, { q, wrench }) => 2 * Array.from(m.run.statics(q, [0, 0, 0, ...wrench.slice(3)]))[0],
    (m, s, { tau }) => 100 / Math.max(...tau.map(Math.abs)),
    (m, s, { tau }) => 0.001 * tau.reduce((sum, x) => sum + x, 0),
  ],
  "5.3": [
    (m, s, found) => { const sigma = cell(found, 0, 0); return sigma[0] / sigma[sigma.length - 1]; },
    (m, s, found) => cell(found, 0, 0).reduce((product, x) => product * x, 1),
    (m, s, found) => 2 * cell(found, 0, 0).slice(-1)[0],
  ],
  "5.4": [
    (m, s, found) => 10 / semiAxes(found).slice(-1)[0],
    (m, s, found) => 0.5 * semiAxes(found).slice(-1)[0],
    (m, s, found) => 1 / semiAxes(found)[0],
  ],
  "8.1.2": [
    (m, { chosen }, { tau }) => 4 * tau[chosen],
    (m, { dq }, { tau }) => powerOf(tau, dq),
    (m, { q, dq }) => { const n = dq.length; return m.run.christoffel(q, ...m.load)[n * n - 1] * dq[n - 1] ** 2; },
  ],
  "8.1.3": [
    (m, s, found) => 2 * cell(found, 0, 0)[0],
    (m, s, found) => 3 * Math.hypot(...cell(found, 0, 0)),
    (m, s, found) => 2 * cell(found, 1, 0)[0],
  ],
  "8.2": [
    (m, { chosen }) => { const { inertia: G } = m.robot.book.links[chosen]; return Math.hypot(G[4], G[5], G[11]) / G[35]; }, // of m [c]
    (m, { chosen }, found) => { const p = cell(found, 2, 0).slice(3); return dot(p, p) / (2 * m.robot.book.links[chosen].inertia[35]); },
    (m, s, found) => inner(cell(found, 0, 0), cell(found, 3, 2)),
  ],
  "8.3": [
    (m, s, found) => norm(cell(found, 2, 3).slice(3)),
    (m, { chosen, dq }, { tau }) => tau[chosen] * dq[chosen],
    (m, { dq }, { tau }) => powerOf(tau, dq),
  ],
  "8.4": [
    (m, s, found) => (100 * cell(found, 2, 0)[0]) / cell(found, 3, 0)[0],
    (m, { dq }, found) => dq.reduce((sum, v, i) => sum + v * inner(cell(found, 2, i), dq), 0) / 2,
    (m, { dq }, { tau }) => powerOf(tau, dq),
  ],
  "8.5": [
    (m, { q, tau }) => solvedBy(m.massMatrix(q), firstOf(tau.length))[0],
    (m, { q, tau }) => solvedBy(m.massMatrix(q), tau)[0],
    (m, { dq }, found) => dq[0] + 0.01 * cell(found, 0, 3)[0],
  ],
  "8.6": [
    (m, s, found) => 2 * cell(found, 1, 0)[0] + cell(found, 1, 1)[0],
    (m, s, found) => 1 / solvedBy(found.tables[0].rows.flatMap(([, row]) => row), firstOf(found.tables[0].rows.length))[0],
    (m, { q, dq }) => Array.from(m.run.task_bias(q, times(0, dq), ...m.load).eta)[0],
  ],
  "8.7": [
    (m, s, { values }) => values[0][1] + 10,
    (m, s, found) => cell(found, 0, 5)[0],
    () => 0,
  ],
  "8.9": [
    (m, { motor }, found) => Math.sqrt(cell(found, 0, 0)[0] / (1e-4 * motor[1])),
    (m, { dq }, found) => cell(found, 0, 0)[4] * dq[0],
    (m, s, found) => found.tables[1].rows.reduce((sum, [, row]) => sum + row[2], 0),
  ],
};

// Values of near-misses that need an expression.
const NEAR_VALUES = { "3.4": [(m, s, found) => ({ frame: [norm(cell(found, 0, 1).slice(3))] })] };

class Exercises {
  constructor(book) {
    this.book = book;
    const place_ = document.getElementById("exercises"), list = place_.querySelector("ol");
    place_.hidden = false;
    this.rows = book.book.exercises.map(({ question, unit: unit_, formula, near }, k) => ({ ...this.row(list, k, question, unit_, formula), near }));
  }

  row(list, k, question, unit_, formula) {
    const item = list.appendChild(document.createElement("li")), form = document.createElement("form"), field = document.createElement("input");
    const button = Object.assign(document.createElement("button"), { textContent: "Check" }), result = document.createElement("output"), details = document.createElement("details");
    item.innerHTML = `<p id="question-${k}">${question}</p>`; // words of ours
    Object.assign(field, { type: "text", inputMode: "decimal", autocomplete: "off", className: "number" });
    field.setAttribute("aria-labelledby", `question-${k}`);
    details.innerHTML = `<summary>Formula</summary><span class="formula">${formula}</span>`;
    form.append(field, ` ${unit_} `, button, result);
    form.addEventListener("submit", (event) => { event.preventDefault(); this.check(k); });
    item.append(form, details);
    return { field, result };
  }

  check(k) {
    const { field, result, near } = this.rows[k], { right, words } = judged(field.value, this.answer(k), this.nearValues(k), near);
    result.textContent = words;
    result.className = right ? "right" : "wrong";
  }

  answer(k) { return this.evaluated(ANSWERS[this.book.book.number][k]); }
  nearValues(k) { return this.evaluated(NEAR_VALUES[this.book.book.number]?.[k] ?? (() => ({}))); }

  evaluated(expression) {
    const { viewer, state, found } = this.book;
    return expression(viewer.mechanics, { ...state, q: viewer.q }, found);
  }

  clear() { // results of another pose
    for (const { result } of this.rows) result.textContent = "";
  }
}
