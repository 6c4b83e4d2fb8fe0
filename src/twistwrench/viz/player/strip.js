// The strip above the time bar: each joint's share of its limit over the motion, red where it is passed.
"use strict";

class Strip {
  constructor(viewer, canvas) {
    Object.assign(this, { viewer, canvas });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  draw() {
    const { viewer: { motion, robot, verdict }, canvas } = this, ratio = window.devicePixelRatio || 1, draw = canvas.getContext("2d");
    const [width, height] = [canvas.clientWidth, canvas.clientHeight], red = css(robot.colours.shares[robot.colours.shares.length - 1][1]);
    [canvas.width, canvas.height] = [width * ratio, height * ratio];
    draw.scale(ratio, ratio);
    const { time, tau, nv, limits, begin, end } = motion, most = motion.peaks.map(({ value }) => Math.abs(value));
    const scales = limits.map((limit, k) => (limit < Infinity ? limit : most[k] || 1));
    const top = Math.max(1.02, ...most.map((x, k) => (1.05 * x) / scales[k])), y = (share) => height - 1 - ((height - 3) * share) / top;
    const bins = Math.min(time.length, Math.max(1, 2 * Math.round(width))), x = (i) => (width * (time[i] - begin)) / (end - begin || 1);
    const first = (bin) => Math.floor((bin * time.length) / bins);
    const limited = limits.some((limit) => limit < Infinity);
    if (limited) {
      draw.strokeStyle = red;
      draw.setLineDash([4, 3]);
      draw.beginPath();
      draw.moveTo(0, y(1));
      draw.lineTo(width, y(1));
      draw.stroke();
      draw.setLineDash([]);
    }
    for (let k = 0; k < nv; k++) {
      const over = verdict.over.has(k), points = [];
      for (let bin = 0; bin < bins; bin++) { // of each bin its largest share
        let best = first(bin);
        for (let i = best; i < first(bin + 1); i++) if (Math.abs(tau[nv * i + k]) > Math.abs(tau[nv * best + k])) best = i;
        points.push([x(best), y(Math.abs(tau[nv * best + k]) / scales[k])]);
      }
      const { lines } = robot.colours, dashes = [[], [6, 2], [2, 2], [6, 2, 2, 2]][Math.floor(k / lines.length) % 4]; // as in plots
      const line = (colour, thick) => {
        draw.setLineDash(dashes);
        Object.assign(draw, { strokeStyle: colour, lineWidth: thick, globalAlpha: over ? 1 : 0.8 });
        draw.beginPath();
        points.forEach(([a, b]) => draw.lineTo(a, b));
        draw.stroke();
      };
      line(lines[k % lines.length], over ? 1.6 : 1);
      if (!over) continue;
      draw.save(); // beyond the limit it is red, down to the line
      draw.beginPath();
      draw.rect(0, 0, width, y(1));
      draw.clip();
      draw.beginPath();
      draw.moveTo(points[0][0], height);
      points.forEach(([a, b]) => draw.lineTo(a, b));
      draw.lineTo(points[points.length - 1][0], height);
      Object.assign(draw, { fillStyle: red, globalAlpha: 0.35 });
      draw.fill();
      line(red, 2.4);
      draw.restore();
    }
    draw.globalAlpha = 1;
  }
}
