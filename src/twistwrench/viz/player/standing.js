// A robot on its feet: contact forces of least norm that share its weight, and whether it can stand so.
"use strict";

class Standing {
  constructor(mechanics) {
    const { robot } = mechanics;
    Object.assign(this, { mechanics, ...robot.standing });
    this.hull = hullOf(this.points(robot.start));
  }

  points(q) { // of contact, in the base's axes
    const poses = this.mechanics.poses(q);
    return this.contacts.map(({ body, point }) => add(place(poses[body]), turn(poses[body], point)));
  }

  // What takes forces at the contacts to torques, three columns for each contact: J' of the point.
  columns(q) {
    const { mechanics, contacts, feet } = this, n = mechanics.robot.torques.length, poses = mechanics.poses(q);
    const J = feet.map((_, k) => mechanics.run[`foot${k}`](q));
    return contacts.flatMap(({ body, point }) => {
      const [x, y, z] = turn(poses[body], point), K = J[feet.indexOf(body)], at = (i, k) => K[n * i + k];
      const rows = mechanics.robot.torques.map((_, k) => [at(3, k) + at(1, k) * z - at(2, k) * y, at(4, k) + at(2, k) * x - at(0, k) * z, at(5, k) + at(0, k) * y - at(1, k) * x]);
      return [0, 1, 2].map((i) => rows.map((row) => row[i]));
    });
  }

  // Forces and torques within the limits; where there are none, those that pass them; {forces, tau, over} or null.
  held(q) {
    const columns = this.columns(q), holding = Array.from(this.mechanics.holding(q)), free = this.limits.map((limit) => (limit === 0 ? 0 : null));
    for (const [limits, over] of [[this.limits, false], [free, true]]) {
      const f = leastNormForces(columns, holding, limits, this.facets);
      if (!f) continue;
      const tau = holding.map((x, k) => (this.limits[k] === 0 ? 0 : x - columns.reduce((sum, column, j) => sum + column[k] * f[j], 0)));
      return { forces: this.contacts.map((_, k) => f.slice(3 * k, 3 * k + 3)), tau, over };
    }
    return null;
  }

  stable(p) { return inHull(this.hull, p); } // a point above the polygon of the feet
}

// The least sum f^2 with load - B f zero where a limit is, within the others (null: none), and facets . f >= 0 for each
// contact; null where there are none. Columns are those of B. Least distance programming: Lawson and Hanson, chapter 23.4.
function leastNormForces(columns, load, limits, facets) {
  const n = columns.length, size = Math.max(...load.map(Math.abs)) || 1, exact = [];
  const row = (k) => columns.map((column) => column[k]);
  for (const [k, limit] of limits.entries()) { // rows at right angles, and what they have to give
    if (limit !== 0) continue;
    let g = row(k), b = load[k] / size;
    const whole = Math.sqrt(inner(g, g));
    for (let twice = 0; twice < 2; twice++) for (const e of exact) { const s = inner(e.g, g); g = add(g, times(-s, e.g)); b -= s * e.b; }
    const rest = Math.sqrt(inner(g, g));
    if (rest > 1e-10 * (whole || 1)) exact.push({ g: times(1 / rest, g), b: b / rest });
    else if (Math.abs(b) > 1e-9) return null;
  }
  const x0 = exact.map(({ g, b }) => times(b, g)).reduce(add, new Array(n).fill(0)), sides = [];
  const side = (c, h) => {
    let rest = c;
    for (const { g } of exact) rest = add(rest, times(-inner(g, rest), g));
    sides.push([...rest, h - inner(c, x0)]);
  };
  for (let k = 0; k < n; k += 3) for (const facet of facets) { const c = new Array(n).fill(0); facet.forEach((x, i) => { c[k + i] = x; }); side(c, 0); }
  limits.forEach((limit, k) => {
    if (limit === null || limit === 0) return;
    side(row(k), (load[k] - limit) / size);
    side(times(-1, row(k)), (-load[k] - limit) / size);
  });
  const target = [...new Array(n).fill(0), 1], left = nonNegativeRemainder(sides, target);
  if (Math.sqrt(inner(left, left)) <= 1e-9) return null;
  return x0.map((x, i) => size * (x - left[i] / left[n]));
}

// target - E u with u >= 0 of least norm, E by its columns. Lawson and Hanson, chapter 23.3.
function nonNegativeRemainder(given, target) {
  const columns = given.map((c) => times(1 / (Math.sqrt(inner(c, c)) || 1), c)), u = new Array(columns.length).fill(0), barred = new Set();
  let passive = [], left = target.slice();
  for (let turn_ = 0; turn_ < 3 * columns.length + 30; turn_++) {
    let best = -1, most = 1e-12;
    columns.forEach((c, j) => { if (passive.includes(j) || barred.has(j)) return; const w = inner(c, left); if (w > most) [best, most] = [j, w]; });
    if (best < 0) break;
    passive.push(best);
    for (;;) {
      const s = leastSquares(passive.map((j) => columns[j]), target);
      if (!s || s[passive.indexOf(best)] <= 0 && u[best] === 0) { passive = passive.filter((j) => j !== best); barred.add(best); break; } // of what is there already
      const low = passive.map((j, k) => (s[k] <= 0 ? u[j] / (u[j] - s[k]) : Infinity)), share = Math.min(1, ...low);
      passive.forEach((j, k) => { u[j] += share * (s[k] - u[j]); });
      if (share === 1 && low.every((x) => x === Infinity)) { barred.clear(); break; }
      passive = passive.filter((j, k) => { const stays = s[k] > 0 || low[k] > share; if (!stays) u[j] = 0; return stays; });
    }
    left = passive.reduce((rest, j) => add(rest, times(-u[j], columns[j])), target);
  }
  return left;
}

function leastSquares(columns, target) { // by Gram and Schmidt, twice; null where a column depends on others
  const Q = [], R = columns.map(() => new Array(columns.length).fill(0));
  for (const [k, column] of columns.entries()) {
    let rest = column;
    for (let twice = 0; twice < 2; twice++) Q.forEach((q, i) => { const s = inner(q, rest); R[i][k] += s; rest = add(rest, times(-s, q)); });
    R[k][k] = Math.sqrt(inner(rest, rest));
    if (R[k][k] < 1e-11) return null;
    Q.push(times(1 / R[k][k], rest));
  }
  const x = Q.map((q) => inner(q, target));
  for (let i = x.length - 1; i >= 0; i--) { for (let k = i + 1; k < x.length; k++) x[i] -= R[i][k] * x[k]; x[i] /= R[i][i]; }
  return x;
}

function hullOf(points) { // corners of the convex hull in the plane of the floor, counterclockwise
  const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]), turns = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  const half = (list) => list.reduce((chain, p) => { while (chain.length > 1 && turns(chain[chain.length - 2], chain[chain.length - 1], p) <= 0) chain.pop(); return [...chain, p]; }, []).slice(0, -1);
  return sorted.length < 3 ? sorted : [...half(sorted), ...half(sorted.slice().reverse())];
}

const inHull = (hull, p) => hull.length > 2 && hull.every((a, k) => { const b = hull[(k + 1) % hull.length]; return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= 0; });
