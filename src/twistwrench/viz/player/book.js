// A page of a section of Modern Robotics: its words and formulas, sliders for what it needs, and its readout.
"use strict";

class Book {
  constructor(viewer) {
    const { robot } = viewer, { book } = robot;
    Object.assign(this, { viewer, book, state: {}, readout: READOUTS[book.number], sliders: {} });
    document.querySelector("main").classList.add("book");
    const place_ = document.getElementById("book");
    place_.hidden = false;
    document.querySelector("h1").textContent = `${book.number} ${book.title}`;
    this.link(robot.neighbours);
    document.getElementById("subtitle").textContent = `${robot.name}, squares of ${squareOf(robot.size)} m`;
    place_.querySelector(".opening").innerHTML = book.picture; // drawing and words of ours
    place_.querySelector("p").innerHTML = book.idea;
    for (const [formula, number] of book.formulas) {
      const row = place_.querySelector("ul").appendChild(document.createElement("li"));
      row.innerHTML = `<span class="formula">${formula}</span><span class="share">${number}</span>`;
    }
    this.choose();
    this.tabs();
    this.exercises = new Exercises(this);
  }

  link(neighbours) { // to other pages of the site
    const place_ = document.getElementById("neighbours"), entries = Object.entries(neighbours);
    place_.hidden = !entries.length;
    place_.append(...entries.map(([textContent, href]) => Object.assign(document.createElement("a"), { textContent, href })));
  }

  choose() { // a joint or a link from a list
    const { book, viewer } = this, label = document.getElementById("chosen");
    label.hidden = !book.chooses;
    if (!book.chooses) return;
    const names = book.chooses === "joint" ? viewer.robot.torques.map(({ name }) => name) : book.links.map(({ name }) => name);
    const list = label.querySelector("select");
    label.querySelector("span").textContent = book.chooses === "joint" ? "Joint" : "Link";
    names.forEach((name, k) => list.appendChild(new Option(`${k + 1}  ${name}`, k)));
    this.state.chosen = list.value = book.chooses === "joint" ? 0 : Math.min(3, names.length - 1);
    list.addEventListener("change", () => { this.state.chosen = Number(list.value); viewer.refresh(); });
  }

  tabs() { // one set of sliders at a time: positions first
    const section = document.getElementById("joints"), [head, first] = [section.querySelector("h2"), section.querySelector("ul")];
    const { inputs } = this.book, lists = [first], buttons = [];
    if (!inputs.length) return;
    head.innerHTML = "";
    const show = (at) => lists.forEach((list, k) => {
      list.hidden = k !== at;
      buttons[k].setAttribute("aria-pressed", k === at);
      if (k === at) meaning.textContent = buttons[k].title;
    });
    const tab = (letter, title) => {
      const button = head.appendChild(document.createElement("button")), k = buttons.length;
      Object.assign(button, { innerHTML: letter, title, id: `tab-${k}` });
      button.addEventListener("click", () => show(k));
      buttons.push(button);
    };
    tab("θ", "positions of the joints");
    for (const input of inputs) {
      tab(input.letter, input.meaning);
      lists.push(this.list(section, input));
    }
    const meaning = head.appendChild(document.createElement("span"));
    show(0);
  }

  list(section, { key, rows }) {
    const list = section.appendChild(document.createElement("ul")), { panel, robot } = this.viewer;
    const numbered = rows.length === robot.torques.length && !["wrench", "motor"].includes(key);
    this.state[key] = rows.map(({ start }) => start);
    this.sliders[key] = rows.map(({ name, unit: unit_, least, most }, k) => {
      const slider = document.createElement("input"), row = list.appendChild(document.createElement("li")), number = panel.cell("number");
      Object.assign(slider, { type: "range", id: `${key}-${k}`, min: least ?? -most, max: most, step: "any" });
      slider.setAttribute("aria-label", `${name} [${unit_}]`);
      slider.addEventListener("input", () => { this.state[key][k] = Number(slider.value); this.viewer.set(key); });
      slider.addEventListener("dblclick", () => { this.state[key][k] = least ?? 0; this.viewer.set(key); });
      row.append(panel.cell("name", `${numbered ? `${k + 1} ` : ""}${name.replace(/_joint$/, "")}`), slider, number);
      const digits = Math.max(0, 2 - Math.floor(Math.log10(most)));
      return { slider, tell: (x) => { slider.value = x; number.textContent = `${signed(x, digits)} ${unit_}`; } };
    });
    return list;
  }

  update() { // everything at the pose there is
    const { viewer, state } = this;
    this.exercises.clear();
    this.found = this.readout(viewer.mechanics, { ...state, q: viewer.q });
    for (const [key, rows] of Object.entries(this.sliders)) rows.forEach(({ tell }, k) => tell(state[key][k]));
    const words = this.found.tables.map(({ caption, rows }) => `${caption} ${rows.length}`).join();
    if (words !== this.words) {
      this.words = words;
      this.tables = this.found.tables.map((table) => new NumberTable(table));
      this.below = document.createElement("div");
      document.getElementById("values").replaceChildren(...this.tables.map(({ place: at }) => at), this.below);
    }
    this.tables.forEach((table, k) => table.show(this.found.tables[k].rows));
    this.explain();
    return this.found.tau || viewer.robot.torques.map(() => 0);
  }

