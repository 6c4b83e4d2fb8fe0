// Coloured words and their arrows: pointing at one lights the other; after a tap it stays lit until the next one.
"use strict";

class Words {
  constructor(section, figures) {
    this.words = [...section.querySelectorAll(".word")];
    for (const word of this.words) {
      const light = (lit) => () => { for (const figure of figures()) figure.light(lit); };
      word.addEventListener("pointerenter", light(word.dataset.arrow));
      word.addEventListener("pointerleave", (event) => { if (event.pointerType !== "touch") light(null)(); });
    }
    document.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "touch" && !event.target.closest(".word")) for (const figure of figures()) figure.light(null);
    });
  }

  light(name) {
    for (const word of this.words) word.classList.toggle("lit", word.dataset.arrow === name);
  }
}
