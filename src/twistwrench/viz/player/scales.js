// What arrows and ellipsoids are drawn to: so much of a quantity for a square of the floor, a round number.
"use strict";

const squareOf = (size) => 10 ** Math.floor(Math.log10(size / 4)); // side of the floor's squares [m]

function nearRound(x) { // the nearest of 1, 2 and 5 times a power of ten
  const power = 10 ** Math.floor(Math.log10(x)), [factor] = [[1, 2 ** 0.5], [2, 10 ** 0.5], [5, 50 ** 0.5], [10, 10]].find(([, end]) => x / power <= end);
  return Number((factor * power).toPrecision(1));
}

// Of what a square stands for, where `most` is to be about `length` long [m].
const perSquare = (most, length, size) => nearRound((most * squareOf(size)) / length);

function saidScales(size, scales) { // of pairs [amount of a square, unit]
  const said = [...new Set(scales.map(([amount, unit_]) => `${amount} ${unit_}`))];
  return said.length ? `a square of the floor, ${squareOf(size)} m, is ${said.join(", ")}` : "";
}

const rgb = (hex) => [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
