// Answers that are wrong in a way that has a name.
"use strict";

const NEAR_MISSES = { // in the order in which they are named
  sign: { of: (answer) => [-answer], words: "That is minus the answer. Is the wrench the one on the body, or by the body?" },
  double: { of: (answer) => [2 * answer], words: "That is twice the answer. Does a factor ½ belong there, as in the energy?" },
  half: { of: (answer) => [answer / 2], words: "That is half of the answer. Does a factor ½ not belong there?" },
  frame: { of: (_, { frame = [] }) => frame, words: "That is its value in {s}, and {b} was asked." },
  degrees: { of: (_, { degrees = [] }) => degrees, words: "That takes degrees for radians, as in the sine of 5 rad for 5°." },
};

const ENDLESS = 1e9; // an answer from which on it is a division by zero

// A typed number is right to 1 % of the answer, or to half of the last of three decimal places.
const isRight = (typed, answer) => Math.abs(typed - answer) <= Math.max(0.01 * Math.abs(answer), 5e-4);

function typedNumber(text) { // with a comma or a point, the minus of print, and possibly a unit behind
  const [, plain] = text.trim().replace("−", "-").replace(",", ".").match(/^([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?:\s*(?![\d.,])\S.*)?$/) ?? [];
  return plain === undefined ? null : Number(plain);
}

// Judgement of a typed answer: {right, near, words}. other: lists of values by near-miss; kinds: those that are named.
function judged(text, answer, other = {}, kinds = Object.keys(NEAR_MISSES)) {
  const typed = typedNumber(text);
  if (typed === null) return { right: false, near: null, words: "Type a number." };
  if (!(Math.abs(answer) < ENDLESS)) return { right: false, near: null, words: "There is no finite answer here: move a joint or a slider." };
  if (isRight(typed, answer)) return { right: true, near: null, words: "Right." };
  const misses = (kind) => NEAR_MISSES[kind].of(answer, other).filter((value) => Math.abs(value) > 1e-9);
  const near = Object.keys(NEAR_MISSES).find((kind) => kinds.includes(kind) && misses(kind).some((value) => Math.abs(typed - value) <= 0.01 * Math.abs(value)));
  const named = (other.named ?? []).find(([value]) => Math.abs(typed - value) <= 0.01 * Math.abs(value)); // [value, words]: what it is
  return { right: false, near: near ?? null, words: named?.[1] ?? (near ? NEAR_MISSES[near].words : "Not yet.") };
}
