// Pass times, the device, and errors against the reference.

import {$, fillList} from "./dom.js";

const HUE_STEP = 47, FIRST_HUE = 30; // degrees, from one pass to the next
const MIN_LISTED_MS = 0.05;

/** Show a message of type `stats`; `latency` in milliseconds, or null. */
export function showStats({fps, models, pages}, latency) {
  $("bars").replaceChildren(...models.flatMap(drawBar));
  const ms = models.map(m => m.frame_ms.toFixed(1)).join(" + ");
  $("frame-rate").textContent = `${ms} ms per frame, ${fps.toFixed(1)} frames per second` +
    (latency ? `, ${latency.toFixed(0)} ms from input to image` : "") + (pages > 1 ? `, ${pages} pages` : "");
  const {device, culled, missing} = models[0] ?? {device: {}, culled: {}, missing: []};
  fillList($("device"), {"GL": device.gl_renderer, "OpenGL": device.gl_version,
                         "provider": models.map(m => m.device.provider).join(", "),
                         ...(missing.length ? {"all zero": missing.join(", ")} : {})});
  fillList($("culled"), culled);
}

/** A bar of the passes of one model's frame, and its legend. */
function drawBar({passes, frame_ms}) {
  const bar = document.createElement("div"), legend = document.createElement("ul");
  bar.className = "bar";
  Object.entries(passes).forEach(([name, ms], i) => {
    const colour = `hsl(${(i * HUE_STEP + FIRST_HUE) % 360} 55% 55%)`, segment = document.createElement("i");
    segment.style.background = colour; segment.style.width = `${100 * ms / Math.max(frame_ms, 1e-6)}%`;
    segment.title = `${name} ${ms.toFixed(2)} ms`;
    bar.append(segment);
    if (ms < MIN_LISTED_MS) return;
    const item = document.createElement("li"), swatch = document.createElement("i"), value = document.createElement("b");
    swatch.style.background = colour; value.textContent = ms.toFixed(1);
    item.append(swatch, name, value);
    legend.append(item);
  });
  return [bar, legend];
}

/** Show a message of type `errors`: those of each side against the reference, or null. */
export function showErrors(errors) {
  const text = ({psnr, rel_mse, flip}) => [flip !== undefined && `FLIP ${flip.toFixed(3)}`, psnr !== undefined && `PSNR ${psnr.toFixed(1)} dB`,
    rel_mse !== undefined && `relMSE ${rel_mse.toPrecision(3)}`].filter(Boolean).join(", ");
  $("errors").hidden = !errors;
  $("errors").textContent = errors ? "Against the reference: " + errors.map(text).join("; ") : "";
}
