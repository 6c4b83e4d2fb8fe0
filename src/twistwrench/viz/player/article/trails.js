// Things of scenes: boxes, cylinders, floors, arrows with the trail of their heads.
"use strict";

const TRAIL = 2, TRAIL_STEP = 0.02; // s
const UNITS = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

// The path of a head over the last two seconds, from a function of time.
const trail = (name, head, t, seconds = TRAIL, step = TRAIL_STEP) => {
  const first = Math.max(0, t - seconds), count = Math.max(1, Math.ceil((t - first) / step));
  return { kind: "trail", name, width: 2.5, points: Array.from({ length: count + 1 }, (_, k) => head(first + ((t - first) * k) / count)) };
};

const placed = (R, p, points) => points.map((point) => add(rotated(R, point), p));

// A convex solid about its middle, of flat faces, each a list of its corners in turn.
function solid(faces, R = UPRIGHT, p = [0, 0, 0], colour = undefined) {
  return {
    kind: "solid",
    faces: faces.map((corners) => {
      const at = placed(R, p, corners), middle = times(1 / at.length, at.reduce(add));
      const normal = unit(cross(add(at[1], times(-1, at[0])), add(at[2], times(-1, at[1]))));
      return { corners: at, normal: times(Math.sign(dot(normal, add(middle, times(-1, p)))), normal), middle, colour };
    }),
  };
}

function boxFaces(half) {
  const square = [[-1, -1], [1, -1], [1, 1], [-1, 1]];
  return [0, 1, 2].flatMap((i) => [-1, 1].map((side) => square.map(([a, b]) => {
    const corner = [0, 0, 0];
    [corner[i], corner[(i + 1) % 3], corner[(i + 2) % 3]] = [side * half[i], a * half[(i + 1) % 3], b * half[(i + 2) % 3]];
    return corner;
  })));
}

function cylinderFaces(radius, half, sides = 28) { // about z
  const ring = (z) => Array.from({ length: sides }, (_, k) => [radius * Math.cos((2 * Math.PI * k) / sides), radius * Math.sin((2 * Math.PI * k) / sides), z]);
  const [low, high] = [ring(-half), ring(half)];
  return [high, [...low].reverse(), ...low.map((p, k) => [p, low[(k + 1) % sides], high[(k + 1) % sides], high[k]])];
}

// A round floor with spokes and the axes of the room: it turns if the camera sits on a body.
function floor(z, radius = 1, named = true) {
  const rim = (r) => Array.from({ length: 49 }, (_, k) => [r * Math.cos((Math.PI * k) / 24), r * Math.sin((Math.PI * k) / 24), z]);
  const line = (points) => ({ kind: "floor", points, name: "floor", width: 1 });
  const spokes = [0, 1, 2, 3].map((k) => [0.25 * Math.PI * k, radius]).map(([angle, r]) => line([[-r * Math.cos(angle), -r * Math.sin(angle), z], [r * Math.cos(angle), r * Math.sin(angle), z]]));
  return [line(rim(radius)), line(rim(0.66 * radius)), line(rim(0.33 * radius)), ...spokes, ...(named ? UNITS.map((way, k) => arrowOf("axes", [0, 0, z], times(0.33 * radius, way), "xyz"[k], { width: 2 })) : [])];
}

// A flat grid for pictures seen from above.
function grid(half, square, z = -0.05) {
  const count = Math.round(half / square), at = Array.from({ length: 2 * count + 1 }, (_, k) => (k - count) * square);
  return at.flatMap((x) => [[[x, -half, z], [x, half, z]], [[-half, x, z], [half, x, z]]]).map((points) => ({ kind: "floor", points, name: "floor", width: 1 }));
}

const arrowOf = (name, from, way, label, more = {}) => ({ kind: "arrow", name, from, to: add(from, way), label, ...more });

// Arc of a turn or a moment about z, from the x axis; nothing where it is zero.
const turnArc = (middle, sweep, name, label, radius = 0.2) => (Math.abs(sweep) > 1e-6 ? [{ kind: "arc", middle, radius, sweep, name, label }] : []);

// Axes of a frame in the plane, with its letter.
const axes = (R, p, length, label, towards = [-1, -1]) => [
  ...UNITS.slice(0, 2).map((axis) => arrowOf("axes", p, times(length, rotated(R, axis)), "", { width: 2 })),
  { kind: "dot", at: p, name: "axes", label, towards },
];
