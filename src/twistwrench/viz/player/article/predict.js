// A guess before the picture is played: an arrow that is dragged, or a number. Then truth and guess stand side by side.
"use strict";

const RIGHT = { arrow: 8, number: 0.01 }; // degrees; of the truth
const CLOSE = 0.1; // of the truth

class Prediction {
  constructor(figure, entry) {
    Object.assign(this, { figure, entry, done: false });
    const { element, picture } = figure;
    this.ask = element.querySelector(".prompt");
    this.field = element.querySelector(".guess input");
    this.ask.hidden = false;
    figure.play.disabled = true;
    this.skip = element.querySelector(".skip");
    this.skip.hidden = false;
    this.skip.addEventListener("click", () => { this.ready(); figure.start(); });
    for (const event of ["input", "pointerup", "keyup"]) this.field?.addEventListener(event, () => {
      if (this.done) return;
      picture.guess = Number(this.field.value);
      element.querySelector(".guess output").textContent = `${decimal(picture.guess, entry.decimals ?? 1)} ${entry.unit}`;
      this.ready();
    });
    picture.listeners.push(() => this.date());
    this.rest = [...figure.section.querySelectorAll(":scope > .after, form")]; // what would tell
    this.rest.forEach((element) => { element.hidden = true; });
    if (entry.kind === "arrow") this.takesArrow(figure.views[0]);
  }

  ready() { this.figure.play.disabled = false; }

  // The head of the arrow follows the pointer, or Shift and the arrow keys, on a sphere.
  takesArrow(view) {
    const { picture } = this.figure, scale = () => picture.perUnit;
    const move = (dx, dy) => {
      const { right, up } = view.camera(), pixel = (0.62 * view.distance) / Math.min(view.canvas.clientHeight, view.canvas.clientWidth) / scale();
      const from = picture.guess ?? picture.grasped, to = add(from, add(times(pixel * dx, right), times(-pixel * dy, up)));
      picture.guess = times(norm(picture.grasped), unit(to));
      this.ready();
      picture.changed();
    };
    view.grasp = (x, y, reach) => {
      const head = view.onScreen(times(scale(), picture.guess ?? picture.grasped));
      if (this.done || Math.hypot(head[0] - x, head[1] - y) > Math.max(28, reach)) return null;
      move(0, 0);
      return move;
    };
    view.canvas.addEventListener("keydown", (event) => {
      const ways = { ArrowLeft: [-8, 0], ArrowRight: [8, 0], ArrowUp: [0, -8], ArrowDown: [0, 8] };
      if (this.done || !event.shiftKey || !(event.key in ways)) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      move(...ways[event.key]);
    }, { capture: true });
  }

  begin() { // from the start, with the sliders that are asked for
    const { picture } = this.figure;
    for (const [name, value] of Object.entries(this.entry.with ?? {})) picture.set(name, value);
    picture.rewind();
  }

  reveal() { // once the clock is there
    const { figure, entry } = this, { picture } = figure, { guess } = picture;
    if (this.done) return;
    this.done = true;
    this.skip.hidden = true;
    this.rest.forEach((element) => { element.hidden = false; });
    const arrow = entry.kind === "arrow", truth = arrow ? picture.truth(entry.at) : picture.truth();
    const off = guess === null ? null : arrow ? degreesOf(angleBetween(guess, truth)) : Math.abs(guess - truth) / Math.abs(truth);
    const value = arrow ? "" : `It is ${decimal(truth, entry.decimals === 0 ? 0 : 3)}${entry.unit ? ` ${entry.unit}` : ""}.`;
    const first = off === null ? "" : off <= RIGHT[entry.kind] ? "Right. " : !arrow && off <= CLOSE ? "Close. " : arrow ? `You are ${decimal(off, 0)}° off. ` : `You guessed ${decimal(guess, entry.decimals ?? 1)}. `;
    this.result = `${first}${value ? `${value} ` : ""}${entry.told}`;
    this.settings = this.sliders();
    this.ask.textContent = this.result;
    this.ask.classList.add("told");
  }

  sliders() { const { time, ...others } = this.figure.picture.values; return JSON.stringify(others); }

  date() { // a slider was moved: the guess was of what stood there before
    if (!this.done || !this.settings || this.sliders() === this.settings) return;
    this.settings = null;
    this.figure.picture.guess = null;
    this.ask.textContent = `Before you moved the slider: ${this.result}`;
    this.ask.classList.remove("told");
  }

  again() { // a new guess may be made
    if (this.figure.picture.guess === null && !this.done) return;
    this.figure.picture.guess = null;
    Object.assign(this, { done: false, settings: null });
    this.ask.textContent = this.entry.ask;
    this.ask.classList.remove("told");
  }
}
