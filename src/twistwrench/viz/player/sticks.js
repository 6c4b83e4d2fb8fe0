// Drawing without WebGL: the robot as lines from joint to joint, and a ball at its tip.
"use strict";

class Sticks extends Orbit {
  constructor(canvas, size) {
    super(canvas, size);
    this.pen = canvas.getContext("2d");
    document.getElementById("undrawn").hidden = false;
  }

  keep() { return null; }
  forget() {}

  // sticks: pairs of points in the base frame; ends: points.
  draw(items, lines, floor, { sticks, ends }) {
    const { pen, canvas } = this, ratio = window.devicePixelRatio || 1, tone = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
    if (!pen) return;
    [canvas.width, canvas.height] = [canvas.clientWidth * ratio, canvas.clientHeight * ratio];
    pen.scale(ratio, ratio);
    Object.assign(pen, { lineWidth: 7, lineCap: "round", strokeStyle: tone("--stick"), fillStyle: tone("--stick-end") });
    for (const [a, b] of sticks) {
      pen.beginPath();
      pen.moveTo(...this.project(a));
      pen.lineTo(...this.project(b));
      pen.stroke();
    }
    for (const p of ends) {
      pen.beginPath();
      pen.arc(...this.project(p), 7, 0, 2 * Math.PI);
      pen.fill();
    }
  }
}

// What draws on the canvas: WebGL 2 where the browser has it.
function stageOn(canvas, size) {
  canvas.addEventListener("webglcontextlost", () => fail("The browser has taken the graphics away. Reload the page."));
  const gl = canvas.getContext("webgl2", { antialias: false, alpha: true, stencil: true });
  return gl ? new Stage(canvas, size, gl) : new Sticks(canvas, size);
}
