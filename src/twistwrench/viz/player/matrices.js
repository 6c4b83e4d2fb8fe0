// Vectors and poses. Matrices 4x4 are arrays of 16, by rows; vectors are arrays.
"use strict";

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const add = (a, b) => a.map((x, k) => x + b[k]);
const times = (s, a) => a.map((x) => s * x);
function inner(a, b) { // of any length
  let sum = 0;
  for (let k = 0; k < a.length; k++) sum += a[k] * b[k];
  return sum;
}
const norm = (a) => Math.sqrt(dot(a, a));
const unit = (a) => times(1 / (norm(a) || 1), a);
const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

function mul(A, B) {
  const C = new Array(16).fill(0);
  for (let i = 0; i < 4; i++)
    for (let j = 0; j < 4; j++) for (let k = 0; k < 4; k++) C[4 * i + j] += A[4 * i + k] * B[4 * k + j];
  return C;
}
const turn = (T, a) => [0, 1, 2].map((i) => T[4 * i] * a[0] + T[4 * i + 1] * a[1] + T[4 * i + 2] * a[2]);
const place = (T) => [T[3], T[7], T[11]];
const pose = (R, p) => [R[0], R[1], R[2], p[0], R[3], R[4], R[5], p[1], R[6], R[7], R[8], p[2], 0, 0, 0, 1];
const shifted = (p) => [1, 0, 0, p[0], 0, 1, 0, p[1], 0, 0, 1, p[2], 0, 0, 0, 1];
const turnedBack = (T, a) => [0, 1, 2].map((j) => T[j] * a[0] + T[4 + j] * a[1] + T[8 + j] * a[2]); // R' a
const scaling = (s) => [s, 0, 0, 0, 0, s, 0, 0, 0, 0, s, 0, 0, 0, 0, 1];

function alongZ(a) { // a turn that takes z onto the direction of a
  const z = unit(a), x = unit(cross(Math.abs(z[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0], z)), y = cross(z, x);
  return pose([x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]], [0, 0, 0]);
}

// What takes the unit ball to the ellipsoid with semi-axes of these lengths along these unit vectors, by rows.
function ellipsoidOf(lengths, axes) {
  const [a, b, c] = axes, right = dot(cross(a, b), c) < 0 ? [a, b, times(-1, c)] : axes;
  return [0, 1, 2].flatMap((i) => right.map((axis, k) => axis[i] * lengths[k]));
}
