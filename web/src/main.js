/** Mounts a viewer on every `<div class="whitted-viewer" data-manifest="ID">`; scripts may mount more. */

import { Viewer } from "./viewer.js";

/** Make `element` a viewer of the pictures in `manifest`; it is then found as `element.viewer`. */
export function mount(element, manifest) {
  element.viewer = new Viewer(element, manifest);
  return element.viewer;
}

function mountAll() {
  for (const element of document.querySelectorAll(".whitted-viewer[data-manifest]")) {
    mount(element, JSON.parse(document.getElementById(element.dataset.manifest).textContent));
  }
}

if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", mountAll);
else mountAll();
