// An article: its pictures, which are drawn only where they are seen and only if something has changed.
"use strict";

const COLOUR_NAMES = ["twist", "momentum", "wrench", "change", "line", "floor", "edge", "axes", "paper"];
const FROM_ABOVE = 1.5; // rad, elevation of a camera that looks down on a plane
const LONGEST_FRAME = 0.1; // s, of a clock that was not looked at

function coloursOf(element) { // of the style sheet, dark or light
  const style = getComputedStyle(element), named = (name) => style.getPropertyValue(`--${name}`).trim();
  return { ...Object.fromEntries(COLOUR_NAMES.map((name) => [name, named(name)])), solid: named("solid").split(",").map(Number), opacity: Number(named("opacity")) };
}

class Figure {
  constructor(article, entry) {
    Object.assign(this, { article, entry, seen: false, stale: true, running: false, lit: null });
    this.element = document.querySelector(`figure[data-picture="${entry.name}"]`);
    this.section = this.element.closest("section");
    this.picture = new PICTURES[entry.name](entry);
    const part = (name) => this.element.querySelector(`.${name}`);
    [this.play, this.again, this.numbers] = ["play", "again", "numbers"].map(part);
    this.views = [...this.element.querySelectorAll("canvas")].map((canvas) => this.view(canvas));
    this.sliders = [...this.section.querySelectorAll(".slider")].map((element) => new InlineSlider(element, entry.sliders.find(({ name }) => name === element.dataset.slider), this.picture));
    this.words = new Words(this.section, () => [this]);
    this.prediction = entry.predict ? new Prediction(this, entry.predict) : null;
    if (this.picture.handle) new Handle(this, this.views[0], this.sliders[0]);
    this.play.addEventListener("click", () => (this.running ? this.stop() : this.start()));
    this.again.addEventListener("click", () => { this.stop(); this.picture.rewind(); this.prediction?.again(); this.say(); });
    this.picture.listeners.push(() => this.refresh());
    this.exercise();
    this.say();
    this.list(); // which takes its place before it is seen
  }

  view(canvas) {
    const [azimuth, elevation] = this.entry.camera ?? [-0.9, 0.35], view = new View(canvas, this.entry.size, { azimuth, elevation });
    view.target = this.entry.target ?? view.target;
    view.fixed = elevation > FROM_ABOVE;
    if (view.fixed) canvas.style.cursor = "default";
    this.fit(view);
    for (const event of ["pointermove", "pointerdown", "wheel", "keydown", "dblclick"]) canvas.addEventListener(event, () => this.refresh(), { passive: true });
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) {
        const { azimuth, elevation: height, distance } = view;
        this.views.forEach((other) => Object.assign(other, { azimuth, elevation: height, distance })); // both cameras turn
        return;
      }
      const box = canvas.getBoundingClientRect(), name = view.arrowAt(event.clientX - box.x, event.clientY - box.y);
      this.words.light(name);
    });
    canvas.addEventListener("pointerleave", () => this.words.light(null));
    const hint = canvas.parentElement.querySelector(".hint");
    view.hint = () => {
      hint.hidden = false;
      clearTimeout(view.hinted);
      view.hinted = setTimeout(() => { hint.hidden = true; }, 1500);
    };
    return view;
  }

  fit(view) { // far enough that the width of the scene is seen on a narrow screen, too
    const { canvas, home } = view, aspect = canvas.clientWidth / Math.max(1, canvas.clientHeight), untouched = view.distance === home.distance;
    home.distance = Math.max(2.05 * this.entry.size, (this.entry.width ?? 0) / (2 * Math.tan(0.3) * Math.max(1, aspect)));
    if (untouched) view.distance = home.distance;
  }

  light(name) { this.lit = name; this.refresh(); }
  refresh() { this.stale = true; this.article.request(); }

  start() {
    if (this.prediction && !this.prediction.done) this.prediction.begin();
    else if (this.picture.ended) this.picture.rewind();
    this.running = true;
    this.last = null;
    this.say();
    this.refresh();
  }

  stop() { this.running = false; this.say(); }
  say() {
    const still = !this.entry.end; // nothing moves: only a guess is compared
    this.play.hidden = still && (!this.prediction || this.prediction.done);
    this.again.hidden = still && !this.prediction?.done;
    this.play.textContent = still ? "Compare" : this.running ? "Pause" : this.prediction?.done && !this.picture.ended ? "Play on" : "Play";
  }

  tick(now) { // a step of the clock
    const { picture, prediction, entry } = this, speed = entry.speed ?? 1, passed = this.last === null ? 0 : Math.min(LONGEST_FRAME, (now - this.last) / 1000);
    this.last = now;
    const asked = prediction && !prediction.done ? entry.predict.at : Infinity;
    picture.advance(Math.min(passed * speed, Math.max(0, asked - picture.t)));
    if (picture.t >= asked - 1e-9) { prediction.reveal(); this.stop(); }
    if (picture.ended) this.stop();
  }

  draw() {
    this.stale = false;
    const { hides: hidden = [], keeps = [] } = this.asked;
    this.list();
    this.views.forEach((view) => {
      const from = view.canvas.dataset.view;
      const things = this.picture.scene(from).filter(({ name, label }) => !hidden.includes(name) || keeps.includes(label));
      things.push(...(view.handle?.ring() ?? []));
      view.draw(things, this.article.colours, from === "body" ? this.picture.frame() : UPRIGHT, this.lit);
    });
  }

  get asked() { return this.prediction && !this.prediction.done ? this.entry.predict : {}; } // of a guess that is not made yet

  list() {
    const { hides: hidden = [] } = this.asked;
    this.numbers.innerHTML = this.picture.numbers().filter(([, , , name]) => !hidden.includes(name)).map(([label, value, unit_, name]) => `<span class="${name}"><i>${label}</i> ${value}${unit_ ? ` ${unit_}` : ""}</span>`).join("");
  }

  exercise() {
    const form = this.section.querySelector("form");
    form?.addEventListener("submit", (event) => {
      event.preventDefault();
      const { right, words } = this.picture.check(form.querySelector("input").value), result = form.querySelector("output");
      result.textContent = words;
      result.className = right ? "right" : "wrong";
    });
  }
}

class Article {
  constructor({ section, pictures }) {
    this.asked = false;
    this.figures = pictures.map((entry) => new Figure(this, entry));
    this.paint();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paint());
    addEventListener("resize", () => this.figures.forEach((figure) => { figure.views.forEach((view) => figure.fit(view)); figure.refresh(); }));
    const observer = new IntersectionObserver((entries) => entries.forEach(({ target, isIntersecting }) => {
      const figure = this.figures.find(({ element }) => element === target);
      Object.assign(figure, { seen: isIntersecting, last: null });
      this.request();
    }));
    this.figures.forEach(({ element }) => observer.observe(element));
    window.viewer = { article: section, pictures: Object.fromEntries(this.figures.map(({ entry, picture }) => [entry.name, picture])) };
    document.querySelector("main").classList.remove("waiting");
  }

  paint() {
    this.colours = coloursOf(document.body);
    this.figures.forEach((figure) => figure.refresh());
  }

  request() {
    if (this.asked || !this.figures.some(({ seen, stale, running }) => seen && (stale || running))) return;
    this.asked = true;
    requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.asked = false;
    for (const figure of this.figures.filter(({ seen }) => seen)) {
      if (figure.running) figure.tick(now);
      if (figure.stale) figure.draw();
    }
    this.request();
  }
}

new Article(JSON.parse(document.getElementById("data").textContent));
