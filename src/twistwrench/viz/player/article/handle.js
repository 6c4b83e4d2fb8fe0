// A point of a picture, such as the head of an arrow, that is dragged on the way along which the slider takes it.
// A picture with handle(value), the point for a value of its slider, has one.
"use strict";

const REACH = 26; // pixels

class Handle {
  constructor({ picture }, view, slider) {
    Object.assign(this, { picture, view, slider });
    const { canvas } = view;
    view.handle = this;
    view.grasp = (x, y, reach) => {
      if (this.off([x, y]) > Math.max(REACH, reach)) return null;
      let pointer = [x, y];
      return (dx, dy) => this.follow(pointer = add(pointer, [dx, dy]));
    };
    canvas.addEventListener("pointermove", ({ clientX, clientY, buttons }) => {
      const box = canvas.getBoundingClientRect();
      if (!buttons) canvas.style.cursor = this.off([clientX - box.x, clientY - box.y]) < REACH ? "grab" : view.fixed ? "default" : "";
    });
    canvas.addEventListener("keydown", (event) => {
      if (!(event.shiftKey || view.fixed) || !event.key.startsWith("Arrow")) return;
      event.stopImmediatePropagation();
      slider.press(event);
    }, { capture: true });
    canvas.setAttribute("aria-label", `${canvas.getAttribute("aria-label")} Drag the ring, or use ${view.fixed ? "" : "Shift and "}the arrow keys, for the ${slider.label}.`);
    canvas.previousElementSibling.insertAdjacentHTML("beforeend", "<span>drag the ring</span>");
  }

  at(value = this.slider.value) { return this.picture.handle(value); }
  off(pointer, value) { return this.view.onScreen ? Math.hypot(...add(this.view.onScreen(this.at(value)), times(-1, pointer))) : Infinity; }
  ring() { return [{ kind: "handle", at: this.at(), name: this.slider.colour }]; }

  follow(pointer) { // the value whose point is nearest
    const { least, most, step } = this.slider, values = Array.from({ length: Math.round((most - least) / step) + 1 }, (_, k) => least + k * step);
    const far = values.map((value) => this.off(pointer, value));
    this.slider.set(values[far.indexOf(Math.min(...far))]);
  }
}