  get velocities() { return this.found.dq || this.state.dq; } // where a wall is, those along it

  explain() { this.below?.replaceChildren(...(this.found.values || []).map(valueOf), this.legend()); }

  legend() { // arrows and solids by colour, a row each, which stays where its arrow is zero
    const list = document.createElement("p"), longest = new Map();
    list.className = "legend";
    for (const each of [...(this.found.solids || []), ...this.drawnArrows()]) if (!(each.length <= longest.get(each.name)?.length)) longest.set(each.name, each);
    for (const { name, colour, along, cut, length } of longest.values()) {
      const chip = list.appendChild(document.createElement("span"));
      chip.appendChild(document.createElement("i")).style.background = this.hue(colour);
      chip.append(`${name}${cut ? " (cut off)" : along && norm(along) < 1e-9 ? " (zero)" : length < 0.01 ? " (too small to be seen)" : ""}`);
    }
    for (const [key, words] of Object.entries(ELLIPSOIDS)) if (this.viewer.shown[key]) list.appendChild(document.createElement("span")).textContent = words;
    if (this.found.tables.some(({ heat }) => heat)) list.appendChild(document.createElement("span")).textContent = "shaded numbers: orange positive, blue negative, deeper if larger";
    const scales = saidScales(this.viewer.robot.size, this.scales());
    if (scales) list.appendChild(document.createElement("span")).textContent = scales;
    if (this.found.frames) list.appendChild(document.createElement("span")).textContent = "axes of frames: x red, y green, z blue";
    return list;
  }

  scales() { // of what is drawn
    const { robot, shown } = this.viewer, arrows = this.drawnArrows().map(({ per, unit: unit_ }) => [per, unit_]);
    const solids = (this.found.solids || []).filter(({ scale }) => scale).map(({ scale }) => scale);
    if (!shown.mass || !robot.massScale) return [...arrows, ...solids];
    const long = this.viewer.weigh().some(({ mass }) => mass < Infinity && mass * robot.massScale > 0.3 * robot.size);
    return [...arrows, ...solids, [nearRound(squareOf(robot.size) / robot.massScale), long ? "kg (longest axis cut off)" : "kg"]];
  }

  drawnArrows() { // with their lengths as shares of the robot's size, in steps
    const { size } = this.viewer.robot;
    return this.found.arrows.map((arrow_) => {
      const per = perSquare(arrow_.most, 0.3 * size, size), length = ((norm(arrow_.along) / per) * squareOf(size)) / size;
      return { ...arrow_, per, length: Math.round(200 * Math.min(0.6, length)) / 200, cut: length > 0.6 };
    });
  }

  get centre() { // of mass of the link that the page is about, in {s}; null on other pages
    const { book, viewer, state } = this;
    if (book.chooses !== "link") return null;
    const { inertia: G } = book.links[state.chosen], T = viewer.poses[state.chosen], m = G[35]; // of m [c]
    return m > 0 ? add(place(T), turn(T, [-G[11] / m, G[5] / m, -G[4] / m])) : null;
  }

  label() { // the letters of the frames, beside their origins, of the chosen link's centre of mass, and of the tip's ball
    const place_ = document.getElementById("labels"), { viewer } = this, { tip, can } = viewer.grasp, centre = viewer.shown.com && this.centre, frames = [...(this.found.frames || [])];
    if (centre) frames.push(["c", shifted(centre)]);
    if (can && frames.every(([, T]) => norm(add(place(T), times(-1, tip))) > 1e-3 * viewer.robot.size)) frames.push(["tip", shifted(tip)]);
    while (place_.children.length > frames.length) place_.lastChild.remove();
    while (place_.children.length < frames.length) place_.appendChild(document.createElement("span"));
    frames.forEach(([name, T], k) => {
      const [x, y] = viewer.stage.project(place(T));
      Object.assign(place_.children[k], { textContent: name });
      place_.children[k].style.transform = `translate(${x + (name === "c" ? 26 : 14)}px, ${y + 4}px)`;
    });
  }

  hue(colour) { // of a line by its number, or of a quantity as in articles
    const { lines } = this.viewer.robot.colours, dark = this.viewer.dark.matches;
    if (typeof colour === "number") return lines[colour % lines.length];
    if (this.hues?.dark !== dark) this.hues = { dark };
    return (this.hues[colour] ??= getComputedStyle(document.body).getPropertyValue(`--${colour}`).trim());
  }

