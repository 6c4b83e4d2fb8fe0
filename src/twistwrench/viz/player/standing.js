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
      const f = leastNormForces(columns, holding, limits, this.friction);
      if (!f) continue;
      const tau = holding.map((x, k) => (this.limits[k] === 0 ? 0 : x - columns.reduce((sum, column, j) => sum + column[k] * f[j], 0)));
      return { forces: this.contacts.map((_, k) => f.slice(3 * k, 3 * k + 3)), tau, over };
    }
    return null;
  }

  stable(p) { return inHull(this.hull, p); } // a point above the polygon of the feet
}

// The least sum f^2 with load - B f zero where a limit is, within the others (null: none), and friction * f_z >= |f_xy| for each
// contact; null where there are none. Columns are those of B. As statics.least_norm_contact_forces: projected Newton steps of
// the prices y of rows A f = b, and >= b of limits, where f is the force in the cones nearest to A' y.
function leastNormForces(columns, load, limits, friction) {
  const size = Math.max(...load.map(Math.abs)) || 1, A = [], b = [], sided = [];
  limits.forEach((limit, k) => {
    if (limit === null) return;
    const row = columns.map((column) => column[k]), unit = Math.sqrt(inner(row, row)) || 1;
    for (const way of limit ? [1, -1] : [1]) { A.push(times(way / unit, row)); b.push((way * load[k] - limit) / (unit * size)); sided.push(limit !== 0); }
  });
  const m = A.length, nearest = (y) => inCones(columns.map((_, i) => A.reduce((sum, row, k) => sum + row[i] * y[k], 0)), friction);
  const dual = (y) => { const { f } = nearest(y); return inner(b, y) - 0.5 * inner(f, f); };
  let y = new Array(m).fill(0), best = Infinity, found = null;
  for (let turn_ = 0; turn_ < 60 && best > 1e-12; turn_++) {
    const { f, slope } = nearest(y), left = A.map((row, k) => b[k] - inner(row, f));
    const slack = left.map((x, k) => sided[k] && y[k] <= 0 && x <= 0), grade = left.map((x, k) => (slack[k] ? 0 : x));
    const rest = Math.max(...grade.map(Math.abs));
    if (rest < best) [best, found] = [rest, f];
    const S = A.map(slope), H = A.flatMap((row, k) => S.map((s, j) => (slack[k] || slack[j] ? 0 : inner(row, s))));
    const trace = A.reduce((sum, _, k) => sum + H[k * m + k], 0), damping = Math.max(1e-3 * Math.min(rest, 1), 1e-12) * (1 + trace);
    for (let k = 0; k < m; k++) H[k * m + k] += damping;
    const L = cholesky(H, m), step = raised(L, lowered(L, grade)), start = dual(y);
    for (let share = 1, halving = 0; halving < 30; halving++, share /= 2) {
      const next = y.map((x, k) => (sided[k] ? Math.max(0, x + share * step[k]) : x + share * step[k]));
      const rise = inner(grade, next) - inner(grade, y);
      if (dual(next) >= start + 1e-4 * rise - 1e-14 * (1 + Math.abs(start)) || halving === 29) { y = next; break; }
    }
  }
  return best <= 1e-9 ? times(size, found) : null;
}

// Forces in the cones nearest to g, and the derivative of each with respect to g, applied to a change of all.
function inCones(g, friction) {
  const parts = [], f = g.slice();
  for (let k = 0; k < g.length; k += 3) {
    const slide = Math.hypot(g[k], g[k + 1]), u = [g[k] / (slide || 1), g[k + 1] / (slide || 1)], whole = Math.sqrt(1 + friction * friction);
    const edge = [friction * u[0] / whole, friction * u[1] / whole, 1 / whole], along = edge[0] * g[k] + edge[1] * g[k + 1] + edge[2] * g[k + 2];
    if (slide <= friction * g[k + 2]) parts.push((d) => d);
    else if (g[k + 2] <= -friction * slide) { f.splice(k, 3, 0, 0, 0); parts.push(() => [0, 0, 0]); } else {
      f.splice(k, 3, ...times(along, edge));
      const lean = friction / whole * along / slide;
      parts.push((d) => { const across = lean * (u[0] * d[1] - u[1] * d[0]); return add(times(inner(edge, d), edge), [-across * u[1], across * u[0], 0]); });
    }
  }
  return { f, slope: (d) => parts.flatMap((part, k) => part(d.slice(3 * k, 3 * k + 3))) };
}

function hullOf(points) { // corners of the convex hull in the plane of the floor, counterclockwise
  const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]), turns = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  const half = (list) => list.reduce((chain, p) => { while (chain.length > 1 && turns(chain[chain.length - 2], chain[chain.length - 1], p) <= 0) chain.pop(); return [...chain, p]; }, []).slice(0, -1);
  return sorted.length < 3 ? sorted : [...half(sorted), ...half(sorted.slice().reverse())];
}

const inHull = (hull, p) => hull.length > 2 && hull.every((a, k) => { const b = hull[(k + 1) % hull.length]; return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= 0; });
