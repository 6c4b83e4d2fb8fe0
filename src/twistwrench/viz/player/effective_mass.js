// How heavy the tip is, from the mass matrix and the Jacobian of its origin, a column (3) for each velocity. MR section 8.1.3.
"use strict";

// Masses that the tip has along its principal axes, lightest first: {mass, axis}; Infinity where it cannot be moved. They are
// the eigenvalues of Lambda = (J M^-1 J')^-1: with M = L L', J M^-1 J' = X' X and X = L^-1 J'.
function effectiveMasses(M, columns) {
  const L = cholesky(M, columns.length), found = singular([0, 1, 2].map((i) => lowered(L, columns.map((c) => c[i]))));
  const least = 3e-5 * found[0].value;
  return found.map(({ value, left: axis }) => ({ mass: value > least ? 1 / value ** 2 : Infinity, axis }));
}

// Forces that accelerate the tip by 1 m/s^2, from rest and without gravity: what takes the unit ball to them, by rows, with
// axes no longer than the longest; null where it can be moved in fewer directions than elsewhere.
function massEllipsoid(masses, directions, scale, longest) {
  if (masses.filter(({ mass }) => mass < Infinity).length < directions) return null;
  return ellipsoidOf(masses.map(({ mass }) => (mass < Infinity ? Math.min(scale * mass, longest) : 0.01 * longest)), masses.map(({ axis }) => axis));
}
