// Coloured words and their arrows: pointing at one lights the other.
"use strict";

class Words {
  constructor(section, figures) {
    this.words = [...section.querySelectorAll(".word")];
    for (const word of this.words) {
      const light = (lit) => () => { for (const figure of figures()) figure.light(lit); };
      word.addEventListener("pointerenter", light(word.dataset.arrow));
      word.addEventListener("pointerleave", light(null));
    }
  }

  light(name) {
    for (const word of this.words) word.classList.toggle("lit", word.dataset.arrow === name);
  }
}
