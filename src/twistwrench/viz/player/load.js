// What is put on the robot by hand, payload and push, how fast its motion is, and the button that lets it go.
"use strict";

class LoadPanel {
  constructor(panel) {
    const { viewer } = panel, { robot, mechanics, motion } = viewer;
    Object.assign(this, { panel, viewer });
    this.kind = robot.book ? robot.book.load : "all"; // what may be put on it
    document.getElementById("load").hidden = !robot.torques.length || !this.kind;
    this.sliders = {};
    this.tips = this.menu(document.getElementById("tips"));
    if (motion) document.querySelector("aside").insertBefore(document.getElementById("load"), document.getElementById("torques"));
    if (robot.payload !== null) {
      const most = motion ? this.mostPayload() : robot.payload;
      this.slider("payload", robot.tips.length ? "payload at tip" : robot.payloadName, 0, most, "kg", () => mechanics.mass, (x) => { mechanics.mass = Math.max(0, x); });
      if (this.kind === "all") ["x", "y", "z"].forEach((axis, k) => this.slider(`push-${axis}`, `push on tip, ${axis}`, -robot.push, robot.push, "N", () => mechanics.push[k], (x) => { mechanics.push[k] = x; }));
    }
    if (motion) this.slider("pace", "motion speed", 0.25, 2, "×", () => motion.pace, (x) => { if (x > 0) motion.pace = x; });
    this.most = document.getElementById("most");
    this.button = document.getElementById("let-go");
    this.said = document.getElementById("fall");
    this.felt = document.getElementById("felt");
    document.querySelector("#load h2").textContent = this.kind !== "all" ? "Payload" : !motion ? "Payload, push, fall" : robot.payload === null ? "Speed" : "Payload, push, speed";
    this.button.hidden = robot.fall.why !== null || this.kind !== "all";
    this.said.textContent = this.kind === "all" ? robot.fall.why || "" : "";
    this.button.addEventListener("click", () => (viewer.fall ? viewer.stop() : viewer.letGo()));
  }

  mostPayload() { // twice what the limits allow; without limits as much as moves
    const { motion, robot, verdict } = this.viewer, allowed = verdict.margin ? 2 * verdict.margin.mass : robot.moving;
    return Number(Math.max(1, allowed, motion.data.mass).toPrecision(2)) * (1 + 1e-12);
  }

  slider(id, name, least, most, unit_, get, set) {
    const slider = document.createElement("input"), typed = document.createElement("input"), step = stepOf(most - least);
    Object.assign(slider, { type: "range", id, min: least, max: Math.ceil(most / step - 1e-6) * step, step });
    Object.assign(typed, { type: "text", id: `${id}-typed`, inputMode: "decimal", autocomplete: "off", className: "number" });
    slider.setAttribute("aria-label", `${name} [${unit_}]`);
    typed.setAttribute("aria-label", `${name} [${unit_}], typed`);
    const label = this.panel.cell("name", name.length > 18 ? name.replace(/ at .*/, "") : name);
    label.title = name;
    const slid = this.panel.cell("slid"), mark = slid.appendChild(document.createElement("i"));
    slid.prepend(slider);
    mark.hidden = true;
    this.panel.row("load", label, slid, typed);
    const tell = () => {
      slider.value = get();
      if (document.activeElement !== typed) typed.value = `${plain(get())} ${unit_}`;
    };
    slider.addEventListener("input", () => { set(Number(Number(slider.value).toPrecision(6))); tell(); this.viewer.loaded(); });
    slider.addEventListener("change", () => this.viewer.settled());
    typed.addEventListener("focus", () => typed.select());
    typed.addEventListener("keydown", (event) => { if (event.key === "Enter") typed.blur(); });
    typed.addEventListener("blur", () => tell());
    typed.addEventListener("change", () => {
      const value = parsed(typed.value);
      if (value !== null) set(value);
      typed.value = `${plain(get())} ${unit_}`;
      tell();
      this.viewer.loaded();
      this.viewer.settled();
    });
    tell();
    this.sliders[id] = { tell, set, slider, mark };
  }

  menu(place_) { // of tips, where there are several
    const { robot } = this.viewer, list = place_.querySelector("select");
    place_.hidden = !robot.tips.length;
    robot.tips.forEach(({ tip }, k) => list.appendChild(new Option(robot.frames[tip].name, k)));
    list.addEventListener("change", () => { this.viewer.chooseTip(Number(list.value)); this.viewer.settled(); });
    return list;
  }

  tell() {
    this.tips.value = this.viewer.robot.chosenTip;
    Object.values(this.sliders).forEach(({ tell }) => tell());
  }

