// Surfaces that the page makes itself: balls, arrows and arcs, as {positions, normals, faces}.
"use strict";

// The normals of vertices, each the mean of its faces', by area. Sharp edges have their vertices twice.
function withNormals(positions, faces) {
  const normals = new Float32Array(positions.length);
  const at = (k) => [positions[3 * k], positions[3 * k + 1], positions[3 * k + 2]];
  for (let t = 0; t < faces.length; t += 3) {
    const a = at(faces[t]), n = cross(add(at(faces[t + 1]), times(-1, a)), add(at(faces[t + 2]), times(-1, a)));
    for (let k = 0; k < 3; k++) for (let i = 0; i < 3; i++) normals[3 * faces[t + k] + i] += n[i];
  }
  for (let k = 0; k < normals.length; k += 3) {
    const size = Math.hypot(normals[k], normals[k + 1], normals[k + 2]) || 1;
    for (let i = 0; i < 3; i++) normals[k + i] /= size;
  }
  return { positions, normals, faces };
}

// A tube around a curve: rings of points, each {middle, first, second, radius} with unit vectors across the curve.
function tube(rings, around = 14) {
  const positions = [], faces = [];
  for (const { middle, first, second, radius } of rings)
    for (let k = 0; k < around; k++) {
      const turned = (2 * Math.PI * k) / around;
      positions.push(...add(middle, add(times(radius * Math.cos(turned), first), times(radius * Math.sin(turned), second))));
    }
  for (let i = 0; i + 1 < rings.length; i++)
    for (let k = 0; k < around; k++) {
      const a = i * around + k, b = i * around + ((k + 1) % around);
      faces.push(a, b, b + around, a, b + around, a + around);
    }
  return withNormals(new Float32Array(positions), new Uint32Array(faces));
}

// Along z from the origin, of that length; a head of its own size, or all head where the arrow is short.
function arrow(length, thickness) {
  const head = Math.min(length, 4.5 * thickness), neck = length - head, wide = (head / 4.5) * 2.1;
  const ring = (z, radius) => ({ middle: [0, 0, z], first: [1, 0, 0], second: [0, 1, 0], radius });
  const shaft = Math.min(thickness, wide / 2);
  return tube([ring(0, 0), ring(0, shaft), ring(neck, shaft), ring(neck, shaft), ring(neck, wide), ring(neck, wide), ring(length, 0)]);
}

// Around z at radius 1, counterclockwise from the x axis, through an angle.
function arc(sweep, thickness) {
  const head = Math.min(sweep, 5 * thickness), neck = sweep - head, rings = [];
  const ring = (angle, radius) => {
    const out = [Math.cos(angle), Math.sin(angle), 0];
    rings.push({ middle: out, first: [0, 0, 1], second: out, radius });
  };
  const steps = Math.max(2, Math.ceil(neck / 0.12));
  ring(0, 0);
  for (let k = 0; k <= steps; k++) ring((neck * k) / steps, thickness);
  ring(neck, 2.3 * thickness);
  ring(neck, 2.3 * thickness);
  for (let k = 1; k <= 4; k++) ring(neck + (head * k) / 4, 2.3 * thickness * (1 - k / 4));
  return tube(rings);
}

// Around z at radius 1, closed.
function ring(thickness) {
  return tube(Array.from({ length: 49 }, (_, k) => {
    const out = [Math.cos((Math.PI * k) / 24), Math.sin((Math.PI * k) / 24), 0];
    return { middle: out, first: [0, 0, 1], second: out, radius: thickness };
  }));
}

function column() { // from 0 to 1 along z, of radius 1
  const ring_ = (z, radius) => ({ middle: [0, 0, z], first: [1, 0, 0], second: [0, 1, 0], radius });
  return tube([ring_(0, 1), ring_(1, 1), ring_(1, 1), ring_(1, 0)], 28);
}

function ball(rings = 18) {
  const found = [];
  for (let i = 0; i <= rings; i++) {
    const up = Math.PI * (i / rings - 0.5);
    found.push({ middle: [0, 0, Math.sin(up)], first: [1, 0, 0], second: [0, 1, 0], radius: Math.cos(up) });
  }
  return tube(found, 2 * rings);
}

// The facets of a polytope, each flat: corners repeated.
function solidOf(facets) {
  const positions = [], faces = [];
  for (const facet of facets) {
    const start = positions.length / 3;
    facet.forEach((x) => positions.push(...x));
    for (let k = 1; k + 1 < facet.length; k++) faces.push(start, start + k, start + k + 1);
  }
  return withNormals(new Float32Array(positions), new Uint32Array(faces));
}
