// What the tip can press with: from its Jacobian, a column (3) for each velocity, in the base's axes.
"use strict";

// What takes the unit sphere to the forces whose torques, as shares of their limits, have norm 1; null at singular poses.
function forceEllipsoid(robot, columns) { // f' A f = 1 with A = J W^-2 J' = L L', so f = L'^-1 u. MR section 5.4
  const A = new Array(9).fill(0);
  columns.forEach((c, k) => {
    const limit = robot.torques[k].limit;
    if (limit) for (let i = 0; i < 9; i++) A[i] += (c[Math.floor(i / 3)] * c[i % 3]) / limit ** 2;
  });
  const least = 1e-9 * (A[0] + A[4] + A[8]), a = A[0], b = A[3] / Math.sqrt(a), c = A[6] / Math.sqrt(a);
  const d2 = A[4] - b * b, d = Math.sqrt(d2), e = (A[7] - b * c) / d, f2 = A[8] - c * c - e * e;
  if (!(a > least && d2 > least && f2 > least)) return null;
  const l = Math.sqrt(a), f = Math.sqrt(f2);
  return [1 / l, -b / (l * d), (b * e - c * d) / (l * d * f), 0, 1 / d, -e / (d * f), 0, 0, 1 / f];
}

// Every force at the tip, without moment, that keeps torques within their limits at rest: corners, and the facets' corners
// in order; null where it has no end or no inside. MR section 5.2; tau = g + J' f.
function forcePolytope(robot, columns, holding) {
  const sides = [];
  columns.forEach((c, k) => {
    const limit = robot.torques[k].limit, size = norm(c);
    if (!limit || size < 1e-9) return;
    sides.push({ n: times(1 / size, c), b: (limit - holding[k]) / size });
    sides.push({ n: times(-1 / size, c), b: (limit + holding[k]) / size });
  });
  if (sides.length < 6 || sides.length > 48) return null;
  const corners = [];
  for (let i = 0; i < sides.length; i++)
    for (let j = i + 1; j < sides.length; j++)
      for (let k = j + 1; k < sides.length; k++) {
        const [A, B, C] = [sides[i], sides[j], sides[k]], BC = cross(B.n, C.n), det = dot(A.n, BC);
        if (Math.abs(det) < 1e-7) continue;
        const x = times(1 / det, add(times(A.b, BC), add(times(B.b, cross(C.n, A.n)), times(C.b, cross(A.n, B.n)))));
        const slack = 1e-7 * (1 + norm(x));
        if (sides.every((s) => dot(s.n, x) <= s.b + slack) && !corners.some((y) => norm(add(x, times(-1, y))) < 10 * slack))
          corners.push(x);
      }
  if (corners.length < 4) return null;
  const facets = [];
  for (const { n, b } of sides) {
    const on = corners.filter((x) => Math.abs(dot(n, x) - b) < 1e-5 * (1 + Math.abs(b)));
    if (on.length < 3) continue;
    const middle = times(1 / on.length, on.reduce(add)), first = unit(add(on[0], times(-1, middle))), second = cross(n, first);
    const angle = (x) => Math.atan2(dot(add(x, times(-1, middle)), second), dot(add(x, times(-1, middle)), first));
    facets.push(on.sort((x, y) => angle(x) - angle(y)));
  }
  return { corners, facets };
}

