// Where the time goes, what draws, and how far the picture is from the reference.

const $ = id => document.getElementById(id);
const HUES = 47; // degrees of hue from one pass to the next

/** Show a message of type `stats`; `latency` in milliseconds, or nothing. */
export function showStats({fps, models, pages}, latency) {
  const bars = [];
  for (const {passes, frame_ms} of models) {
    const parts = Object.entries(passes), total = Math.max(frame_ms, 1e-6);
    const bar = document.createElement("div"), list = document.createElement("ul");
    bar.className = "bar";
    parts.forEach(([name, ms], i) => {
      const colour = `hsl(${(i * HUES + 30) % 360} 55% 55%)`, piece = document.createElement("i");
      piece.style.background = colour; piece.style.width = `${100 * ms / total}%`; piece.title = `${name} ${ms.toFixed(2)} ms`;
      bar.append(piece);
      if (ms < 0.05) return;
      const item = document.createElement("li"), dot = document.createElement("i"), value = document.createElement("b");
      dot.style.background = colour; value.textContent = ms.toFixed(1);
      item.append(dot, name, value);
      list.append(item);
    });
    bars.push(bar, list);
  }
  $("bars").replaceChildren(...bars);
  const ms = models.map(m => m.frame_ms.toFixed(1)).join(" + ");
  $("rate").textContent = `${ms} ms a frame, ${fps.toFixed(1)} frames a second` +
    (latency ? `, ${latency.toFixed(0)} ms from input to picture` : "") + (pages > 1 ? `, ${pages} pages` : "");
  const {device, culled, missing} = models[0] ?? {device: {}, culled: {}, missing: []};
  fill($("device"), {"GL": device.gl_renderer, "OpenGL": device.gl_version, "provider": models.map(m => m.device.provider).join(", "),
                     ...(missing.length ? {"all zero": missing.join(", ")} : {})});
  fill($("culled"), culled);
}

/** Show a message of type `errors`: of each side against the reference. */
export function showErrors(errors) {
  const text = ({psnr, rel_mse, flip}) => [flip !== undefined && `FLIP ${flip.toFixed(3)}`, psnr !== undefined && `PSNR ${psnr.toFixed(1)} dB`,
    rel_mse !== undefined && `relMSE ${rel_mse.toPrecision(3)}`].filter(Boolean).join(", ");
  $("errors").hidden = !errors;
  $("errors").textContent = errors ? "Against the reference: " + errors.map(text).join("; ") : "";
}

function fill(list, entries) {
  list.replaceChildren(...Object.entries(entries).flatMap(([name, value]) => {
    const term = document.createElement("dt"), text = document.createElement("dd");
    term.textContent = name; text.textContent = value;
    return [term, text];
  }));
}
