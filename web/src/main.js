/** Mounts a viewer on every `<div class="whitted-viewer" data-manifest="ID">`; scripts may mount more. */

import { textOf } from "./pictures.js";
import { Viewer } from "./viewer.js";

/** Make `element` a viewer of the pictures in `manifest`; it is then found as `element.viewer`. */
export function mount(element, manifest) {
  element.viewer = new Viewer(element, manifest);
  return element.viewer;
}

const found = new WeakSet();

function mountAll() {
  for (const element of document.querySelectorAll(".whitted-viewer[data-manifest]")) {
    if (found.has(element)) continue;
    found.add(element);
    textOf(element.dataset.manifest).then((text) => mount(element, JSON.parse(text)));
  }
}

mountAll(); // those above this script, before the page's end is there
document.addEventListener("DOMContentLoaded", mountAll);
