// The image: one canvas, or two with a divider between them. Of several received images, only the latest is shown.

import {$} from "./dom.js";

export class Screen {
  /** `onShow` is called with the header of each frame once it is displayed. */
  constructor(onShow) {
    this.onShow = onShow;
    this.left = $("left"); this.right = $("right"); this.divider = $("divider");
    this.cut = 0.5; // position of the divider relative to the width
    this.latest = {}; // by kind: an image that waits for decoding
    this.decoding = {};
    this.split = ""; this.referenceSamples = 0;
    this.header = null;
    this.divider.addEventListener("pointerdown", e => { this.divider.setPointerCapture(e.pointerId); e.stopPropagation(); });
    this.divider.addEventListener("pointermove", e => {
      if (!this.divider.hasPointerCapture(e.pointerId)) return;
      const box = $("view").getBoundingClientRect();
      this.moveDivider((e.clientX - box.left) / box.width);
    });
    this.divider.addEventListener("keydown", e => {
      const step = {ArrowLeft: -0.02, ArrowRight: 0.02}[e.key];
      if (step) { this.moveDivider(this.cut + step); e.stopPropagation(); e.preventDefault(); }
    });
  }

  moveDivider(cut) {
    this.cut = Math.min(1, Math.max(0, cut));
    this.divider.style.left = `${100 * this.cut}%`;
    this.right.style.clipPath = `inset(0 0 0 ${100 * this.cut}%)`;
    this.divider.setAttribute("aria-valuenow", Math.round(100 * this.cut));
  }

  /** Set what is shown right of the divider, if anything, and the reference's samples per pixel; update the labels. */
  setSplit(split, referenceSamples) {
    this.split = split; this.referenceSamples = referenceSamples;
    const [model, other] = this.header?.models ?? [];
    const available = split === "reference" ? referenceSamples > 0 : split !== "" && other === split;
    this.right.hidden = !available;
    this.divider.hidden = $("label-left").hidden = $("label-right").hidden = split === "";
    $("label-left").textContent = model ?? "";
    $("label-right").textContent = split !== "reference" ? available ? split : `${split}, rendering …`
      : available ? `reference, ${referenceSamples} samples per pixel` : "reference, tracing …";
    this.moveDivider(this.cut);
  }

  /** Decode and show an image, unless a newer one of its kind arrives first. */
  async show(header, blobs) {
    const kind = header.kind;
    this.latest[kind] = [header, blobs];
    if (this.decoding[kind]) return;
    this.decoding[kind] = true;
    while (this.latest[kind]) {
      const [latest, files] = this.latest[kind];
      this.latest[kind] = null;
      const images = await Promise.all(files.map(blob => createImageBitmap(blob)));
      if (kind === "reference") {
        if (this.split === "reference") draw(this.right, images[0]);
      } else {
        draw(this.left, images[0]);
        if (images[1]) draw(this.right, images[1]);
        this.header = latest;
        this.setSplit(this.split, this.referenceSamples);
        this.onShow(latest);
      }
      images.forEach(image => image.close());
    }
    this.decoding[kind] = false;
  }
}

function draw(canvas, image) {
  if (canvas.width !== image.width || canvas.height !== image.height) {
    canvas.width = image.width; canvas.height = image.height;
  }
  canvas.getContext("2d").drawImage(image, 0, 0);
}