  feel() { // beside the mass ellipsoid: how heavy the tip is
    const { viewer, felt: said } = this;
    said.hidden = viewer.robot.book !== null || !viewer.shown.mass || !viewer.weigh();
    if (said.hidden) return;
    const masses = viewer.weigh().map(({ mass }) => mass).filter((mass) => mass < Infinity), missing = viewer.robot.tipDirections - masses.length;
    const heavy = masses.map((mass) => `${mass < 1000 ? mass.toPrecision(3) : Math.round(mass)} kg`).join(", ");
    said.textContent = `Effective mass at the tip along its principal axes: ${heavy}${missing > 0 ? "; here it cannot be moved in every direction" : ""}.`;
  }

  mark() { // the largest payload that the torque limits allow, on its slider
    const { verdict, mechanics } = this.viewer, margin = verdict?.margin, { slider, mark } = this.sliders.payload ?? {};
    document.getElementById("try").hidden = !verdict?.lightens || !margin || mechanics.mass <= margin.mass;
    if (!slider) return;
    const share = margin ? margin.mass / Number(slider.max) : 2;
    mark.hidden = share > 1;
    mark.title = mark.hidden ? "" : `allowed: ${roundedDown(margin.mass)} kg`;
    mark.style.left = `calc(8px + ${share} * (100% - 16px))`; // the middle of the slider's knob is 8 px from its ends
  }

  update() {
    this.mark();
    const { viewer } = this, { fall, verdict, mechanics } = viewer, margin = verdict && !mechanics.mass && verdict.margin;
    this.feel();
    this.most.hidden = !margin;
    if (margin) this.most.textContent = `The joints' torque limits allow up to ${roundedDown(margin.mass)} kg on this motion.`;
    if (this.button.hidden) return;
    this.button.textContent = fall ? "Stop" : "Let go";
    this.tellFall();
    if (fall && !fall.rests && fall.pace < 0.95) this.said.textContent += ` · ${fall.pace.toFixed(1)} × real time`;
  }

  tellFall() {
    const { viewer } = this, { fall, robot, mechanics } = viewer;
    if (!fall) this.said.textContent = robot.book ? "With these torques and velocities, without friction and stops." : `From rest, ${viewer.shown.drives ? "held by drives within their limits" : "without torques"}${viewer.shown.stops ? "" : ", friction and stops"}; ${viewer.stand && viewer.holds ? "the feet stay where they are, and " : ""}the floor is solid. ${this.pedestal()}${viewer.shown.stops ? robot.fall.assumed : ""}`;
    else if (viewer.drives) {
      const slips = viewer.slipping.map(({ k, needs, limit }) => `${robot.torques[k].name} slips: needs ${number(Math.abs(needs), 3)}, has ${number(limit)} ${robot.torques[k].unit}`);
      this.said.textContent = `${fall.time.toFixed(2)} s, drives hold. ${slips.length ? `${slips.join("; ")}.` : "Every drive holds."}`;
    } else if (fall.resistance) { // to the floor as well
      const at = fall.resistance.at.flatMap((side, k) => (side ? [robot.torques[k].name.replace(/_joint$/, "")] : []));
      this.said.textContent = `${fall.rests ? "At rest after" : ""} ${(fall.time - (fall.rests ? fall.calm : 0)).toFixed(2)} s: ${fall.rests ? "" : `kinetic energy ${energy(fall.kinetic)}, `}lost to friction, stops and floor ${energy(fall.begin + fall.work - fall.kinetic - fall.potential)} J${at.length ? `; at its stop: ${at.join(", ")}` : ""}`;
    } else {
      const worked = fall.work ? ` − work of the ${robot.book ? "torques and push" : mechanics.any ? "wrenches" : "push"} ${energy(fall.work)}` : "", total = fall.kinetic + fall.potential - fall.work;
      this.said.textContent = `${fall.time.toFixed(2)} s: kinetic energy ${energy(fall.kinetic)} + potential ${energy(fall.potential)}${worked} = ${energy(total)} J${fall.lost ? ` + lost to the floor ${energy(fall.lost)} J` : ""}, kept to ${fall.drift.toExponential(0)} J`;
    }
  }

  pedestal() { // in words
    const { pedestal } = this.viewer.robot.fall;
    return pedestal ? `The arm stands on a pedestal of ${plain(pedestal)} m, as high as its reach needs. ` : "";
  }
}
const energy = (x) => signed(x, 3);
const plain = (x) => String(Number(x.toPrecision(6))).replace("-", "−");

function parsed(text) { // a number as it is typed, with a comma or a unit or none; null where there is none
  const found = /^\s*([-+−]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[-+]?\d+)?)/i.exec(text), x = found ? Number(found[1].replace("−", "-").replace(",", ".")) : NaN;
  return Number.isFinite(x) ? x : null;
}

function stepOf(range) { // a round number, some 200 to 500 of which make the range
  const power = 10 ** Math.floor(Math.log10(range / 400));
  return Number(([1, 2, 5, 10].find((factor) => factor * power >= range / 400) * power).toPrecision(1));
}
