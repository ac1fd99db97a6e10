// Helpers for the elements of the page.

const TOAST_MS = 6000;

export const $ = id => document.getElementById(id);

/** Replace the options of a select element. */
export function fillSelect(select, values, text = value => value) {
  select.replaceChildren(...values.map(value => new Option(text(value), value)));
}

/** Replace the terms and descriptions of a dl element. */
export function fillList(list, entries) {
  list.replaceChildren(...Object.entries(entries).flatMap(([name, value]) => {
    const term = document.createElement("dt"), text = document.createElement("dd");
    term.textContent = name; text.textContent = value;
    return [term, text];
  }));
}

let hideTimer = 0;
/** Show a notice for a few seconds. */
export function showToast(text) {
  $("toast").textContent = text;
  $("toast").hidden = false;
  clearTimeout(hideTimer);
  hideTimer = setTimeout(() => { $("toast").hidden = true; }, TOAST_MS);
}