  marks(items) {
    const { viewer, found } = this, { robot } = viewer, axis = viewer.cached("long axis", () => arrow(1, 0.03));
    for (const [, T] of found.frames || [])
      robot.colours.axes.forEach((colour, k) => items.push({ kept: axis, model: mul(T, mul(AXES[k], scaling(0.14 * robot.size))), colour: [...colour, 1] }));
    this.label();
    for (const { p, shape, colour } of found.solids || [])
      items.push({ kept: viewer.ball, model: pose(shape, p), colour: [...rgb(this.hue(colour)), 0.3], closed: true });
    for (const { p, along, length, colour } of this.drawnArrows()) {
      if (length < 0.01) continue;
      const T = mul(shifted(p), mul(alongZ(along), scaling(robot.size)));
      items.push({ kept: viewer.cached(`push ${length}`, () => arrow(length, 0.011)), model: T, colour: [...rgb(this.hue(colour)), 1], over: true });
    }
  }
}

function shownNumber(x, digits) {
  if (x === null) return "";
  if (Math.abs(x) < 0.5 * 10 ** -digits) return "0"; // as a zero that is exact
  return Math.abs(x) < 1e5 ? signed(x, digits) : x === Infinity ? "∞" : x.toExponential(1).replaceAll("-", "−");
}

const digitsOf = (most, least = 3) => Math.min(least, Math.max(0, 2 - Math.floor(Math.log10(most))));

const FINEST = 5; // decimal places of small numbers
const ELLIPSOIDS = { // by switch
  inertia: "blue ellipsoids: uniform, with the mass and the moments of inertia of each link",
  ellipsoid: "ellipsoid of forces: what the tip can exert along each direction, if the torques together are as large as their limits",
  polytope: "polytope of forces: what the tip can exert within the limit of every torque",
  mass: "green ellipsoid: effective mass of the tip along each direction",
};

// A table whose numbers may change, its words not.
class NumberTable {
  constructor({ caption, columns, rows, heat }) {
    const table = document.createElement("table"), head = table.createTHead().insertRow(), body = table.createTBody();
    const add_ = (row, kind, text = "") => Object.assign(row.appendChild(document.createElement(kind)), { innerHTML: text });
    this.heat = heat;
    this.place = document.createElement("div");
    add_(this.place, "p", caption).className = "caption";
    const scroll = this.place.appendChild(document.createElement("div")); // wide numbers scroll, whatever the font
    scroll.className = heat ? "scroll heat" : "scroll";
    scroll.appendChild(table);
    if (heat) this.tell(table, rows, columns);
    add_(head, "th");
    columns.forEach(([name, unit_]) => add_(head, "th", `${name}${unit_ ? `<small>${unit_}</small>` : ""}`));
    this.cells = rows.map(([name, xs]) => {
      const row = body.insertRow();
      add_(row, "th", name);
      return xs.map(() => add_(row, "td"));
    });
  }

  tell(table, rows, columns) { // on a narrow screen, cells are colours, and the number of the touched one stands below
    const touched = Object.assign(this.place.appendChild(document.createElement("p")), { className: "touched", innerHTML: "Touch a cell to read its number." });
    let cell_ = null, name = "";
    this.read = () => { if (cell_) touched.innerHTML = `${name}: <b>${cell_.textContent}</b>`; };
    table.addEventListener("click", ({ target }) => {
      const i = this.cells.findIndex((row) => row.includes(target));
      if (i < 0) return;
      cell_ = target;
      name = `row ${rows[i][0]}, column ${columns[this.cells[i].indexOf(target)][0]}`;
      this.read();
    });
  }

  show(rows) { // three places of the largest number of a column; of the whole table, and one more, where it is coloured
    const largest = rows[0][1].map((_, k) => Math.max(1e-5, ...rows.map(([, xs]) => Math.abs(xs[k])).filter((x) => x < 1e5)));
    const most = Math.max(1e-3, ...largest), same = this.heat ? digitsOf(most / 10) : null, recolour = this.heat && most !== this.most;
    this.most = most;
    rows.forEach(([, xs], i) => xs.forEach((x, k) => {
      const cell = this.cells[i][k], title = x === null ? "" : String(x);
      if (!recolour && cell.title === title && cell.digits === (same ?? digitsOf(largest[k], FINEST))) return;
      cell.digits = same ?? digitsOf(largest[k], FINEST);
      cell.title = title;
      cell.textContent = shownNumber(x, cell.digits);
      if (this.heat) cell.style.background = `rgba(${x > 0 ? "230, 120, 0" : "0, 110, 190"}, ${(0.5 * Math.min(1, Math.abs(x) / most)).toFixed(3)})`;
    }));
    this.read?.();
  }
}

function valueOf([name, x, unit_]) {
  const line = document.createElement("p");
  const small = Math.abs(x) < 1e-9 && x, shown = x === Infinity ? "∞" : small ? x.toExponential(0).replaceAll("-", "−") : Number.isInteger(x) && !unit_ ? x : signed(x, 4);
  line.innerHTML = `${name}: <b>${shown} ${unit_}</b>`;
  return line;
}
