// When a picture is drawn, and how finely: only where something has changed; more coarsely while it moves on a machine that
// cannot keep up with its screen, and finely again once it rests.
"use strict";

const SLOW = 1000 / 48; // ms from frame to frame, in the mean
const REST = 150; // ms without a change
const FINENESS = [ // finest first: most pixels for one of the page's, samples of a pixel, whether shadows are drawn
  { most: 2, samples: 4, shadows: true },
  { most: 1, samples: 0, shadows: true },
  { most: 0.75, samples: 0, shadows: false },
  { most: 0.5, samples: 0, shadows: false },
];
const JUDGED = 10; // frames

class Sharpness {
  constructor() { Object.assign(this, { coarse: 0, drawn: 0, gaps: [], last: -Infinity, changed: NaN, signs: "" }); }

  // True while a frame may still be drawn anew though nothing more changes.
  waits(now) { return this.drawn > 0 || now === this.changed; }

  // What to draw with at a time [ms], or null. Signs tell all that is seen: others are a change.
  at(now, signs) {
    const gap = now - this.last, moved = signs !== this.signs, moving = moved && this.last === this.changed;
    Object.assign(this, { signs, last: now });
    if (!moved) {
      if (!this.drawn || now - this.changed < REST) return null;
      this.drawn = 0;
      return FINENESS[0];
    }
    this.changed = now;
    this.gaps = moving ? [...this.gaps, gap] : [];
    if (this.gaps.length === JUDGED) {
      if (this.gaps.reduce((a, b) => a + b) > SLOW * JUDGED) this.coarse = Math.min(this.coarse + 1, FINENESS.length - 1);
      this.gaps = [];
    }
    this.drawn = this.coarse;
    return FINENESS[this.drawn];
  }
}
