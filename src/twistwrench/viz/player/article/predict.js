// A guess before the picture is played: an arrow that is dragged, a number, or a choice. Then truth and guess stand side by side.
"use strict";

const RIGHT = { arrow: 8, number: 0.01 }; // degrees; of the truth
const CLOSE = 0.1; // of the truth
const MOVED = "Before you moved the slider: ", NEXT = "Now press ";

class Prediction {
  constructor(figure, entry) {
    Object.assign(this, { figure, entry, done: false });
    const { element, picture } = figure;
    this.prompt = element.querySelector(".prompt");
    this.ask = this.prompt.firstChild;
    this.prompt.hidden = false;
    Object.assign(this.prompt.dataset, { ask: `${entry.ask} ${NEXT}Compare.`, longest: `${MOVED}${this.told(0.001, 0.01, 180, entry.free ? 2 : 1)}` }); // the place that either takes
    figure.play.disabled = true;
    this.output = element.querySelector(".guess output");
    this.empty();
    this.skip = element.querySelector(".skip");
    this.skip.hidden = false;
    this.skip.addEventListener("click", () => { this.ready(); figure.start(); });
    this.fields = [...element.querySelectorAll(".guess input")];
    for (const field of this.fields) for (const event of ["input", "pointerup", "keyup"]) field.addEventListener(event, () => {
      if (this.done || (field.type === "radio" && !field.checked)) return;
      picture.guess = Number(field.value);
      if (this.output) this.output.textContent = `${this.number(picture.guess)} ${entry.unit}`;
      this.ready();
    });
    picture.listeners.push(() => this.date());
    this.rest = [...figure.section.querySelectorAll(":scope > .after, form")]; // what would tell
    this.rest.forEach((element) => element.classList.add("later")); // its place is kept
    if (entry.kind === "arrow") this.takesArrow(figure.views[0]);
  }

  ready() { // a guess is made
    this.figure.play.disabled = false;
    if (!this.done) this.ask.textContent = `${this.entry.ask} ${NEXT}${this.figure.play.textContent}.`;
  }

  empty() { if (this.output) this.output.textContent = `? ${this.entry.unit}`; }
  number(guess) { return decimal(guess, this.entry.decimals ?? 1); }

  // What is told of a guess, or null, in degrees (with the length of the truth for one of the guess), numbers or places among the choices.
  told(guess, truth, degrees = 180, longer = 1) {
    const { kind, unit, choices, decimals, told } = this.entry, off = kind === "arrow" ? degrees : Math.abs(guess - truth) / Math.abs(truth);
    const size = Math.abs(longer - 1) > CLOSE ? `${longer > 1 ? "Longer" : "Shorter"} than you drew it: ${decimal(longer, 2)} times. ` : "";
    if (size && off <= RIGHT.arrow) return `The direction is right. ${size}${told}`;
    const guessed = { arrow: () => `You are ${decimal(off, 0)}° off. ${size}`, number: () => `You guessed ${this.number(guess)}. `, choice: () => `You chose ${choices[guess - 1] ?? choices[0]}. ` }[kind];
    const first = guess === null ? "" : off <= (RIGHT[kind] ?? 0) ? "Right. " : kind === "number" && off <= CLOSE ? "Close. " : guessed();
    const value = { arrow: () => "", number: () => `It is ${decimal(truth, decimals === 0 ? 0 : 3)}${unit ? ` ${unit}` : ""}. `, choice: () => `It is ${choices[truth - 1] ?? choices[0]}. ` }[kind];
    return `${first}${value()}${told}`;
  }

  // The head of the arrow follows the pointer, or Shift and the arrow keys: on a sphere, or freely if its length is asked as well.
  takesArrow(view) {
    const { picture } = this.figure, scale = () => picture.perUnit;
    const move = (dx, dy) => {
      const from = picture.guess ?? picture.grasped, { right, up } = view.camera(), pixel = 1 / (view.metre(times(scale(), from)) * scale());
      const to = add(from, add(times(pixel * dx, right), times(-pixel * dy, up)));
      picture.guess = this.entry.free ? to : times(norm(picture.grasped), unit(to));
      this.ready();
      picture.changed();
    };
    view.grasp = (x, y, reach) => {
      if (!view.onScreen) this.figure.draw(); // pressed before the first frame
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
    this.skip.classList.add("spent");
    this.rest.forEach((element) => element.classList.remove("later"));
    const arrow = entry.kind === "arrow", truth = arrow ? picture.truth(entry.at) : picture.truth();
    this.result = arrow && guess ? this.told(guess, truth, degreesOf(angleBetween(guess, truth)), entry.free ? norm(truth) / norm(guess) : 1) : this.told(guess, truth);
    this.settings = this.sliders();
    this.ask.textContent = this.result;
    this.prompt.classList.add("told");
  }

  sliders() { const { time, ...others } = this.figure.picture.values; return JSON.stringify(others); }

  date() { // a slider was moved: the guess was of what stood there before
    if (!this.done || !this.settings || this.sliders() === this.settings) return;
    this.settings = null;
    this.figure.picture.guess = null;
    this.ask.textContent = `${MOVED}${this.result}`;
    this.prompt.classList.remove("told");
  }

  again() { // a new guess may be made
    if (this.figure.picture.guess === null && !this.done) return;
    this.figure.picture.guess = null;
    Object.assign(this, { done: false, settings: null });
    this.ask.textContent = this.entry.ask;
    this.prompt.classList.remove("told");
    this.fields.forEach((field) => { field.checked = false; });
    this.empty();
    this.figure.play.disabled = true;
    this.skip.classList.remove("spent");
  }
}
