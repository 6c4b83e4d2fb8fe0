// One rigid body about its mass centre, 𝒢 𝒱̇ = ad(𝒱)ᵀ 𝒢 𝒱 + ℱ (8.40), and its attitude R in the room, 3×3 by rows.
// Twists and wrenches have the angular part first.
"use strict";

const STEP = 1e-3; // s
const SIX = [0, 0, 0, 0, 0, 0], UPRIGHT = [1, 0, 0, 0, 1, 0, 0, 0, 1];
const angular = (V) => V.slice(0, 3), linear = (V) => V.slice(3);

// ad(𝒱)ᵀ 𝒫, the rate at which a momentum that stands still in the room changes as seen on the body.
function changeByTurning(V, P) {
  const [w, v, m, f] = [angular(V), linear(V), angular(P), linear(P)];
  return [...times(-1, add(cross(w, m), cross(v, f))), ...times(-1, cross(w, f))];
}

const bracket = (V, W) => [...cross(angular(V), angular(W)), ...add(cross(linear(V), angular(W)), cross(angular(V), linear(W)))]; // ad(𝒱) 𝒲

const rotated = (R, a) => [0, 1, 2].map((i) => R[3 * i] * a[0] + R[3 * i + 1] * a[1] + R[3 * i + 2] * a[2]);
const rotatedBack = (R, a) => [0, 1, 2].map((j) => R[j] * a[0] + R[3 + j] * a[1] + R[6 + j] * a[2]);
const inRoom = (R, P) => [...rotated(R, angular(P)), ...rotated(R, linear(P))];

function productOf(A, B) { // 3×3
  return [0, 1, 2].flatMap((i) => [0, 1, 2].map((j) => A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j]));
}

// Turn about a unit axis.
function turnAbout([x, y, z], angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)], k = 1 - c;
  return [c + k * x * x, k * x * y - s * z, k * x * z + s * y, k * x * y + s * z, c + k * y * y, k * y * z - s * x, k * x * z - s * y, k * y * z + s * x, c + k * z * z];
}

function orthonormal(R) { // from the first two columns, as R is nearly a rotation
  const x = unit([R[0], R[3], R[6]]), y0 = [R[1], R[4], R[7]], y = unit(add(y0, times(-dot(x, y0), x))), z = cross(x, y);
  return [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]];
}

class RigidBody {
  constructor(moments, mass) { this.inertia = [...moments, mass, mass, mass]; } // about principal axes at the mass centre

  momentum(V) { return V.map((x, k) => this.inertia[k] * x); }

  // Rates of x, the nine of R by rows and the six of 𝒱: Ṙ = R [ω], and 𝒱̇ by components, as it is evaluated 4000 times a second.
  rate(x, F, rate) {
    const G = this.inertia, [a, b, c, u, v, w] = [x[9], x[10], x[11], x[12], x[13], x[14]];
    for (let i = 0; i < 9; i += 3) {
      rate[i] = x[i + 1] * c - x[i + 2] * b;
      rate[i + 1] = x[i + 2] * a - x[i] * c;
      rate[i + 2] = x[i] * b - x[i + 1] * a;
    }
    rate[9] = ((G[1] - G[2]) * b * c + (G[4] - G[5]) * v * w + F[0]) / G[0];
    rate[10] = ((G[2] - G[0]) * c * a + (G[5] - G[3]) * w * u + F[1]) / G[1];
    rate[11] = ((G[0] - G[1]) * a * b + (G[3] - G[4]) * u * v + F[2]) / G[2];
    rate[12] = (c * G[4] * v - b * G[5] * w + F[3]) / G[3];
    rate[13] = (a * G[5] * w - c * G[3] * u + F[4]) / G[4];
    rate[14] = (b * G[3] * u - a * G[4] * v + F[5]) / G[5];
    return rate;
  }

  step({ R, V }, F, h) { // Runge–Kutta of order 4
    const x = Float64Array.of(...R, ...V), between_ = new Float64Array(15), sum = new Float64Array(15), k = new Float64Array(15);
    for (const [along, weight] of [[0, 1], [h / 2, 2], [h / 2, 2], [h, 1]]) {
      for (let i = 0; i < 15; i++) between_[i] = x[i] + along * k[i];
      this.rate(between_, F, k);
      for (let i = 0; i < 15; i++) sum[i] += (weight * h * k[i]) / 6;
    }
    const after = Array.from(x, (value, i) => value + sum[i]);
    return { R: orthonormal(after), V: after.slice(9) };
  }
}

// Motion from a state under a wrench that is constant on the body; computed as far as it is asked for.
class Flight {
  constructor(body, state, F = SIX) { Object.assign(this, { body, F, states: [state] }); }

  at(t) {
    const k = Math.floor(t / STEP + 1e-9), rest = t - k * STEP;
    while (this.states.length <= k) this.states.push(this.body.step(this.states[this.states.length - 1], this.F, STEP));
    return rest > 1e-12 ? this.body.step(this.states[k], this.F, rest) : this.states[k];
  }
}
