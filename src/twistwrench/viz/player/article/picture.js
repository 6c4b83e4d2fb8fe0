// A picture of an article: sliders, a clock, a state in numbers and a scene. Those of a section extend it.
"use strict";

class Picture {
  constructor(entry) {
    this.entry = entry;
    this.listeners = [];
    this.begin();
  }

  begin() { // initial sliders and time
    Object.assign(this, { t: this.entry.t ?? 0, values: {}, guess: null });
    for (const { name, value } of this.entry.sliders) this.values[name] = value;
    this.restart();
  }

  restart() {} // of what depends on the sliders
  changed() { this.listeners.forEach((listener) => listener()); }

  set(name, value) {
    const slider = this.entry.sliders.find((one) => one.name === name);
    if (!slider) throw new Error(`no slider ${name}; there are: ${this.entry.sliders.map((one) => one.name).join(", ")}`);
    this.take(name, Math.min(slider.most, Math.max(slider.least, Number(value))));
    this.changed();
  }

  take(name, value) {
    this.values[name] = value;
    if (name === "time") this.t = value;
    else this.restart();
  }

  value(name) { return name === "time" ? this.t : this.values[name]; }

  advance(seconds) {
    this.t = Math.min(this.t + seconds, Math.max(this.t, this.entry.end ?? Infinity));
    if ("time" in this.values) this.values.time = this.t;
    this.changed();
  }

  get ended() { return this.t >= (this.entry.end ?? Infinity) - 1e-9; }

  rewind() { // to the start, with the sliders as they are
    this.t = 0;
    if ("time" in this.values) this.values.time = 0;
    this.restart();
    this.changed();
  }

  reset() {
    this.begin();
    this.changed();
  }

  // The question of the picture: {answer, other}, from its state; null if it has none.
  question() { return null; }

  check(text) {
    const question = this.question();
    return question ? judged(text, question.answer, question.other) : { right: false, near: null, words: "This picture has no exercise." };
  }
}

const decimal = (x, decimals) => fixed(x, decimals).replace(/^-(0(?:\.0*)?)$/, "$1").replace("-", "−");
const vectorText = (a, decimals) => `(${a.map((x) => decimal(x, decimals)).join(", ")})`;
const degreesOf = (radians) => (180 / Math.PI) * radians;
const radiansOf = (degrees) => (Math.PI / 180) * degrees;
const angleBetween = (a, b) => Math.atan2(norm(cross(a, b)), dot(a, b));
