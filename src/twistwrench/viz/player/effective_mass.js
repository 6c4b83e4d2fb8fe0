// How heavy the tip is, from the mass matrix and the Jacobian of its origin, a column (3) for each velocity. MR section 8.1.3.
"use strict";

// A = J M^-1 J', by rows: the acceleration of the tip for a force on it, at rest [1/kg]. Lambda = A^-1.
function mobility(M, columns) { // M = L L', X = L^-1 J', A = X' X
  const n = columns.length, L = Float64Array.from(M), X = columns.map((c) => c.slice()), A = new Array(9).fill(0);
  for (let j = 0; j < n; j++)
    for (let i = j; i < n; i++) {
      let rest = L[n * i + j];
      for (let k = 0; k < j; k++) rest -= L[n * i + k] * L[n * j + k];
      L[n * i + j] = i === j ? Math.sqrt(rest) : rest / L[n * j + j];
    }
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < i; k++) X[i] = add(X[i], times(-L[n * i + k], X[k]));
    X[i] = times(1 / L[n * i + i], X[i]);
    for (let k = 0; k < 9; k++) A[k] += X[i][Math.floor(k / 3)] * X[i][k % 3];
  }
  return A;
}

// Eigenvalues of a symmetric matrix, largest first, and unit eigenvectors: Jacobi's rotations.
function principal(matrix) {
  const A = [0, 1, 2].map((i) => matrix.slice(3 * i, 3 * i + 3)), V = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  for (let sweep = 0; sweep < 12; sweep++)
    for (const [p, r] of [[0, 1], [0, 2], [1, 2]]) {
      if (A[p][r] === 0) continue;
      const phi = 0.5 * Math.atan2(2 * A[p][r], A[r][r] - A[p][p]), c = Math.cos(phi), s = Math.sin(phi);
      for (const row of [...A, ...V]) [row[p], row[r]] = [c * row[p] - s * row[r], s * row[p] + c * row[r]];
      [A[p], A[r]] = [add(times(c, A[p]), times(-s, A[r])), add(times(s, A[p]), times(c, A[r]))];
    }
  const found = [0, 1, 2].map((k) => ({ value: A[k][k], axis: [V[0][k], V[1][k], V[2][k]] }));
  return found.sort((a, b) => b.value - a.value);
}

// Masses that the tip has along its principal axes, lightest first: {mass, axis}; Infinity where it cannot be moved.
function effectiveMasses(M, columns) {
  const found = principal(mobility(M, columns)), least = 1e-9 * found[0].value;
  return found.map(({ value, axis }) => ({ mass: value > least ? 1 / value : Infinity, axis }));
}

// Forces that accelerate the tip by 1 m/s^2, from rest and without gravity: what takes the unit ball to them, by rows, with
// axes no longer than the longest; null where it can be moved in fewer directions than elsewhere.
function massEllipsoid(masses, directions, scale, longest) {
  if (masses.filter(({ mass }) => mass < Infinity).length < directions) return null;
  const r = masses.map(({ mass }) => (mass < Infinity ? Math.min(scale * mass, longest) : 0.01 * longest)), axes = masses.map(({ axis }) => axis);
  if (dot(cross(axes[0], axes[1]), axes[2]) < 0) axes[2] = times(-1, axes[2]);
  return [0, 1, 2].flatMap((i) => axes.map((axis, k) => axis[i] * r[k]));
}
