// A planar arm with two links of 1 m in the plane x, y: where its joints are, and how it is drawn.
"use strict";

const LINK = 1, ORIGIN = [0, 0, 0];

function placesOf([a, b]) { // of joint 2 and tip, and from the one to the other
  const elbow = [LINK * Math.cos(a), LINK * Math.sin(a), 0], fore = [LINK * Math.cos(a + b), LINK * Math.sin(a + b), 0];
  return { elbow, fore, tip: add(elbow, fore) };
}

function armBody(angles) { // links and joints
  const { elbow, tip } = placesOf(angles), [a, b] = angles, link = (from, to, angle) => solid(boxFaces([LINK / 2, 0.045, 0.03]), turnAbout([0, 0, 1], angle), times(0.5, add(from, to)));
  return [link(ORIGIN, elbow, a), link(elbow, tip, a + b), ...[ORIGIN, elbow].map((p) => solid(cylinderFaces(0.09, 0.05), UPRIGHT, p))];
}

// Dashed line of a force through a point, and the levers from places to it.
function leversTo(places, point, way, [behind, ahead] = [2.6, 2.6]) {
  const foot = (p) => add(p, add(add(point, times(-1, p)), times(-dot(add(point, times(-1, p)), way), way)));
  const line = { kind: "line", name: "wrench", width: 1.5, dashed: true, label: "line of force", points: [add(point, times(-behind, way)), add(point, times(ahead, way))] };
  return [line, ...places.map((p) => ({ kind: "line", name: "change", width: 3, label: "lever", points: [p, foot(p)] }))];
}

const momentAbout = (p, at, f) => cross(add(at, times(-1, p)), f)[2]; // of a force in the plane
