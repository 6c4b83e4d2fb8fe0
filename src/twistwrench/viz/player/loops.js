// Closed loops, feet on the floor among them: where a slider moves, the other joints follow by Newton's method.
"use strict";

const CLOSED_GAP = 1e-12, LEAP = 0.25; // rad or m; how far joints may follow in one step of a slider, to stay on their branch

class Loops {
  constructor(mechanics) {
    Object.assign(this, { mechanics, run: mechanics.run, ...mechanics.robot.loops });
  }

  // By how much they are open: rows of positions of {b} in {c}, and of turns twice the sine of half the angle; rad and m.
  gaps(q) {
    const T = this.run.closing(q);
    return this.rows.flatMap((rows, n) => {
      const R = (i, j) => T[16 * n + 4 * i + j], turning = [0, 1, 2].filter((k) => rows.includes(k));
      const turn_ = [0.5 * (R(2, 1) - R(1, 2)), 0.5 * (R(0, 2) - R(2, 0)), 0.5 * (R(1, 0) - R(0, 1))];
      let cosine = 0.5 * (R(0, 0) + R(1, 1) + R(2, 2) - 1);
      const k = turning.length === 2 ? 3 - turning[0] - turning[1] : turning[0], i = (k + 1) % 3, j = (k + 2) % 3;
      if (turning.length === 2) [turn_[i], turn_[j], cosine] = [-R(j, k), R(i, k), R(k, k)];
      else if (turning.length === 1) cosine = 0.5 * (R(i, i) + R(j, j));
      const scale = Math.sqrt(2 / (1 + cosine + 1e-30));
      return rows.map((row) => (row < 3 ? scale * turn_[row] : R(row - 3, 3)));
    });
  }

  jacobian(q) { // A by rows, A dq = 0
    return byRows(this.run.closing_rows(q), this.mechanics.robot.torques.length);
  }

  moved(q, v) {
    const rates = this.run.rates(q, v);
    return normalised(this.mechanics.robot, q.map((x, k) => x + rates[k]));
  }

  // The closed pose near q that only the velocities `free` lead to, or null: steps of least norm, A_f' (A_f A_f')^-1 gap.
  closed(q, free) {
    const pick = free.flatMap((yes, k) => (yes ? [k] : []));
    for (let turn_ = 0; turn_ < 30; turn_++) {
      const gap = this.gaps(q), far = Math.max(...gap.map(Math.abs));
      if (!(far < 10)) return null;
      if (far < CLOSED_GAP) return q;
      const rows = this.jacobian(q), step = dampedStep(pick.map((k) => rows.map((row) => row[k])), gap, 1e-13);
      const v = new Float64Array(free.length);
      pick.forEach((k, j) => { v[k] = -step[j]; });
      q = this.moved(q, v);
    }
    return Math.max(...this.gaps(q).map(Math.abs)) < 1e-10 ? q : null;
  }

  // What follows where the coordinate of a slider is moved: what depends on the others; under a base that moves the legs; and
  // with a joint of a leg all legs and the base.
  following(velocities) {
    const { dependent, legs, base } = this;
    if (dependent) return dependent;
    if (velocities.some((k) => base[k])) return legs;
    return legs.map((leg, k) => (leg || base[k]) && !velocities.includes(k));
  }

  // From one closed pose to where `at(q, share)` has a slider at share 1, in steps; ends before where no closed pose is found.
  led(q, at, velocities) {
    const free = this.following(velocities);
    let share = 0, step = 1;
    while (share < 1 && step > 1e-3) {
      const next = Math.min(1, share + step), tried = at(q, next), found = this.closed(tried, free);
      if (found && found.every((x, k) => Math.abs(x - tried[k]) < LEAP)) [q, share, step] = [found, next, 2 * step];
      else step /= 2;
    }
    return { q, stopped: share < 1 };
  }

  // tau = g + A'x: zero at joints without a motor, else least; all zero where these motors cannot hold the pose.
  torques(q, holding) {
    const rows = this.jacobian(q), loose = [], held = [];
    this.actuated.forEach((yes, k) => (yes ? held : loose).push({ f: holding[k], a: rows.map((row) => row[k]), k }));
    const solve = (equations, basis) => { // the least y with a . (basis y) = -f, by singular values
      const x = new Array(rows.length).fill(0), A = equations.map(({ a }) => basis.map((b) => inner(a, b)));
      if (!A.length || !basis.length) return { x, A };
      const all = singular(A), floor = 1e-9 * Math.max(1e-9, ...all.map(({ value }) => value));
      for (const { value, left, right } of all) {
        if (value <= floor) continue;
        const y = -inner(left, equations.map(({ f }) => f)) / value;
        basis.forEach((b, j) => b.forEach((c, i) => { x[i] += y * right[j] * c; }));
      }
      return { x, A };
    };
    const unit_ = rows.map((_, i) => rows.map((__, j) => Number(i === j)));
    let { x } = solve(loose, unit_);
    const rest = nullSpace(loose.map(({ a }) => a), rows.length); // changes that no joint without a motor feels
    x = add(x, solve(held.map(({ f, a }) => ({ a, f: f + inner(a, x) })), rest).x);
    const tau = holding.map(() => 0), left = Math.max(0, ...loose.map(({ f, a }) => Math.abs(f + inner(a, x))));
    const holds = left <= 1e-7 * Math.max(1, ...holding.map(Math.abs));
    if (holds) held.forEach(({ f, a, k }) => { tau[k] = f + inner(a, x); });
    return { tau, holds };
  }
}

function orthonormal(rows) { // a basis of what they span, by Gram and Schmidt, twice
  const basis = [];
  for (const row of rows) {
    let rest = row.slice();
    for (let twice = 0; twice < 2; twice++) for (const b of basis) rest = add(rest, times(-inner(b, rest), b));
    const size = Math.sqrt(inner(rest, rest));
    if (size > 1e-9 * Math.sqrt(inner(row, row))) basis.push(times(1 / size, rest));
  }
  return basis;
}

function nullSpace(rows, n) { // a basis of what is at right angles to all rows
  const spanned = orthonormal(rows), units = Array.from({ length: n }, (_, i) => Array.from({ length: n }, (__, j) => Number(i === j)));
  return orthonormal([...spanned, ...units]).slice(spanned.length);
}

function normalised(robot, q) { // quaternions of length 1
  for (const body of robot.bodies)
    if ((body.kind === "floating" || body.kind === "ball") && !body.follows) {
      const size = Math.hypot(...q.slice(body.q, body.q + 4));
      for (let k = 0; k < 4; k++) q[body.q + k] /= size;
    }
  return q;
}
