// A number within a sentence: dragged sideways, moved by arrow keys, or typed.
"use strict";

const PIXELS = 160; // from the least to the most

class InlineSlider {
  constructor(element, { name, label, colour, unit, least, most, step, decimals }, picture) {
    Object.assign(this, { element, name, label, colour, unit, least, most, step, decimals, picture });
    const attributes = { role: "slider", tabindex: "0", "aria-label": label, "aria-valuemin": least, "aria-valuemax": most, title: "Drag sideways, use arrow keys, or press Enter and type" };
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    element.addEventListener("pointerdown", (event) => this.grasp(event));
    element.addEventListener("keydown", (event) => this.press(event));
    element.addEventListener("dblclick", () => this.type());
    picture.listeners.push(() => this.show());
    this.show();
  }

  get value() { return this.picture.value(this.name); }
  set(value) { this.picture.set(this.name, Number((this.step * Math.round(value / this.step)).toFixed(6))); }

  show() {
    const text = `${decimal(this.value, this.decimals)}${this.unit === "°" || !this.unit ? "" : "\u202f"}${this.unit}`;
    if (this.typing || this.element.textContent === text) return;
    this.element.textContent = text;
    this.element.style.setProperty("--share", (this.value - this.least) / (this.most - this.least));
    this.element.setAttribute("aria-valuenow", this.value);
    this.element.setAttribute("aria-valuetext", text);
  }

  grasp(event) {
    if (this.typing) return;
    const { element } = this, from = event.clientX, start = this.value;
    element.setPointerCapture(event.pointerId);
    const move = ({ clientX }) => this.set(start + ((clientX - from) / PIXELS) * (this.most - this.least));
    const end = () => { element.removeEventListener("pointermove", move); element.classList.remove("held"); };
    element.classList.add("held");
    element.addEventListener("pointermove", move);
    element.addEventListener("pointerup", end, { once: true });
    element.addEventListener("pointercancel", end, { once: true });
  }

  press(event) {
    if (this.typing || event.ctrlKey || event.metaKey || event.altKey) return;
    const { step } = this, ways = { ArrowRight: step, ArrowUp: step, ArrowLeft: -step, ArrowDown: -step, PageUp: 5 * step, PageDown: -5 * step };
    if (event.key in ways) this.set(this.value + ways[event.key]);
    else if (event.key === "Home" || event.key === "End") this.set(event.key === "Home" ? this.least : this.most);
    else if (event.key === "Enter" || /^[-0-9]$/.test(event.key)) this.type(event.key === "Enter" ? "" : event.key);
    else return;
    event.preventDefault();
  }

  type(begun = "") {
    const field = Object.assign(document.createElement("input"), { type: "text", inputMode: "decimal", size: 5, value: begun || String(this.value) });
    field.setAttribute("aria-label", this.element.getAttribute("aria-label"));
    this.typing = true;
    this.element.replaceChildren(field);
    field.focus();
    if (!begun) field.select();
    const end = (taken) => {
      if (!this.typing) return;
      this.typing = false;
      const typed = typedNumber(field.value);
      if (taken && typed !== null) this.picture.set(this.name, typed);
      this.element.textContent = "";
      this.show();
      this.element.focus();
    };
    field.addEventListener("keydown", (event) => {
      event.stopPropagation();
      if (event.key === "Enter" || event.key === "Escape") { event.preventDefault(); end(event.key === "Enter"); }
    });
    field.addEventListener("blur", () => end(true));
  }
}
