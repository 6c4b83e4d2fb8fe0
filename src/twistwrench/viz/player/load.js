// What is put on the robot by hand, payload and push, and the button that lets it go.
"use strict";

class LoadPanel {
  constructor(panel) {
    const { viewer } = panel, { robot, mechanics } = viewer;
    Object.assign(this, { panel, viewer });
    this.kind = robot.book ? robot.book.load : "all"; // what may be put on it
    document.getElementById("load").hidden = !robot.torques.length || !this.kind;
    this.sliders = [];
    if (robot.payload !== null) {
      this.slider(robot.payloadName, 0, robot.payload, "kg", (x) => { mechanics.mass = x; });
      if (this.kind === "all") ["x", "y", "z"].forEach((axis, k) => this.slider(`push on tip, ${axis}`, -robot.push, robot.push, "N", (x) => { mechanics.push[k] = x; }));
    }
    this.stored = document.getElementById("stored");
    this.rows = document.querySelector("#load ul");
    this.button = document.getElementById("let-go");
    this.said = document.getElementById("fall");
    this.felt = document.getElementById("felt");
    if (this.kind !== "all") document.querySelector("#load h2").textContent = "Payload";
    this.button.hidden = robot.fall.why !== null || this.kind !== "all";
    this.said.textContent = this.kind === "all" ? robot.fall.why || "" : "";
    this.button.addEventListener("click", () => (viewer.fall ? viewer.stop() : viewer.letGo()));
  }

  slider(name, least, most, unit_, set) {
    const slider = document.createElement("input"), step = (most - least) / 200;
    Object.assign(slider, { type: "range", id: `load-${this.sliders.length}`, min: least, max: most, step });
    slider.value = 0;
    slider.setAttribute("aria-label", `${name} [${unit_}]`);
    const [, , number] = this.panel.row("load", this.panel.cell("name", name), slider, this.panel.cell("number"));
    const digits = Math.max(0, 2 - Math.floor(Math.log10(most)));
    const tell = () => { number.textContent = `${signed(Number(slider.value), digits)} ${unit_}`; };
    slider.addEventListener("input", () => { set(Number(slider.value)); tell(); this.viewer.loaded(); });
    tell();
    this.sliders.push({ slider, clear: () => { slider.value = 0; set(0); tell(); } });
  }

  clear() { this.sliders.forEach(({ clear }) => clear()); } // stored torques do not contain what the sliders put on it

  feel() { // beside the mass ellipsoid: how heavy the tip is
    const { viewer, felt: said } = this;
    said.hidden = viewer.robot.book !== null || !viewer.shown.mass || !viewer.weigh();
    if (said.hidden) return;
    const masses = viewer.weigh().map(({ mass }) => mass).filter((mass) => mass < Infinity), missing = viewer.robot.tipDirections - masses.length;
    const heavy = masses.map((mass) => `${mass < 1000 ? mass.toPrecision(3) : Math.round(mass)} kg`).join(", ");
    said.textContent = `Effective mass at the tip along its principal axes: ${heavy}${missing > 0 ? "; here it cannot be moved in every direction" : ""}.`;
  }

  update() {
    const { fall, robot } = this.viewer;
    this.feel();
    const stored = this.sliders.length > 0 && Boolean(this.viewer.motion) && !this.viewer.posed;
    this.rows.hidden = stored;
    this.stored.hidden = !stored;
    if (this.button.hidden) return;
    this.button.textContent = fall ? "Stop" : "Let go";
    if (!fall) this.said.textContent = robot.book ? "With these torques and velocities, without friction and stops." : "From rest, without torques, friction and stops.";
    else {
      const worked = fall.work ? ` − work of the ${robot.book ? "torques and push" : this.viewer.mechanics.any ? "wrenches" : "push"} ${energy(fall.work)}` : "", total = fall.kinetic + fall.potential - fall.work;
      this.said.textContent = `${fall.time.toFixed(2)} s: kinetic energy ${energy(fall.kinetic)} + potential ${energy(fall.potential)}${worked} = ${energy(total)} J, kept to ${fall.drift.toExponential(0)} J`;
    }
  }
}
const energy = (x) => signed(x, 3);
