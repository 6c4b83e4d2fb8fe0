// Matrices as products: Cholesky's factor, and singular values.
"use strict";

// L of M = L L', by rows, for M symmetric and positive definite; above the diagonal nothing is meant.
function cholesky(M, n) {
  const L = Float64Array.from(M);
  for (let j = 0; j < n; j++)
    for (let i = j; i < n; i++) {
      let rest = L[n * i + j];
      for (let k = 0; k < j; k++) rest -= L[n * i + k] * L[n * j + k];
      L[n * i + j] = i === j ? Math.sqrt(rest) : rest / L[n * j + j];
    }
  return L;
}

function lowered(L, x) { // L^-1 x
  const n = x.length, y = Array.from(x);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < i; k++) y[i] -= L[n * i + k] * y[k];
    y[i] /= L[n * i + i];
  }
  return y;
}

function raised(L, x) { // L'^-1 x
  const n = x.length, y = Array.from(x);
  for (let i = n - 1; i >= 0; i--) {
    for (let k = i + 1; k < n; k++) y[i] -= L[n * k + i] * y[k];
    y[i] /= L[n * i + i];
  }
  return y;
}

// Singular values of a matrix given by its rows, largest first, {value, left, right} with unit vectors: rows are turned among
// themselves until all are at right angles, so that small values keep their digits. The
// first entry of left is positive. Hestenes, J. SIAM 6, 1958.
function singular(rows) {
  const R = rows.map((row) => Array.from(row)), U = rows.map((_, i) => rows.map((_, j) => Number(i === j)));
  for (let sweep = 0, turned = true; turned && sweep < 40; sweep++) {
    turned = false;
    for (let p = 0; p < R.length; p++)
      for (let r = p + 1; r < R.length; r++) {
        const a = inner(R[p], R[p]), b = inner(R[r], R[r]), c = inner(R[p], R[r]);
        if (Math.abs(c) <= 1e-15 * Math.sqrt(a * b)) continue;
        turned = true;
        const z = (b - a) / (2 * c), t = (z < 0 ? -1 : 1) / (Math.abs(z) + Math.hypot(1, z)), cos = 1 / Math.hypot(1, t), sin = cos * t;
        for (const W of [R, U]) [W[p], W[r]] = [add(times(cos, W[p]), times(-sin, W[r])), add(times(sin, W[p]), times(cos, W[r]))];
      }
  }
  const found = R.map((row, k) => {
    const value = Math.sqrt(inner(row, row)), sign = Math.sign(U[k].find((x) => Math.abs(x) > 1e-9));
    return { value, left: times(sign, U[k]), right: times(sign / (value || 1), row) };
  });
  return found.sort((x, y) => y.value - x.value);
}
