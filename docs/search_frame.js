// Search of a site that is opened as files: browsers start no worker there, so the worker's script runs in a hidden frame.
"use strict";

if (location.protocol === "file:")
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      window.addEventListener("message", ({ source, data }) => {
        if (source === frame.contentWindow) this.dispatchEvent(new MessageEvent("message", { data }));
      });
      this.loaded = new Promise((done) => frame.addEventListener("load", () => done(frame.contentWindow)));
      const load = (src) => new Promise((done, failed) => {
        document.body.appendChild(Object.assign(document.createElement("script"), { src, onload: done, onerror: failed }));
      });
      frame.srcdoc = `<body><script>
        postMessage = (data) => parent.postMessage(data, "*");
        const load = ${load};
        importScripts = (...urls) => urls.reduce((before, url) => before.then(() => load(url)), Promise.resolve());
      </` + `script><script src="${url}"></` + "script></body>";
    }

    postMessage(data) { this.loaded.then((frame) => window.postMessage.call(frame, data, "*")); } // the frame has its own, for the worker

    terminate() {}
  };
