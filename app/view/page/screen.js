// The picture: one canvas, or two with a slider between them. The newest frame wins.

const $ = id => document.getElementById(id);

export class Screen {
  /** `shown` is called with the header of each frame when it is on the screen. */
  constructor(shown) {
    this.shown = shown;
    this.left = $("left"); this.right = $("right"); this.divider = $("divider");
    this.cut = 0.5;
    this.newest = {};
    this.busy = {};
    this.split = ""; this.reference = 0;
    this.header = null;
    this.divider.addEventListener("pointerdown", e => { this.divider.setPointerCapture(e.pointerId); e.stopPropagation(); });
    this.divider.addEventListener("pointermove", e => {
      if (!this.divider.hasPointerCapture(e.pointerId)) return;
      const box = $("view").getBoundingClientRect();
      this.slide((e.clientX - box.left) / box.width);
    });
    this.divider.addEventListener("keydown", e => {
      const step = {ArrowLeft: -0.02, ArrowRight: 0.02}[e.key];
      if (step) { this.slide(this.cut + step); e.stopPropagation(); e.preventDefault(); }
    });
  }

  /** Put the slider at a share of the width. */
  slide(cut) {
    this.cut = Math.min(1, Math.max(0, cut));
    this.divider.style.left = `${100 * this.cut}%`;
    this.right.style.clipPath = `inset(0 0 0 ${100 * this.cut}%)`;
    this.divider.setAttribute("aria-valuenow", Math.round(100 * this.cut));
  }

  /** What is wanted right of the slider, if anything, and how many samples the reference has; labels tell what is shown. */
  sides(split, reference) {
    this.split = split; this.reference = reference;
    const [model, other] = this.header?.models ?? [], there = split === "reference" ? reference > 0 : split !== "" && other === split;
    this.right.hidden = !there;
    this.divider.hidden = $("label-left").hidden = $("label-right").hidden = split === "";
    $("label-left").textContent = model ?? "";
    $("label-right").textContent = split !== "reference" ? there ? split : `${split}, being drawn …`
      : reference ? `reference, ${reference} samples per pixel` : "reference, being traced …";
    this.slide(this.cut);
  }

  /** Show a picture as soon as it is decoded, unless a newer one of its kind has come by then. */
  async take(header, blobs) {
    this.newest[header.kind] = [header, blobs];
    if (this.busy[header.kind]) return;
    this.busy[header.kind] = true;
    while (this.newest[header.kind]) {
      const [newest, parts] = this.newest[header.kind];
      this.newest[header.kind] = null;
      const images = await Promise.all(parts.map(blob => createImageBitmap(blob)));
      if (newest.kind === "reference") {
        if (this.split === "reference") draw(this.right, images[0]);
      } else {
        draw(this.left, images[0]);
        if (images[1]) draw(this.right, images[1]);
        this.header = newest;
        this.sides(this.split, this.reference);
        this.shown(newest);
      }
      images.forEach(image => image.close());
    }
    this.busy[header.kind] = false;
  }
}

function draw(canvas, image) {
  if (canvas.width !== image.width || canvas.height !== image.height) {
    canvas.width = image.width; canvas.height = image.height;
  }
  canvas.getContext("2d").drawImage(image, 0, 0);
}
